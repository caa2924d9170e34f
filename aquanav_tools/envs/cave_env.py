"""The benchmark's task as a Gymnasium environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.action import IDLE, ActionModel, Command
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.disturbance import Delay, RaySensorErrors
from aquanav_tools.envs.episode import COLLISION_RULES, Episode, EpisodeRules
from aquanav_tools.envs.observation import ObservationModel, Reading
from aquanav_tools.envs.pictures.vehicle_camera import VehicleCamera
from aquanav_tools.envs.progress import progress_measure
from aquanav_tools.envs.reward import TERMS, Decision, RewardWeights, cave_weights, reward_terms
from aquanav_tools.envs.starting import Starts, episode_task
from aquanav_tools.envs.vehicles import prepared
from aquanav_tools.errors import InputError
from aquanav_tools.report.recording.live import LiveDive
from aquanav_tools.scenario.schema import Current, Scenario
from aquanav_tools.sim.actuators import actuator_model
from aquanav_tools.sim.appearance import vehicle_mesh
from aquanav_tools.sim.bullet import BulletWorld
from aquanav_tools.sim.sensors import RangeSensor, original_pattern
from aquanav_tools.sim.spheres import SphereSensor, find_ends
from aquanav_tools.sim.time_limit import decision_limit
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.sim.water import Water
from aquanav_tools.task import TaskOptions, task_options
from aquanav_tools.types import Array

Observation = npt.NDArray[np.float32]
Info = dict[str, Any]
TERM_KEYS = [f"reward/{name}" for name in TERMS]


class CaveEnv(gymnasium.Env[Observation, Any]):
    """Dive through a cave to its goal without touching the wall.

    ## Action
    `action="multidiscrete"`: MultiDiscrete([3, 3, 3]), held for all physics steps of the decision (5 x 0.02 s).

    | index | name    | 0       | 1        | 2     | effect                                            |
    |-------|---------|---------|----------|-------|---------------------------------------------------|
    | 0     | ballast | up      | keep     | down  | moves the trim, which lifts or sinks the vehicle  |
    | 1     | steer   | left    | straight | right | asks for a rate of turn                           |
    | 2     | thrust  | reverse | stop     | ahead | pushes along the body, half as hard in reverse    |

    "discrete": Discrete(27), 9 * ballast + 3 * steer + thrust. "continuous": Box(-1, 1, (3,)), positive is up, left and
    ahead.

    ## Observation
    `observation="full"`: Box(-1, 1, (44,)); "paper": its first 31 values; "original": the 120 floats that
    the original's ONNX policies take. `envs.observation` has the tables, its `layout(preset)` the slices.

    | index | name     | meaning                                      | scale                   |
    |-------|----------|----------------------------------------------|-------------------------|
    | 0-27  | rays     | distance to the wall along each ray          | the ray's length        |
    | 28-30 | goal     | distance, azimuth (left +), elevation (up +) | d / (d + 10 m), pi, pi/2 |
    | 31-33 | velocity | over ground, body frame                      | v / (abs(v) + 1 m/s)    |
    | 34-36 | rates    | rate of turn, body frame                     | w / (abs(w) + pi/2 rad/s) |
    | 37    | depth    | below the entrance                           | d / (abs(d) + 10 m)     |
    | 38-39 | tilt     | sine of how far nose and left side point up  | 1                       |
    | 40    | trim     | state of the ballast                         | 1                       |
    | 41-43 | command  | the last ballast, steer and thrust           | 1                       |

    ## Reward
    The sum of these terms, each in `info["reward/<name>"]`; `reward="careful"` unless another is named:

    | name      | dense | safe   | careful | sparse | unit                                                      |
    |-----------|-------|--------|---------|--------|-----------------------------------------------------------|
    | progress  | 10    | 10     | 10      | 0      | per metre gained along the way to the goal, by `progress` |
    | time      | -0.01 | -0.01  | -0.01   | 0      | per physics step                                          |
    | contact   | -0.01 | -0.01  | -1      | 0      | per physics step in contact                               |
    | proximity | 0     | -0.005 | 0       | 0      | per physics step and share of ray lost                    |
    | goal      | 500   | 500    | 50      | 10     | once                                                      |
    | collision | -1000 | -1000  | -100    | -10    | when it ends the episode                                  |
    | timeout   | 0     | 0      | 0       | -1     | when time runs out                                        |

    The original's own vehicle pays -0.02 for proximity, as it did.

    ## Episode
    It starts at rest at one of the scenario's starts, drawn at random or given by `reset(options={"start": index})`, or
    with `starts="anywhere"` in any water that the vehicle can reach.
    It terminates when no more than the goal's tolerance is left along the guide ("success"), or at the first contact
    ("collision") with `on_collision="end"` or the sparse reward; it is truncated after `max_decisions` ("timeout"):
    2400 (240 s), as in the original, and more where the way is long for the vehicle (`sim.time_limit`).

    ## Info
    After every reset and step: position (3,) m and orientation (4,) (w, x, y, z) in the world; velocity (6,) over
    ground, body frame; current (3,), of the water where the vehicle is, m/s; rays (28,) m; clearance, from the hull to
    the nearest wall, m; collision,
    whether the hull touched a wall during this decision; num_collisions, contacts begun in this episode; progress and
    remaining along the guide, m; cost, 1.0 for a decision with contact, as in Safety-Gymnasium; outcome; start_index,
    -1 for one drawn anywhere; gate, the stretch of the guide; the reward's terms. Rays have no noise and are not late.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 10}  # noqa: RUF012  # Gymnasium's own name and form

    def __init__(
        self,
        scenario: str | Path | Scenario,
        *,
        observation: str = "full",
        action: str = "multidiscrete",
        vehicle: str | Path | Vehicle | None = None,
        max_decisions: int | None = None,
        render_mode: str | None = None,
        view: str = "chase",
        render_size: tuple[int, int] = (480, 360),
        **task: Any,
    ) -> None:
        """Load a scenario and prepare its physics.

        Args:
            scenario: A scenario folder, or a scenario in memory.
            observation: "paper", "full" or "original".
            action: "multidiscrete", "discrete" or "continuous".
            vehicle: Name, path of a TOML file, or a vehicle; None takes the scenario's. Starts at which another hull
                touches the wall are left out, with a warning.
            max_decisions: Episode limit; None takes the scenario's, which grows with the way (`sim.time_limit`).
            render_mode: "rgb_array" for pictures by lamp light from `render`; "human" shows every state in rerun's
                viewer, as fast as they come. A viewer that is there is used, else one is started.
            view: Of the pictures: "chase", from behind the vehicle, or "onboard", from its nose.
            render_size: Their width and height, px.
            task: The fields of `aquanav_tools.task.TaskOptions`: reward, progress, on_collision, starts, sensor_noise,
                sensor_dropout, action_delay, observation_delay, current, current_range.

        Raises:
            ScenarioError: the scenario cannot be read, or has no start.
            InputError: an option is unknown or senseless, or the vehicle's hull does not fit into the cave.
            ResourceError: no viewer can be started.
        """
        self.scenario, self.vehicle = prepared(scenario, vehicle)
        self.task = self._own_task = task_options(task)
        settings = self.scenario.settings
        self._weights = cave_weights(self.task.reward, self.vehicle)
        self._rules = _episode_rules(self.scenario, self.vehicle, self.task, self._weights, max_decisions)
        self._water = _water_of(self.scenario, self.task.current)
        self._current: Array = np.zeros(3)
        """(3,) velocity of the water where the vehicle is, world frame, m/s."""
        self.decision_seconds = settings.limits.substeps * settings.limits.dt
        self._measure = progress_measure(self.task.progress, self.scenario, self.vehicle.capsule)
        self._prepare_interface(observation, action)
        self._actuators = actuator_model(self.vehicle, settings.limits.dt, settings.limits.substeps)
        self._world = BulletWorld(self.scenario, self.vehicle)
        self.starts = Starts(self.scenario, self.vehicle.capsule, self.task.starts)
        self._episode = Episode(self._rules)
        self._prepare_pictures(render_mode, view, render_size)
        self._current_share = 1.0
        self._gate = 0
        self._first_gates: dict[int, int] = {}
        self._length = self._remaining = self.scenario.guide.length

    def _prepare_interface(self, observation: str, action: str) -> None:
        """Choose the spaces, and the sensor: rays, or the spheres of the original."""
        scenario, pattern = self.scenario, original_pattern()
        goal = np.array(scenario.settings.goal.position, dtype=np.float64)
        entrance = scenario.guide.centres[0]
        self.action_model = ActionModel(action)
        self._observation_model = ObservationModel(observation, pattern.lengths, goal, entrance)
        self.action_space = self.action_model.space
        self.observation_space = self._observation_model.space
        self._ray_errors = RaySensorErrors(pattern.lengths)
        self._actions: Delay[Command] = Delay(self.task.action_delay)
        self._observations: Delay[Observation] = Delay(self.task.observation_delay)
        self._inverse_lengths = (1.0 / pattern.lengths).astype(np.float32)
        self._sensor: RangeSensor | SphereSensor = (
            SphereSensor(scenario.field, find_ends(scenario.cavity, entrance, goal), pattern)
            if self._observation_model.is_original
            else RangeSensor(scenario.cavity.mesh, pattern)
        )

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, Info]:
        """Begin an episode.

        Options: {"start": index of one of the scenario's starts}; and, for this episode alone, sensor_noise,
        sensor_dropout and current_range of the task.
        """
        super().reset(seed=seed)
        self.task = episode_task(self._own_task, options or {})
        pose, self._start_index = self.starts.choose(self.np_random, options or {})
        self._current_share = self._draw_current_share()
        self._episode = Episode(self._rules)
        self._beginning = pose.position
        if self._camera is not None:
            self._camera.reset()
        self._world.reset(pose)
        self._actuators.reset()
        self._actions.fill(IDLE)
        state = self._world.state
        self._water.reset(self.np_random)
        self._ray_errors.reset(self.np_random, self.task.sensor_noise, self.task.sensor_dropout)
        self._current = self._current_share * self._water.velocity(state)
        self._gate = self._first_gate(state)
        self._remaining = self.scenario.guide.remaining(state[:3], self._gate)
        self._measure.begin(state, self._remaining)
        rays = self._sensor.sense(state)
        terms = reward_terms(self._weights, Decision(0.0, 0, 0, 0.0, "running"))
        observation = self._observe(rays, state, IDLE)
        self._observations.fill(observation)
        info = self._info(rays, False, terms)
        if self._live is not None:
            self._live.show(info, is_first=True)
        return observation, info

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, Info]:
        """Hold an action for one decision."""
        command = self.action_model.command(action)
        touched, before = self._advance(self._actions.through(command))
        state, num_contact_steps = self._world.state, sum(touched)
        self._water.advance(self.decision_seconds)
        self._current = self._current_share * self._water.velocity(state)
        rays = self._sensor.sense(state)
        gained = self._update_progress()
        outcome = self._episode.advance(touched, self._remaining)
        cut_off = len(rays) - float(rays.dot(self._inverse_lengths)) if self._weights.proximity else 0.0
        terms = reward_terms(self._weights, Decision(gained, len(touched), num_contact_steps, cut_off, outcome))
        terminated, truncated = outcome in ("success", "collision"), outcome == "timeout"
        info = self._info(rays, num_contact_steps > 0, terms)
        if self._live is not None:
            self._live.show(info, is_first=False)
        observation = self._observations.through(self._observe(rays, before, command)).copy()
        return observation, sum(terms.values()), terminated, truncated, info

    def _first_gate(self, state: Array) -> int:
        """Return the gate of an episode's beginning; that of a listed start, which may take a second, is kept."""
        if self._start_index not in self._first_gates:
            gate = self.scenario.guide.locate(state[:3], self.scenario.field)
            if self._start_index < 0:
                return gate
            self._first_gates[self._start_index] = gate
        return self._first_gates[self._start_index]

    @property
    def state(self) -> Array:
        """The vehicle's true (13,) state or more, as in `BulletWorld.state`: for controllers that know the map."""
        return self._world.state.copy()

    @property
    def num_starts(self) -> int:
        """How many starts an episode can be told by number."""
        return len(self.scenario.starts)

    @property
    def max_decisions(self) -> int:
        """After how many decisions an episode is truncated."""
        return self._rules.max_decisions

    @property
    def way(self) -> float:
        """Length of the shortest way to the goal from where the episode began, m."""
        return self.starts.way_to_goal(self._beginning, self._start_index)

    @property
    def water_velocity(self) -> Array:
        """(3,) velocity of the water where the vehicle is, world frame, m/s."""
        return self._current.copy()

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return the (H, W, 3) picture of where the vehicle is, RGB; None where the viewer shows it already.

        Without a render mode, None and a warning.
        """
        if self.render_mode is None:
            gymnasium.logger.warn('This environment takes no pictures. Make it with render_mode="rgb_array".')
        if self._camera is None:
            return None
        return self._camera.picture(self._world.state, self._episode.num_decisions * self.decision_seconds)

    def close(self) -> None:
        """Let go of the physics, and of the viewer, which stays open."""
        self._world.close()
        if self._live is not None:
            self._live.close()

    def _prepare_pictures(self, render_mode: str | None, view: str, size: tuple[int, int]) -> None:
        self.render_mode = render_mode
        limits, hull = self.scenario.settings.limits, self.vehicle.capsule
        seconds = limits.dt * limits.substeps
        self.metadata = {**self.metadata, "render_fps": round(1.0 / seconds)}
        self._camera: VehicleCamera | None = None
        self._live: LiveDive | None = None
        if render_mode is not None:
            check_choice("render mode", render_mode, self.metadata["render_modes"])
        if render_mode == "rgb_array":
            self._camera = VehicleCamera(self.scenario, hull, vehicle_mesh(self.vehicle), view, size)
        elif render_mode == "human":
            self._live = LiveDive(self.scenario, vehicle_mesh(self.vehicle), original_pattern().directions, seconds)

    def _advance(self, command: Command) -> tuple[list[bool], Array]:
        """Hold a command for a decision; return for each physics step whether it touched, and an older state.

        The state is that before the last step where the observation asks for it.
        """
        commands = self._actuators.apply(*command)
        if not self._observation_model.is_original:
            return self._world.step(commands, self._current), self._world.state
        touched = self._world.step(commands[:-1], self._current)
        before = self._world.state.copy()
        return touched + self._world.step(commands[-1:], self._current), before

    def _draw_current_share(self) -> float:
        low, high = self.task.current_range
        return low if low == high else float(self.np_random.uniform(low, high))

    def _update_progress(self) -> float:
        """Follow the vehicle along the guide and return the metres gained."""
        state = self._world.state
        self._gate, self._remaining = self.scenario.guide.follow(state, self._gate)
        return self._measure.gained(state, self._remaining)

    def _observe(self, rays: Observation, before: Array, command: Command) -> Observation:
        trim = self._actuators.trim
        rays, tags = self._ray_errors.disturb(rays, self._sensor.tags, self._episode.num_decisions)
        return self._observation_model.observe(Reading(self._world.state, before, rays, tags, trim, command))

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
            "gate": self._gate,
        }
        info.update(zip(TERM_KEYS, terms.values(), strict=True))
        return info


def _episode_rules(
    scenario: Scenario, vehicle: Vehicle, task: TaskOptions, weights: RewardWeights, max_decisions: int | None
) -> EpisodeRules:
    check_choice("collision rule", task.on_collision, COLLISION_RULES)
    limit = decision_limit(scenario, vehicle) if max_decisions is None else max_decisions
    if limit < 1:
        raise InputError(f"max_decisions must be at least 1, got {limit}.")
    ends_on_collision = weights.ends_on_collision or task.on_collision == "end"
    return EpisodeRules(scenario.settings.goal.tolerance, limit, ends_on_collision)


def _water_of(scenario: Scenario, current: Current | None) -> Water:
    try:
        return Water(scenario, current)
    except ValueError as cause:
        raise InputError(f"{cause} Choose another current.") from cause
