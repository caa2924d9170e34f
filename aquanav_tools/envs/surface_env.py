"""The benchmark's second task, a boat in a bay of rocks and reefs, as a Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.action import ActionModel
from aquanav_tools.envs.batch import raise_failures, row_of
from aquanav_tools.envs.boat_batch import BoatBatch
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.envs.pictures.sea_camera import SeaCamera
from aquanav_tools.envs.starting import CONDITIONS, NUM_SEEDS, episode_task
from aquanav_tools.envs.surface_task import DT, SUBSTEPS, Bay
from aquanav_tools.sea.sea_map import SeaMap, ShortestPath
from aquanav_tools.sim.batch.boat_state import BoatEpisode
from aquanav_tools.sim.command import AFLOAT
from aquanav_tools.sim.sea_water import SeaWater
from aquanav_tools.types import Array

Observation = npt.NDArray[np.float32]
Info = dict[str, Any]
ARRAYS = (
    "commands", "positions", "orientations", "velocities", "rays", "touched", "collisions", "remaining", "lengths",
    "outcomes", "start_indices", "path_lengths", "decisions", "rewards", "terminated", "truncated",
)  # fmt: skip
"""Of a `BoatBatch`, of which this environment is the only row."""


class SurfaceEnv(gymnasium.Env[Observation, Any]):
    """Cross a bay of rocks and reefs to a goal without touching any, on water that moves.

    ## Action
    `action="multidiscrete"`: MultiDiscrete([3, 3]), held for all physics steps of the decision (5 x 0.02 s).

    | index | name   | 0       | 1        | 2     | effect                                             |
    |-------|--------|---------|----------|-------|----------------------------------------------------|
    | 0     | steer  | left    | straight | right | turns the boat, also without thrust                |
    | 1     | thrust | reverse | stop     | ahead | pushes along the boat; the Otter weaker in reverse |

    "discrete": Discrete(9), 3 * steer + thrust. "continuous": Box(-1, 1, (2,)), positive is left and ahead.

    ## Observation
    `observation="full"`: Box(-1, 1, (16,)); "paper": its first 9 values; "original": the 36 floats that the original's
    ONNX policies take. `envs.surface_observation` has the tables, its `surface_layout(preset)` the slices.

    | index | name     | meaning                                  | scale                     |
    |-------|----------|------------------------------------------|---------------------------|
    | 0-6   | rays     | distance to rock, reef or edge per beam  | the beam's length, 30 m   |
    | 7-8   | goal     | distance, azimuth (left +)               | d / (d + 50 m), pi        |
    | 9-10  | velocity | surge and sway over ground               | v / (abs(v) + 3 m/s)      |
    | 11    | turn     | rate of turn                             | w / (abs(w) + pi/2 rad/s) |
    | 12-13 | tilt     | sine of how far bow and left side are up | 1                         |
    | 14-15 | command  | the last steer and thrust                | 1                         |

    ## Reward
    The terms, weights and default of `CaveEnv`, each in `info["reward/<name>"]`, with -0.1 for the sensor's term of
    "safe", as in the original. Progress is metres gained towards the goal as the crow flies.

    ## Episode
    It starts at rest; unless the bay is fixed, in another bay each time, with its own start and goal, drawn from the
    environment's seed. It terminates within the goal's tolerance ("success"), or at the first contact of the hull with
    a rock, a reef or the bay's edge ("collision") with `on_collision="end"` or the sparse reward; it is truncated after
    `max_decisions` ("timeout").

    ## Info
    The keys of `CaveEnv`, with the same meanings: rays (7,) m; clearance, from the hull to the nearest rock, reef or
    edge as seen from above, m, so that it is negative over a reef that is deep enough; remaining, straight to the
    goal, m; progress, how much less that is than at the start, m; start_index, -1 where it was drawn; gate, always 0.
    Besides, path_length: the shortest way from the start through the rocks, m.

    ## Physics
    One boat of the kernels that `BoatBatch` runs on many (`sim/batch/boat_*.py`): waves, wind, its drift, gusts and
    current; pressure and drag summed up over the hull; the wind's push on what is above the water; contacts without
    Bullet. The original's boat ("boat") stays level at its height, and feels the current but neither waves nor wind.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10, "contacts": "own"}  # noqa: RUF012  # Gymnasium's form
    decision_seconds = SUBSTEPS * DT

    def __init__(
        self,
        bay: Bay = None,
        *,
        action: str = "multidiscrete",
        render_mode: str | None = None,
        render_size: tuple[int, int] = (480, 360),
        **options: Any,
    ) -> None:
        """Prepare bays and physics.

        Args:
            bay: None draws another bay for each episode, a MapSettings likewise; a fixed one is a SeaMap, a seed, or
                the file of a map or of one of the original's scenes.
            action: "multidiscrete", "discrete" or "continuous".
            render_mode: "rgb_array" for pictures by daylight from `render`, from behind the boat.
            render_size: Their width and height, px.
            options: The fields of `SurfaceChoices`: sea ("still", "calm", "breeze" or "rough", to another direction in
                each episode; or a SeaState), observation ("paper", "full" or "original"), vehicle (name of a boat, path
                of its TOML file, or a boat; "boat" is the original's), max_decisions (None takes 2400). And those of
                `aquanav_tools.task.TaskOptions`: `progress` can only be "panels", as a bay's one panel is its goal;
                `current` is the tide's, a speed or a preset, to another direction in each episode, or one velocity
                X Y 0; the wind's drift comes on top, and `current_range` scales both; the wind itself stays.

        Raises:
            ScenarioError: the bay cannot be read, or has no start.
            InputError: an option is unknown or senseless.
        """
        self._batch = batch = BoatBatch(bay, 1, next_step=True, action=action, num_threads=1, **options)
        self.task = self._own_task = batch.task
        self.vehicle, self.footprint = batch.definition.boat, batch.definition.footprint
        self.bays = batch.definition.bays
        self.action_model = ActionModel(action, AFLOAT)
        self.action_space, self.observation_space = batch.action_space, batch.observation_space
        self._arrays = {name: batch.view_of(name) for name in ARRAYS}
        self.episode_seed = 0
        """Of the present episode: with the bay and the options of the task, it says all that is drawn."""
        self._prepare_pictures(render_mode, render_size)

    def _prepare_pictures(self, render_mode: str | None, size: tuple[int, int]) -> None:
        self.render_mode = render_mode
        self._camera: SeaCamera | None = None
        if render_mode is not None:
            check_choice("render mode", render_mode, self.metadata["render_modes"])
            pattern = self._batch.definition.pattern
            self._camera = SeaCamera(self.vehicle, size, pattern.directions, pattern.lengths)

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return the (H, W, 3) picture of boat, bay and sea, RGB; without a render mode, None and a warning."""
        if self._camera is None:
            gymnasium.logger.warn('This environment takes no pictures. Make it with render_mode="rgb_array".')
            return None
        time = int(self._arrays["decisions"][0]) * self.decision_seconds
        return self._camera.picture(self.state, self.water, self._arrays["rays"][0], time)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, Info]:
        """Begin an episode: that of the seed, or of one that this environment's generator draws.

        Options: {"start": number of one of a fixed bay's starts}; and, for this episode alone, sensor_noise,
        sensor_dropout and current_range of the task.
        """
        super().reset(seed=seed)
        given = options or {}
        self.task = episode_task(self._own_task, given)
        self.episode_seed = int(self.np_random.integers(NUM_SEEDS)) if seed is None else seed % NUM_SEEDS
        self._batch.reset(
            [self.episode_seed], [given.get("start")], {name: getattr(self.task, name) for name in CONDITIONS}
        )
        self._batch.retire([0])  # what follows an episode is a reset
        raise_failures(self._batch)
        if self._camera is not None:
            self._camera.look_at(self.sea_map)
        return row_of(self._batch.view_of("observations"), 0), self._info()

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, Info]:
        """Hold an action for one decision."""
        arrays = self._arrays
        arrays["commands"][0] = self.action_model.command(action)
        self._batch.step()
        raise_failures(self._batch)
        terminated, truncated = bool(arrays["terminated"][0]), bool(arrays["truncated"][0])
        seen = row_of(self._batch.view_of("observations"), 0)
        return seen, float(arrays["rewards"][0]), terminated, truncated, self._info()

    def close(self) -> None:
        """Free nothing: a batch of one boat has no threads."""
        self._batch.close()

    @property
    def info(self) -> Info:
        """What the last reset or step told: also where that raised an error of code of the user's own."""
        return self._info()

    @property
    def sea_map(self) -> SeaMap:
        """The bay of this episode."""
        return self._episode.bay

    @property
    def route(self) -> ShortestPath:
        """The shortest way to the goal from where the episode began."""
        assert self._episode.path is not None, "every berth has a way"
        return self._episode.path

    @property
    def state(self) -> Array:
        """The boat's true (13,) state, for controllers that know the map.

        Position of its middle (z from still water, m), quaternion, velocity over ground in the body frame.
        """
        parts = (self._arrays[name][0] for name in ("positions", "orientations", "velocities"))
        return np.concatenate([*parts])

    @property
    def num_starts(self) -> int:
        """How many starts an episode can be told by number; 0 where each has another bay."""
        return 0 if self.bays.fixed is None else len(self.bays.fixed.starts)

    @property
    def path_length(self) -> float:
        """Length of the shortest way to the goal from where the episode began, m."""
        return self.route.length

    @property
    def water_velocity(self) -> Array:
        """(3,) velocity of the water where the boat is, without its waves, world frame, m/s."""
        return self._batch.world.current_at(0)

    @property
    def water(self) -> SeaWater:
        """The sea of this episode, its waves as they are now: for pictures."""
        return self._batch.world.water_at(0)

    @property
    def _episode(self) -> BoatEpisode:
        episode = self._batch.world.episodes[0]
        assert episode is not None, "reset comes first"
        return episode

    def _info(self) -> Info:
        arrays, batch = self._arrays, self._batch
        is_touched, remaining = bool(arrays["touched"][0]), float(arrays["remaining"][0])
        info = {
            "position": arrays["positions"][0].copy(),
            "orientation": arrays["orientations"][0].copy(),
            "velocity": arrays["velocities"][0].copy(),
            "current": self.water_velocity,
            "rays": arrays["rays"][0].copy(),
            "clearance": float(batch.view_of("clearances")[0]),
            "collision": is_touched,
            "num_collisions": int(arrays["collisions"][0]),
            "progress": float(arrays["lengths"][0]) - remaining,
            "remaining": remaining,
            "cost": float(is_touched),
            "outcome": OUTCOMES[arrays["outcomes"][0]],
            "start_index": int(arrays["start_indices"][0]),
            "gate": 0,
            "path_length": float(arrays["path_lengths"][0]),
        }
        terms = zip(batch.term_names, batch.view_of("terms")[0].tolist(), strict=True)
        info.update({f"reward/{name}": value for name, value in terms})
        info.update({f"dynamics/{name}": float(values[0]) for name, values in batch.dynamics.items()})
        return info
