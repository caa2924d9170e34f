"""What can be chosen about an evaluation."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from aquanav_tools.errors import InputError
from aquanav_tools.task import TaskOptions

MAX_EPISODES = 100_000
MAX_CONDITIONS = 1000
Region = Literal["first third", "middle third", "last third"]


@dataclass(frozen=True)
class Grid:
    """Conditions to vary: every combination of the values given is evaluated. What has none stays as it is."""

    current: tuple[float, ...] = ()
    """Shares of the water's own speed."""
    sensor_noise: tuple[float, ...] = ()
    """Standard deviations of the error of each ray's distance, m."""
    action_delay: tuple[int, ...] = ()
    """Decisions between choosing an action and its effect."""
    region: tuple[Region, ...] = ()
    """Thirds of the route to start in, by the way to the goal; needs the scenario's own starts, of which those that
    aquanav chooses keep off the last third."""


@dataclass(frozen=True, kw_only=True)
class ProtocolOptions(TaskOptions):
    """Which episodes are run, under which rules: the table of a protocol file."""

    episodes: int = 50
    """Number of episodes per scenario and condition. All starts take their turn, in an order shuffled by the seed."""
    seed: int = 0
    """Episode i of each scenario and condition has seed + i."""
    max_decisions: int | None = None
    """Episode limit; without it, the scenario's."""
    grid: Grid = field(default_factory=Grid)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.episodes <= MAX_EPISODES:
            raise InputError(
                f"--episodes is {self.episodes}; an evaluation has 1 to {MAX_EPISODES}. Choose a number there."
            )
        if self.seed < 0:
            raise InputError(f"--seed is {self.seed}; seeds are not negative. Choose 0 or more.")
        if self.max_decisions is not None and self.max_decisions < 1:
            raise InputError(f"--max-decisions is {self.max_decisions}; choose 1 or more.")
        if self.grid.region and self.starts == "anywhere":
            raise InputError(
                "Regions choose among the scenario's own starts; leave out the regions or --starts anywhere."
            )


@dataclass(frozen=True)
class EvaluateOptions(ProtocolOptions):
    """How a policy is evaluated. Each field is an option of aquanav-eval."""

    policies: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="POLICY...")]
    """A Stable-Baselines3 zip (PPO, A2C, DQN, SAC, TD3, RecurrentPPO), an ONNX file of ML-Agents, TorchScript (.pt,
    with --trust), module:function for code of your own in the working directory, or baseline:random, baseline:reactive
    or baseline:oracle, which knows the map. "shield:" before any of them puts a safety shield around it. Several are
    taken for training runs of one method."""
    scenario: tuple[Path, ...]
    """Scenario folders."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = field(default=Path("out/eval"))
    """Folder for results.json, episodes.parquet, report.html, pictures and recordings; an earlier evaluation in it is
    replaced. Several policies get a folder each in it."""
    protocol: str | None = None
    """A protocol that aquanav ships (paper, safety, robustness, quick), or a TOML file like one; options given here
    count above it."""
    record: Literal["all", "failures", "worst", "none"] = "all"
    """Which episodes get a rerun recording; failures are those without collision-free success, worst are the
    --max-recordings worst, which are flown again."""
    max_recordings: int = 50
    """Recordings stop at this number; each takes about 1 MB."""
    trust: bool = False
    """Let policy files run code, which those of unknown make and TorchScript do when they are loaded. Only for files
    whose maker you trust; what can be read without is, all the same."""
    resume: bool = False
    """Go on with an evaluation that was stopped; its results become those of one that was not."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.policies or not self.scenario:
            raise InputError("An evaluation needs a policy and a scenario. Name both.")
        if self.max_recordings < 0:
            raise InputError(f"--max-recordings is {self.max_recordings}; choose 0 or more.")


@dataclass(frozen=True)
class CompareOptions:
    """What is compared. Each field is an option of aquanav-eval compare."""

    evaluations: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER...")]
    """Output folders of aquanav-eval; one of several policies counts as training runs of one method."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("out/compare")
    """Folder for comparison.json and report.html."""


@dataclass(frozen=True)
class ReplayOptions:
    """What is flown again. Each field is an option of aquanav-eval replay."""

    results: Annotated[Path, tyro.conf.Positional]
    """results.json of an evaluation, or its folder."""
    episode: int
    """Number of the episode, from 0."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """The recording; without it, replay-00017.rrd beside the results."""
    policy: str | None = None
    """The policy, where it is no longer at its path."""
    trust: bool = False
    """Let the policy's file run code; see aquanav-eval --help."""
    scenario: Path | None = None
    """The scenario's folder, where it is no longer at its path."""
    film: Path | None = None
    """Also write this MP4 of the episode by lamp light; about half a second per decision."""
    view: str = "chase"
    """Of the film: chase, from behind the vehicle, or onboard, from its nose."""
