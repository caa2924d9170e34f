"""Learning policies."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.libraries import LEARNING, require
from aquanav_tools.train.pipeline import check_settings, read_pipeline

if TYPE_CHECKING:
    from aquanav_tools.train.training import Trained


def train(
    scenario: str | Path | AnyScenario | None = None,
    *,
    pipeline: str | Path | None = None,
    output: str | Path = "out/train",
    seed: int = 0,
    overwrite: bool = False,
    progress: bool = False,
    **settings: Any,
) -> Trained:
    """Learn a policy, lesson by lesson. A run that was stopped goes on from its last checkpoint when called again.

    Args:
        scenario: Where to learn: folder, shipped name, or what `load_scenario` returned. None takes the pipeline's.
        pipeline: What to learn: a shipped pipeline such as "paper", or a TOML file like one.
        output: Folder of the run: policies, curve, report.
        seed: Of everything random; the same seed gives the same policy on one machine.
        overwrite: Whether to begin anew where the folder holds another run.
        progress: Whether to show a bar with the time left, where stderr is a terminal.
        settings: Every other option of aquanav-train by its name: steps=300_000 (decisions), num_envs=8,
            algorithm="ppo", learning_rate=3e-4, reward="careful", validation=("cave-test-1",) and others. They count
            above the pipeline's, in all lessons.

    Returns:
        The end of the learning curve (`point`), the policy's trials (`best`, `final`; None without validation or last
        episodes) in rates from 0 to 1, and whether there was nothing left to do. `output` holds the files.

    Raises:
        InputError: a setting is unknown (with the nearest name) or senseless, or the folder holds another run.
        ScenarioError: a scenario cannot be read.
        TrainingError: learning diverged.
        LibraryError: torch or Stable-Baselines3 is not installed, or does not load.
        ResourceError: the disk is full, or a worker was killed.
        WorkerError: an environment in a worker raised an error, or took too long.
    """
    check_settings(settings, "train")
    loaded = scenario if isinstance(scenario, AnyScenario) else None
    if scenario is not None:
        settings["scenario"] = loaded.name if loaded is not None else str(scenario)
    lessons = read_pipeline(pipeline, settings)
    require("Learning a policy", *LEARNING)
    from aquanav_tools.train import training

    return training.train(lessons, seed, Path(output), scenario=loaded, overwrite=overwrite, show_progress=progress)
