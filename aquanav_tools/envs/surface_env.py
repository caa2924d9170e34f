"""The benchmark's second task, a boat in a bay of rocks and reefs, as a Gymnasium environment."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.action import AFLOAT, IDLE, ActionModel, Command
from aquanav_tools.envs.bays import Bays, distance_to
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.disturbance import Delay, RaySensorErrors
from aquanav_tools.envs.episode import COLLISION_RULES, Episode, EpisodeRules
from aquanav_tools.envs.extensions import refuse_own
from aquanav_tools.envs.observation import Reading
from aquanav_tools.envs.pictures.sea_camera import SeaCamera
from aquanav_tools.envs.reward import TERMS, Decision, RewardWeights, boat_weights, reward_terms
from aquanav_tools.envs.seas import Seas
from aquanav_tools.envs.starting import episode_task
from aquanav_tools.envs.surface_observation import SurfaceObservation
from aquanav_tools.errors import InputError
from aquanav_tools.sea.generate import MapSettings
from aquanav_tools.sea.sea_map import SeaMap
from aquanav_tools.sim.boat import Boat, load_boat
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.sea_sensor import SeaSensor
from aquanav_tools.sim.sea_state import SeaState
from aquanav_tools.sim.sea_water import SeaWater
from aquanav_tools.sim.sea_world import SeaWorld
from aquanav_tools.sim.sensors import boat_pattern
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.task import TaskOptions, task_options
from aquanav_tools.types import Array

Observation = npt.NDArray[np.float32]
Info = dict[str, Any]
TERM_KEYS = [f"reward/{name}" for name in TERMS]
DT, SUBSTEPS, MAX_DECISIONS = 0.02, 5, 2400
"""The original's: physics step (s), steps per decision, and its limit of 12000 steps."""
ORIGINAL_BOAT = "boat"


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
    Besides, way: the shortest way from the start through the rocks, m.

    ## Physics
    Waves, wind, its drift, gusts and current are `SeaWater`'s; pressure and drag are summed up over the hull, and the
    wind pushes on what is above the water (`sim.windage`). Contacts need no Bullet: `sim.sea_world` says why. The
    original's boat ("boat") stays level at its height, and feels the current but neither waves nor wind.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  # Gymnasium's own name and form
    decision_seconds = SUBSTEPS * DT

    def __init__(
        self,
        bay: SeaMap | MapSettings | int | str | Path | None = None,
        *,
        sea: str | SeaState = "calm",
        observation: str = "full",
        action: str = "multidiscrete",
        vehicle: str | Path | Boat | OriginalVehicle = "otter",
        max_decisions: int | None = None,
        render_mode: str | None = None,
        render_size: tuple[int, int] = (480, 360),
        **task: Any,
    ) -> None:
        """Prepare bays and physics.

        Args:
            bay: None draws another bay for each episode, a MapSettings likewise; a fixed one is a SeaMap, a seed, or
                the file of a map or of one of the original's scenes.
            sea: "still", "calm", "breeze" or "rough", to another direction in each episode; or a SeaState.
            observation: "paper", "full" or "original".
            action: "multidiscrete", "discrete" or "continuous".
            vehicle: Name of a boat, path of its TOML file, or a boat; "boat" is the original's.
            max_decisions: Episode limit; None takes 2400.
            render_mode: "rgb_array" for pictures by daylight from `render`, from behind the boat.
            render_size: Their width and height, px.
            task: The fields of `aquanav_tools.task.TaskOptions`. `progress` can only be "panels": a bay's one panel is
                its goal. `current` is the tide's: a speed or a preset, to another direction in each episode, or one
                velocity X Y 0; the wind's drift comes on top, and `current_range` scales both; the wind itself stays.

        Raises:
            ScenarioError: the bay cannot be read, or has no start.
            InputError: an option is unknown or senseless.
        """
        self.task = self._own_task = task_options(task)
        refuse_own(self.task, observation, "Boats")
        self.vehicle = boat_of(vehicle)
        self._weights = boat_weights(self.task.reward)
        self._rules = episode_rules(self.task, self._weights, max_decisions)
        self._world = SeaWorld(self.vehicle, DT, SUBSTEPS)
        self.footprint = self._world.footprint
        self.bays = Bays(bay, self.footprint.width, self.task.starts)
        self._seas = Seas(sea, self.task.current)
        self._prepare_interface(observation, action)
        self._prepare_pictures(render_mode, render_size)
        self._episode = Episode(self._rules)
        self._current: Array = np.zeros(3)

    def _prepare_interface(self, observation: str, action: str) -> None:
        pattern = boat_pattern()
        self.action_model = ActionModel(action, AFLOAT)
        self._observation_model = SurfaceObservation(observation, pattern.lengths)
        self.action_space = self.action_model.space
        self.observation_space = self._observation_model.space
        self._sensor = SeaSensor(pattern, sees_goal=self._observation_model.is_original)
        self._inverse_lengths = (1.0 / pattern.lengths).astype(np.float32)
        self._ray_errors = RaySensorErrors(pattern.lengths)
        self._actions: Delay[Command] = Delay(self.task.action_delay)
        self._observations: Delay[Observation] = Delay(self.task.observation_delay)

    def _prepare_pictures(self, render_mode: str | None, size: tuple[int, int]) -> None:
        self.render_mode = render_mode
        self._camera: SeaCamera | None = None
        if render_mode is not None:
            check_choice("render mode", render_mode, self.metadata["render_modes"])
            pattern = boat_pattern()
            self._camera = SeaCamera(self.vehicle, size, pattern.directions, pattern.lengths)

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return the (H, W, 3) picture of boat, bay and sea, RGB; without a render mode, None and a warning."""
        if self._camera is None:
            gymnasium.logger.warn('This environment takes no pictures. Make it with render_mode="rgb_array".')
            return None
        time = self._episode.num_decisions * self.decision_seconds
        return self._camera.picture(self._world.state, self._water, self._rays, time)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, Info]:
        """Begin an episode.

        Options: {"start": number of one of a fixed bay's starts}; and, for this episode alone, sensor_noise,
        sensor_dropout and current_range of the task.
        """
        super().reset(seed=seed)
        self.task = episode_task(self._own_task, options or {})
        self.sea_map, berth, self.route, self._start_index = self.bays.choose(self.np_random, options or {})
        self._begin_water()
        self._ray_errors.reset(self.np_random, self.task.sensor_noise, self.task.sensor_dropout)
        self._episode = Episode(replace(self._rules, tolerance=self.sea_map.goal.tolerance))
        self._world.begin(self.sea_map, berth, self._water)
        self._sensor.look_at(self.sea_map)
        self._actions.fill(IDLE)
        self._length = self._remaining = distance_to(self.sea_map.goal, self._world.state)
        if self._camera is not None:
            self._camera.look_at(self.sea_map)
        self._rays = rays = self._sensor.sense(self._world.state)
        observation = self._observe(rays, IDLE)
        self._observations.fill(observation)
        terms = reward_terms(self._weights, Decision(0.0, 0, 0, 0.0, "running"))
        return observation, self._info(rays, False, terms)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, Info]:
        """Hold an action for one decision."""
        command = self.action_model.command(action)
        _, steer, thrust = self._actions.through(command)
        touched = self._world.step(steer, thrust, self._water, self._current)
        self._water.advance(self.decision_seconds)
        self._current = self._current_share * self._water.current
        self._rays = rays = self._sensor.sense(self._world.state)
        before, self._remaining = self._remaining, distance_to(self.sea_map.goal, self._world.state)
        outcome = self._episode.advance(touched, self._remaining)
        cut_off = len(rays) - float(rays.dot(self._inverse_lengths)) if self._weights.proximity else 0.0
        decision = Decision(before - self._remaining, len(touched), sum(touched), cut_off, outcome)
        terms = reward_terms(self._weights, decision)
        info = self._info(rays, any(touched), terms)
        observation = self._observations.through(self._observe(rays, command)).copy()
        terminated, truncated = outcome in ("success", "collision"), outcome == "timeout"
        return observation, sum(terms.values()), terminated, truncated, info

    @property
    def state(self) -> Array:
        """The boat's true (13,) state or more, as in `SeaWorld.state`: for controllers that know the map."""
        return self._world.state.copy()

    @property
    def num_starts(self) -> int:
        """How many starts an episode can be told by number; 0 where each has another bay."""
        return 0 if self.bays.fixed is None else len(self.bays.fixed.starts)

    @property
    def way(self) -> float:
        """Length of the shortest way to the goal from where the episode began, m."""
        return self.route.length

    @property
    def water_velocity(self) -> Array:
        """(3,) velocity of the water where the boat is, without its waves, world frame, m/s."""
        return self._current.copy()

    @property
    def water(self) -> SeaWater:
        """The sea of this episode: for pictures."""
        return self._water

    def _begin_water(self) -> None:
        self._water, self._current_share = self._seas.draw(self.np_random, self.sea_map.depth, self.task.current_range)
        self._current = self._current_share * self._water.current

    def _observe(self, rays: Observation, command: Command) -> Observation:
        world = self._world
        rays, tags = self._ray_errors.disturb(rays, self._sensor.tags, self._episode.num_decisions)
        reading = Reading(world.state, world.before, rays, tags, 0.0, command)
        return self._observation_model.observe(reading, self.sea_map.goal.centre)

    def _info(self, rays: Observation, is_touched: bool, terms: dict[str, float]) -> Info:
        state = self._world.state.copy()
        info = {
            "position": state[:3],
            "orientation": state[3:7],
            "velocity": state[7:13],
            "current": self._current,
            "rays": rays,
            "clearance": self._world.clearance(),
            "collision": is_touched,
            "num_collisions": self._episode.num_collisions,
            "progress": self._length - self._remaining,
            "remaining": self._remaining,
            "cost": float(is_touched),
            "outcome": self._episode.outcome,
            "start_index": self._start_index,
            "gate": 0,
            "way": self.way,
        }
        info.update(zip(TERM_KEYS, terms.values(), strict=True))
        return info


def boat_of(vehicle: str | Path | Boat | OriginalVehicle) -> Boat | OriginalVehicle:
    """Return a boat by its name or the path of its TOML file; "boat" is the original's.

    Raises:
        InputError: there is no such boat.
    """
    if isinstance(vehicle, Boat):
        return vehicle
    found = load_vehicle(vehicle) if vehicle == ORIGINAL_BOAT else vehicle
    if isinstance(found, str | Path):
        return load_boat(found)
    if not isinstance(found, OriginalVehicle) or found.ballast is not None:
        name = getattr(found, "name", found)
        raise InputError(f"{name!r} is no boat. Boats are `sim.boat.Boat`, and the original's, '{ORIGINAL_BOAT}'.")
    return found


def episode_rules(task: TaskOptions, weights: RewardWeights, max_decisions: int | None) -> EpisodeRules:
    """Return the rules of a task's episodes but for the goal's tolerance, which is the bay's.

    Raises:
        InputError: there is no such rule for collisions or measure of progress, or no decision is allowed.
    """
    check_choice("measure of progress on the surface", task.progress, ("panels",))
    check_choice("collision rule", task.on_collision, COLLISION_RULES)
    limit = MAX_DECISIONS if max_decisions is None else max_decisions
    if limit < 1:
        raise InputError(f"max_decisions must be at least 1, got {limit}.")
    return EpisodeRules(0.0, limit, weights.ends_on_collision or task.on_collision == "end")
