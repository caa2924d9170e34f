"""The command aquanav-train: learn a policy in a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from aquanav_tools.cli.command import file_after, run_command
from aquanav_tools.tables import from_table, read_toml
from aquanav_tools.train.settings import TrainSettings

DESCRIPTION = """Learn a policy in a scenario with PPO (Stable-Baselines3).

Writes policy.zip, train.json (settings, versions, learning curve) and curve.csv; aquanav-eval scores the policy."""


@dataclass(frozen=True)
class TrainOptions:
    """The command line."""

    scenario: Path
    """Scenario folder, as aquanav-build-cave wrote it."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("out/train")
    """Folder for the results; files of an earlier run there are replaced."""
    seed: int = 0
    """Of everything random."""
    pipeline: Path | None = None
    """TOML file with other values for the settings below, for example pipelines/train/quick.toml."""
    settings: tyro.conf.OmitArgPrefixes[TrainSettings] = field(default_factory=TrainSettings)
    """How to learn."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    run_command(TrainOptions, _run, "aquanav-train", DESCRIPTION, defaults=_read_defaults, arguments=arguments)


def _read_defaults(arguments: Sequence[str]) -> TrainOptions | None:
    """Return the options with the settings of the file after --pipeline; None without one."""
    path = file_after("--pipeline", arguments)
    if path is None:
        return None
    return TrainOptions(scenario=tyro.MISSING, settings=from_table(TrainSettings, read_toml(path), path.name))


def _run(options: TrainOptions) -> None:
    from aquanav_tools.scenario.folder import read_scenario

    scenario = read_scenario(options.scenario)
    from aquanav_tools.train.ppo import train

    point = train(scenario, options.settings, options.seed, options.output, show_progress=True)
    print(
        f"Learned from {point.steps} decisions in {point.seconds:.0f} s: {point.success_rate:.0%} of the last episodes "
        f"reached the goal, {point.clean_success_rate:.0%} without a collision, {point.mean_collisions:.1f} collisions "
        f"per episode.\nScore it: aquanav-eval {options.output / 'policy.zip'} --scenario {options.scenario}"
    )
