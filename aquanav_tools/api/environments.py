"""Environments with one vehicle and with many."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from aquanav_tools.envs import factory
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.factory import AnyScenario, TaskEnv, read_any_scenario, with_vehicle
from aquanav_tools.envs.vector_env import BatchVectorEnv
from aquanav_tools.libraries import require

if TYPE_CHECKING:
    from aquanav_tools.envs.sb3_env import BatchedVecEnv

KINDS = ("gymnasium", "sb3")


def make_env(
    scenario: str | Path | AnyScenario,
    *,
    observation: str = "full",
    action: str = "multidiscrete",
    vehicle: str | None = None,
    max_decisions: int | None = None,
    **task: Any,
) -> TaskEnv:
    """Return a Gymnasium environment with one vehicle: `CaveEnv` in a cave, `SurfaceEnv` in a bay.

    Observations are float32, (44,) for "full" in a cave and (31,) for "paper"; a decision takes 0.1 s. The docstrings
    of the two classes have the tables of observations, actions, rewards and infos.

    Args:
        scenario: Folder, shipped name, or what `load_scenario` returned.
        observation: "full", "paper" or "original".
        action: "multidiscrete", "discrete" or "continuous".
        vehicle: Name or TOML file of another vehicle than the scenario's.
        max_decisions: Episode limit; None takes the scenario's.
        task: Options of the task (`aquanav_tools.task.TaskOptions`): reward="careful", current="full" or m/s,
            sensor_noise in m, action_delay in decisions and others; and render_mode and view.

    Raises:
        ScenarioError: the scenario cannot be read, or has no start.
        InputError: an option is unknown (with the nearest name) or senseless, or the vehicle does not fit.
    """
    loaded = with_vehicle(_scenario(scenario), vehicle)
    return factory.make_env(loaded, max_decisions=max_decisions, observation=observation, action=action, **task)


@overload
def make_vec_env(
    scenario: str | Path | AnyScenario | Sequence[str | Path | AnyScenario],
    num_envs: int,
    *,
    kind: Literal["gymnasium"] = ...,
    autoreset_mode: str = ...,
    seed: int = ...,
    vehicle: str | None = ...,
    num_caves: int = ...,
    cave_seed: int = ...,
    **options: Any,
) -> BatchVectorEnv: ...
@overload
def make_vec_env(
    scenario: str | Path | AnyScenario | Sequence[str | Path | AnyScenario],
    num_envs: int,
    *,
    kind: Literal["sb3"],
    autoreset_mode: str = ...,
    seed: int = ...,
    vehicle: str | None = ...,
    num_caves: int = ...,
    cave_seed: int = ...,
    **options: Any,
) -> BatchedVecEnv: ...
def make_vec_env(
    scenario: str | Path | AnyScenario | Sequence[str | Path | AnyScenario],
    num_envs: int,
    *,
    kind: Literal["gymnasium", "sb3"] = "gymnasium",
    autoreset_mode: str = "NextStep",
    seed: int = 0,
    vehicle: str | None = None,
    num_caves: int = factory.NUM_DRAWN,
    cave_seed: int = 0,
    **options: Any,
) -> BatchVectorEnv | BatchedVecEnv:
    """Return `num_envs` vehicles in one process as one vector environment, in one scenario or shared out over several.

    Observations are (num_envs, O) float32, rewards (num_envs,), infos arrays with a row per vehicle.

    Args:
        scenario: Folder, shipped name, loaded scenario, or a list of these, over which the vehicles are shared out.
            generated/mixed, or another style without a seed, stands for several caves.
        num_envs: Vehicles.
        kind: "gymnasium" for a `gymnasium.vector.VectorEnv`, "sb3" for a `VecEnv` of Stable-Baselines3.
        autoreset_mode: Of Gymnasium's: "NextStep" or "SameStep". SB3's begin the next episode in the same step.
        seed: From which SB3's kind draws its episodes; Gymnasium's takes it at `reset(seed=...)`.
        vehicle: Name or TOML file of another vehicle than the scenarios'.
        num_caves: Caves that are drawn where a scenario is a style without a seed, of those that are for training.
        cave_seed: Draws them: the same one gives the same caves.
        options: As in `make_env`: observation, action, max_decisions and the task's.

    Raises:
        ScenarioError: a scenario cannot be read, or has no start.
        LibraryError: SB3's kind is asked for, and Stable-Baselines3 is not installed.
        InputError: an option is unknown, senseless or not batched, or there are fewer vehicles than scenarios.
    """
    check_choice("kind of vector environment", kind, KINDS)
    several = factory.with_drawn(scenario, num_envs, num_caves, cave_seed)
    loaded = [with_vehicle(_scenario(one), vehicle) for one in several]
    if kind == "sb3":
        require("make_vec_env(kind='sb3')", "torch", "stable_baselines3")
        from aquanav_tools.envs.sb3_env import BatchedVecEnv

        return BatchedVecEnv(loaded, num_envs, seed=seed, **options)
    return BatchVectorEnv(num_envs, autoreset_mode, partial(factory.make_batch, loaded, **options))


def _scenario(scenario: str | Path | AnyScenario) -> AnyScenario:
    return read_any_scenario(scenario) if isinstance(scenario, str | Path) else scenario
