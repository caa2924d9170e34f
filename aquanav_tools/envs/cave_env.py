"""The benchmark's task as a Gymnasium environment."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.action import ActionModel
from aquanav_tools.envs.batch import raise_failures, row_of
from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.dict_observation import Parts
from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.envs.pictures.vehicle_camera import VehicleCamera
from aquanav_tools.envs.starting import CONDITIONS, NUM_SEEDS, episode_task
from aquanav_tools.report.recording.live import LiveDive
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.appearance import vehicle_mesh
from aquanav_tools.sim.contacts import Contacts, default_contacts
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array

if TYPE_CHECKING:
    from aquanav_tools.sim.batch.water import WaterNow

Observation = npt.NDArray[np.float32]
Info = dict[str, Any]
ROWS = ("commands", "positions", "orientations", "velocities", "currents", "rays", "terms")
NUMBERS = ("clearances", "touched", "collisions", "remaining", "outcomes", "start_indices", "gates")
"""Of `sim.batch.state.BatchState`, of which this environment is the only row: with several numbers, and with one."""
ARRAYS = (*ROWS, *NUMBERS, "extra", "decisions", "observations", "rewards", "terminated", "truncated")
"""With what it reads beside them."""


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
    It terminates at the goal's panel, when no more than its tolerance is left along the guide ("success"), or at the
    first contact ("collision") with `on_collision="end"` or the sparse reward; it is truncated after `max_decisions`
    ("timeout"): 2400 (240 s), as in the original, and more where the way is long for the vehicle (`sim.time_limit`).

    ## Info
    After every reset and step: position (3,) m and orientation (4,) (w, x, y, z) in the world; velocity (6,) over
    ground, body frame; current (3,), of the water where the vehicle is, m/s; rays (28,) m; clearance, from the hull to
    the nearest wall, m; collision,
    whether the hull touched a wall during this decision; num_collisions, contacts begun in this episode; progress and
    remaining along the guide, m; cost, 1.0 for a decision with contact, as in Safety-Gymnasium; outcome; start_index,
    -1 for one drawn anywhere; gate, the stretch of the guide; the reward's terms. Rays have no noise and are not late.
    With a randomisation, "dynamics/<name>" of what the episode drew (`sim.randomisation.Randomisation.names`).
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 10}  # noqa: RUF012  # Gymnasium's own name and form

    def __init__(
        self,
        scenario: str | Path | Scenario,
        *,
        observation: str | Parts = "full",
        action: str = "multidiscrete",
        vehicle: str | Path | Vehicle | None = None,
        max_decisions: int | None = None,
        rays: str = "mesh",
        contacts: Contacts | None = None,
        render_mode: str | None = None,
        view: str = "chase",
        render_size: tuple[int, int] = (480, 360),
        **task: Any,
    ) -> None:
        """Load a scenario and prepare its physics.

        Args:
            scenario: A scenario folder, or a scenario in memory.
            observation: "paper", "full" or "original"; or several parts by name, for a `Dict`: sensors
                (docs/sensors.md), and one of these at most.
            action: "multidiscrete", "discrete" or "continuous".
            vehicle: Name, path of a TOML file, or a vehicle; None takes the scenario's. Starts at which another hull
                touches the wall are left out, with a warning.
            max_decisions: Episode limit; None takes the scenario's, which grows with the way (`sim.time_limit`).
            render_mode: "rgb_array" for pictures by lamp light from `render`; "human" shows every state in rerun's
                viewer, as fast as they come. A viewer that is there is used, else one is started.
            view: Of the pictures: "chase", from behind the vehicle, or "onboard", from its nose.
            render_size: Their width and height, px.
            rays: "mesh" casts them exactly; "field" traces them through the distance field, which is faster and errs by
                a twentieth of its spacing in the median. The observation "original" casts spheres through the field.
            contacts: "bullet" asks PyBullet what the wall does; "own" is what the vector environment does; None takes
                PyBullet where it is installed. `metadata["contacts"]` says which.
            task: The fields of `aquanav_tools.task.TaskOptions`: reward, progress, on_collision, starts, sensor_noise,
                sensor_dropout, action_delay, observation_delay, current, current_range.

        Raises:
            ScenarioError: the scenario cannot be read, or has no start.
            InputError: an option is unknown or senseless, or the vehicle's hull does not fit into the cave.
            ResourceError: no viewer can be started, or PyBullet is asked for, and not installed.
        """
        contacts = default_contacts() if contacts is None else contacts
        self._batch = batch = CaveBatch(
            scenario,
            1,
            next_step=True,
            observation=observation,
            action=action,
            vehicle=vehicle,
            max_decisions=max_decisions,
            rays=rays,
            contacts=contacts,
            num_threads=1,
            **task,
        )
        self.scenario, self.vehicle = batch.scenarios[0], batch.vehicles[0]
        self.task = self._own_task = batch.task
        self.starts = batch.starts[0]
        self.decision_seconds = batch.decision_seconds
        self.action_model = ActionModel(action)
        self.action_space, self.observation_space = batch.action_space, batch.observation_space
        self._show_arrays()
        self.episode_seed = 0
        """Of the present episode: with the scenario and the options of the task, it says all that is drawn."""
        self._length = self.scenario.guide.length
        self._state_size = len(self.vehicle.state_at(self.scenario.starts[0].pose))
        self._prepare_pictures(render_mode, view, render_size)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, Info]:
        """Begin an episode: that of the seed, or of one that this environment's generator draws.

        Options: {"start": index of one of the scenario's starts}; and, for this episode alone, sensor_noise,
        sensor_dropout and current_range of the task.
        """
        super().reset(seed=seed)
        given = options or {}
        self.task = episode_task(self._own_task, given)
        self.episode_seed = int(self.np_random.integers(NUM_SEEDS)) if seed is None else seed % NUM_SEEDS
        conditions = {name: getattr(self.task, name) for name in CONDITIONS}
        self._batch.reset([self.episode_seed], [given.get("start")], conditions)
        self._show_arrays()
        self._term_keys = [f"reward/{name}" for name in self._batch.term_names]
        raise_failures(self._batch)
        if self._camera is not None:
            self._camera.reset()
        info = self._info()
        if self._live is not None:
            self._live.show(info, is_first=True)
        return row_of(self._arrays["observations"], 0), info

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, Info]:
        """Hold an action for one decision."""
        arrays = self._arrays
        self._rows["commands"][:] = self.action_model.command(action)
        self._batch.step()
        raise_failures(self._batch)
        info = self._info()
        if self._live is not None:
            self._live.show(info, is_first=False)
        terminated, truncated = arrays["terminated"].item(), arrays["truncated"].item()
        return row_of(arrays["observations"], 0), arrays["rewards"].item(), terminated, truncated, info

    @property
    def info(self) -> Info:
        """What the last reset or step told: also where that raised an error of code of the user's own."""
        return self._info()

    @property
    def state(self) -> Array:
        """The vehicle's true state, for controllers that know the map.

        (13,) or more: position (world, m), quaternion (w, x, y, z), velocity over ground (body, m/s and rad/s), and
        what the vehicle's model adds.
        """
        names = ("positions", "orientations", "velocities", "extra")
        return np.concatenate([self._arrays[name][0] for name in names])[: self._state_size]

    @property
    def num_starts(self) -> int:
        """How many starts an episode can be told by number."""
        return len(self.scenario.starts)

    @property
    def max_decisions(self) -> int:
        """After how many decisions an episode is truncated."""
        return int(self._batch.limits[0])

    @property
    def path_length(self) -> float:
        """Length of the shortest way to the goal from where the episode began, m."""
        return float(self._batch.path_lengths[0])

    @property
    def water_velocity(self) -> Array:
        """(3,) velocity of the water where the vehicle is, world frame, m/s."""
        return np.array(self._arrays["currents"][0])

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return the (H, W, 3) picture of where the vehicle is, RGB; None where the viewer shows it already.

        Without a render mode, None and a warning.
        """
        if self.render_mode is None:
            gymnasium.logger.warn('This environment takes no pictures. Make it with render_mode="rgb_array".')
        if self._camera is None:
            return None
        return self._camera.picture(self.state, float(self._arrays["decisions"][0]) * self.decision_seconds)

    @property
    def drawn_dynamics(self) -> dict[str, Array]:
        """(1,) numbers by name that this episode drew of its vehicle's dynamics; nothing without a randomisation."""
        return {name: np.array(values) for name, values in self._batch.dynamics.items()}

    @property
    def water_now(self) -> WaterNow:
        """The water around the vehicle: its flow, and the gusts and eddies of this moment."""
        from aquanav_tools.sim.batch.water import WaterNow

        world, arrays = self._batch.world, self._batch.world.arrays
        return WaterNow(world.caves.rows[0].water, arrays.eddies, arrays.phases, arrays.current_fractions)

    @property
    def action_delay(self) -> int:
        """Decisions between choosing an action and its effect in this episode, which may have drawn its own."""
        return int(self._batch.view_of("action_delays")[0])

    @property
    def ballast_level(self) -> float:
        """True state of the ballast, also where it is observed late: trim, or a floater's power."""
        return float(self._batch.view_of("levels")[0])

    def close(self) -> None:
        """Let go of the physics, and of the viewer, which stays open."""
        self._batch.close()
        if self._live is not None:
            self._live.close()

    def _prepare_pictures(self, render_mode: str | None, view: str, size: tuple[int, int]) -> None:
        self.render_mode = render_mode
        limits, hull = self.scenario.settings.limits, self.vehicle.capsule
        seconds = limits.dt * limits.substeps
        self.metadata = {**self.metadata, "render_fps": round(1.0 / seconds), "contacts": self._batch.contacts}
        self._camera: VehicleCamera | None = None
        self._live: LiveDive | None = None
        if render_mode is not None:
            check_choice("render mode", render_mode, self.metadata["render_modes"])
        if render_mode == "rgb_array":
            self._camera = VehicleCamera(self.scenario, hull, vehicle_mesh(self.vehicle), view, size)
        elif render_mode == "human":
            directions, has_dynamics = original_pattern().directions, self._own_task.randomisation is not None
            self._live = LiveDive(self.scenario, vehicle_mesh(self.vehicle), directions, seconds, has_dynamics)

    def _show_arrays(self) -> None:
        """Look up the arrays once: their rows where a vehicle has several numbers there, those with one by themselves.

        That saves a quarter of the time that `_info` takes.
        """
        self._arrays = {name: self._batch.view_of(name) for name in ARRAYS}
        self._rows = {name: self._arrays[name][0] for name in ROWS}
        self._numbers = [self._arrays[name] for name in NUMBERS]

    def _info(self) -> Info:
        rows = self._rows
        clearance, num_touched, num_collisions, remaining, outcome, start_index, gate = [
            array.item() for array in self._numbers
        ]
        info = {
            "position": rows["positions"].copy(),
            "orientation": rows["orientations"].copy(),
            "velocity": rows["velocities"].copy(),
            "current": rows["currents"].copy(),
            "rays": rows["rays"].copy(),
            "clearance": clearance,
            "collision": num_touched > 0,
            "num_collisions": num_collisions,
            "progress": self._length - remaining,
            "remaining": remaining,
            "cost": float(num_touched > 0),
            "outcome": OUTCOMES[outcome],
            "start_index": start_index,
            "gate": gate,
        }
        info.update(zip(self._term_keys, rows["terms"].tolist(), strict=True))
        if self._own_task.randomisation is not None:
            info.update({f"dynamics/{name}": float(values[0]) for name, values in self._batch.dynamics.items()})
        return info
