"""The benchmark's task for a batch of vehicles: what the two vectorised environments have in common."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.action import NUM_CHOICES, ActionModel
from aquanav_tools.envs.cave_env import _episode_rules, _water_of, vehicle_of
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.episode import EpisodeRules
from aquanav_tools.envs.observation import DISTANCE_SCALE, RATE_SCALE, SPEED_SCALE, ObservationModel
from aquanav_tools.envs.reward import TERMS, RewardWeights, load_weights
from aquanav_tools.errors import InputError, ScenarioError
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.task import TaskOptions, choices_of, task_options

if TYPE_CHECKING:
    from aquanav_tools.sim.batch.fleet_arrays import TaskNumbers

Floats = npt.NDArray[np.float32]
RAY_SOURCES = ("field", "mesh")
BATCHED_OBSERVATIONS = ("paper", "full")
BATCHED_OPTIONS = ("reward", "on_collision", "current", "current_range")


class BatchTask:
    """N vehicles at the task of `CaveEnv`, with the same options and definitions.

    Not batched yet, and refused: the observation "original", and every field of TaskOptions but BATCHED_OPTIONS.
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
            vehicle: Name, path of a TOML file, or a vehicle; None takes the scenario's.
            max_decisions: Episode limit; None takes the scenario's.
            rays: "field" traces them through the distance field, "mesh" casts them exactly, as PyBullet's environment
                does, and takes several times as long.
            device: "cpu", "cuda" or "cuda:0".
            num_threads: On the processor; None takes as many as the process may use.
            task: The fields of `aquanav_tools.task.TaskOptions`.

        Raises:
            ScenarioError: the scenario cannot be read, or has no start.
            InputError: an option is unknown, senseless or not batched.
        """
        from aquanav_tools.sim.batch.fleet import BatchWorld

        self.scenario = scenario if isinstance(scenario, Scenario) else read_scenario(scenario)
        if not self.scenario.starts:
            raise ScenarioError(f"The scenario {self.scenario.name} has no starts. Build it again.")
        check_choice("source of rays", rays, RAY_SOURCES)
        options = task_options(task)
        check_batched(options, observation)
        water = _water_of(self.scenario, options.current)
        weights, settings = load_weights(options.reward), self.scenario.settings
        rules = _episode_rules(self.scenario, options, weights, max_decisions)
        goal, entrance = np.array(settings.goal.position, dtype=np.float64), self.scenario.guide.centres[0]
        self.action_space = ActionModel(action).space
        lengths = original_pattern().lengths
        self.observation_space = ObservationModel(observation, lengths, goal, entrance).space
        self._commands_of = _CONVERTERS[action]
        self.world = BatchWorld(
            self.scenario,
            vehicle_of(self.scenario, vehicle),
            _numbers(goal, float(entrance[2]), rules, weights, self.observation_space),
            num,
            water=water,
            current_range=options.current_range,
            rays="mesh" if rays == "mesh" else "field",
            next_step=next_step,
            device=device,
            num_threads=num_threads,
        )

    def command(self, actions: Any) -> None:
        """Hand the actions of all vehicles to the next step.

        Raises:
            InputError: one is not in the action space.
        """
        commands = self._commands_of(np.asarray(actions))
        if commands.shape != (self.world.num, 3):
            raise InputError(f"Actions must be one for each of the {self.world.num} vehicles, got {np.shape(actions)}.")
        self.world.fleet.commands.assign(commands)

    def copy_of(self, name: str) -> Any:
        """Return a copy of an array of `sim.batch.fleet_arrays.Fleet` that later steps leave alone."""
        return np.array(self.world.as_numpy(name))


def _numbers(
    goal: npt.NDArray[np.float64],
    entrance_height: float,
    rules: EpisodeRules,
    weights: RewardWeights,
    observations: spaces.Space[Any],
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
    )


def check_batched(options: TaskOptions, observation: str) -> None:
    """Refuse what only `CaveEnv` does, rather than leave it out in silence.

    Raises:
        InputError: an option, or the observation, is not batched; the message names it.
    """
    check_choice("batched observation preset", observation, BATCHED_OBSERVATIONS)
    for name, value in choices_of(options).items():
        if name not in BATCHED_OPTIONS and value != getattr(TaskOptions(), name):
            raise InputError(
                f"The batched environment has no {name} = {value!r}; of the task's options it has only "
                f"{', '.join(BATCHED_OPTIONS)}. Leave it out, or take PyBullet: aquanav/Cave-v0 "
                "without vectorization_mode='vector_entry_point', or --backend pybullet of the commands."
            )


def _from_choices(actions: npt.NDArray[Any]) -> Floats:
    if actions.size and not (0 <= actions.min() and actions.max() < NUM_CHOICES):
        raise InputError(f"Actions must be choices from 0 to 2, got {actions.min()} to {actions.max()}.")
    return (actions - 1.0).astype(np.float32) * np.array([-1.0, -1.0, 1.0], dtype=np.float32)


def _from_numbers(actions: npt.NDArray[Any]) -> Floats:
    if actions.size and not (0 <= actions.min() and actions.max() < NUM_CHOICES**3):
        raise InputError(f"Actions must be numbers from 0 to 26, got {actions.min()} to {actions.max()}.")
    return _from_choices(np.stack([actions // 9, actions // 3 % 3, actions % 3], axis=-1))


def _from_levels(actions: npt.NDArray[Any]) -> Floats:
    if not np.isfinite(actions).all():
        raise InputError("An action is not finite. Did the policy diverge?")
    return np.clip(actions, -1.0, 1.0).astype(np.float32)


_CONVERTERS: dict[str, Callable[[npt.NDArray[Any]], Floats]] = {
    "multidiscrete": _from_choices,
    "discrete": _from_numbers,
    "continuous": _from_levels,
}
