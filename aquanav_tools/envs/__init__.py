"""The benchmark's tasks, under water and on it, as Gymnasium environments.

Importing this package registers them: `gymnasium.make("aquanav/Cave-v0", scenario=...)` and
`gymnasium.make("aquanav/Surface-v0")` work from then on. Without the import, name the package too:
`gymnasium.make("aquanav_tools.envs:aquanav/Cave-v0", scenario=...)`.
"""

from aquanav_tools.envs.registration import register_envs

register_envs()
