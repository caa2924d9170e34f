"""The benchmark task as a Gymnasium environment.

Importing this package registers it: `gymnasium.make("aquanav/Cave-v0", scenario=...)` works from then on. Without the
import, name the package too: `gymnasium.make("aquanav_tools.envs:aquanav/Cave-v0", scenario=...)`.
"""

from aquanav_tools.envs.registration import register_envs

register_envs()
