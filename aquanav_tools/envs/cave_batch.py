"""The benchmark's task for a batch of vehicles in a cave."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.action import DIVING
from aquanav_tools.envs.batch import BatchActions, Floats, check_batched
from aquanav_tools.envs.batch_view import BatchView
from aquanav_tools.envs.cave_env import _episode_rules, _water_of
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.episode import EpisodeRules
from aquanav_tools.envs.extensions import OWN_PREFIX, Extensions
from aquanav_tools.envs.observation import DISTANCE_SCALE, RATE_SCALE, SPEED_SCALE, ObservationModel
from aquanav_tools.envs.reward import TERMS, RewardWeights, cave_weights
from aquanav_tools.envs.starting import Starts
from aquanav_tools.envs.vehicles import prepared
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.task import MEASURES, TaskOptions, task_options
from aquanav_tools.types import Array, Pose

if TYPE_CHECKING:
    from aquanav_tools.sim.batch.fleet_arrays import TaskNumbers

RAY_SOURCES = ("field", "mesh")


class CaveBatch:
    """N vehicles at the task of `CaveEnv`, with the same options and definitions.

    Not batched yet, and refused: the observation "original".
    """

    def __init__(
        self,
        scenario: str | Path | Scenario,
        num: int,
        *,
        next_step: bool,
        observation: str = "full",
        action: str = "multidiscrete",
        vehicle: str | Path | Vehicle | None = None,
        max_decisions: int | None = None,
        rays: str = "field",
        device: str = "cpu",
        num_threads: int | None = None,
        **task: Any,
    ) -> None:
        """Load a scenario and prepare its batched physics.

        Args:
            scenario: A scenario folder, or a scenario in memory.
            num: Number of vehicles.
            next_step: Whether an ended episode's successor begins at the next step, or in the same one.
            observation: "paper" or "full".
            action: "multidiscrete", "discrete" or "continuous".
            vehicle: As `CaveEnv` takes it.
            max_decisions: Episode limit; None takes the scenario's, which grows with the way (`sim.time_limit`).
            rays: "field" traces them through the distance field, "mesh" casts them exactly, as PyBullet's environment
                does, and takes several times as long.
            device: "cpu", "cuda" or "cuda:0".
            num_threads: On the processor; None takes as many as the process may use.
            task: The fields of `aquanav_tools.task.TaskOptions`.

        Raises:
            ScenarioError: the scenario cannot be read, or has no start.
            InputError: an option is unknown, senseless or not batched, or the vehicle's hull does not fit.
        """
        from aquanav_tools.sim.batch.fleet import BatchWorld

        self.scenario, craft = prepared(scenario, vehicle)
        check_choice("source of rays", rays, RAY_SOURCES)
        options = task_options(task)
        self._own = own = Extensions(options, observation)
        check_batched(own.observation)
        check_choice("measure of progress", options.progress, MEASURES)
        water = _water_of(self.scenario, options.current)
        settings = self.scenario.settings
        weights = cave_weights(own.reward, craft)
        rules = _episode_rules(self.scenario, craft, options, weights, max_decisions)
        goal, entrance = np.array(settings.goal.position, dtype=np.float64), self.scenario.guide.centres[0]
        self.parts: tuple[str, ...] = DIVING
        self._actions = BatchActions(action, num)
        self.action_space = self._actions.space
        self.ray_lengths = original_pattern().lengths
        preset = ObservationModel(own.observation, self.ray_lengths, goal, entrance).space
        self.max_decisions = rules.max_decisions
        self._starts = Starts(self.scenario, craft.capsule, options.starts)
        self.num, self.decision_seconds = num, settings.limits.dt * settings.limits.substeps
        self.world = BatchWorld(
            self.scenario,
            craft,
            _numbers(goal, float(entrance[2]), rules, weights, preset, options, own.observation_delay),
            num,
            water=water,
            current_range=options.current_range,
            rays="mesh" if rays == "mesh" else "field",
            next_step=next_step,
            device=device,
            num_threads=num_threads,
            draw_start=self._draw_start if options.starts == "anywhere" else None,
        )
        view = partial(BatchView, num=num, ray_lengths=self.ray_lengths, decision_seconds=self.decision_seconds)
        self.observation_space = own.prepare(
            view, self.world.as_numpy, self.world.write, preset, (self.scenario, craft)
        )

    @property
    def term_names(self) -> tuple[str, ...]:
        """Of the columns of "terms"."""
        return self._own.term_names

    @property
    def failures(self) -> dict[int, str]:
        """Why code of the user's own failed in the last reset or step, by vehicle."""
        return self._own.failures

    def _draw_start(self, seed: int) -> Pose:
        return self._starts.draw(np.random.default_rng(seed))

    @property
    def route_lengths(self) -> Array:
        """(N,) length of the guide, m."""
        return np.full(self.num, self.scenario.guide.length)

    @property
    def ways(self) -> Array:
        """(N,) length of the shortest way to the goal from where each episode began, m."""
        beginnings = zip(self.view_of("beginnings"), self.view_of("start_indices").tolist(), strict=True)
        return np.array([self._starts.way_to_goal(position, index) for position, index in beginnings])

    def reset(self, seeds: Sequence[int], starts: Sequence[int | None] | None = None) -> None:
        """Begin all episodes, each from a seed of its own."""
        first = None if starts is None else np.array([-1 if start is None else start for start in starts], np.int32)
        self.world.reset(np.array([seed % (1 << 32) for seed in seeds]), first)
        self._own.begin()

    def stagger(self, seed: int) -> None:
        """Let time run out earlier, by chance, in the episodes that have just begun."""
        self.world.age(np.random.default_rng(seed).integers(self.max_decisions, size=self.num))

    def command(self, actions: Any) -> None:
        """Hand the actions of all vehicles to the next step."""
        self.hold(self._actions.commands(actions))

    def hold(self, commands: Floats) -> None:
        """Hand (N, 3) ballast, steer and thrust in [-1, 1] to the next step."""
        self.world.fleet.commands.assign(commands)

    def rest(self, places: Sequence[int]) -> None:
        """Draw no further starts at these places until the next reset; the kernels move all vehicles."""
        self.world.rest(places)

    def step(self) -> None:
        """Carry out a decision of every vehicle."""
        self._own.before()
        self.world.step(self._own.judge)
        self._own.after()

    def view_of(self, name: str) -> Any:
        """Return an array of `sim.batch.fleet_arrays.Fleet`, which later steps change."""
        own = self._own.arrays
        return own[name] if name in own else self.world.as_numpy(name)

    def copy_of(self, name: str) -> Any:
        """Return a copy of an array of `sim.batch.fleet_arrays.Fleet` that later steps leave alone."""
        return np.array(self.view_of(name))

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all arrays."""
        return self.world.state() | self._own.state()

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Go back to where `state` was taken."""
        self.world.restore({name: values for name, values in state.items() if not name.startswith(OWN_PREFIX)})
        self._own.restore(state)

    def close(self) -> None:
        """End the threads."""
        self.world.close()


def _numbers(
    goal: npt.NDArray[np.float64],
    entrance_height: float,
    rules: EpisodeRules,
    weights: RewardWeights,
    observations: spaces.Space[Any],
    options: TaskOptions,
    observation_delay: int,
) -> TaskNumbers:
    from aquanav_tools.sim.batch.fleet_arrays import TaskNumbers

    return TaskNumbers(
        goal=goal,
        tolerance=rules.tolerance,
        max_decisions=rules.max_decisions,
        ends_on_collision=rules.ends_on_collision,
        weights=tuple(getattr(weights, name) for name in TERMS),
        scales=(DISTANCE_SCALE, SPEED_SCALE, RATE_SCALE),
        entrance_height=entrance_height,
        size=int(observations.shape[0]),  # type: ignore[index]  # a box has a shape
        progress=options.progress,
        sensor_noise=options.sensor_noise,
        sensor_dropout=options.sensor_dropout,
        action_delay=options.action_delay,
        observation_delay=observation_delay,
    )
