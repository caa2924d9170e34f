"""The command lines of aquanav-eval: the options of the rooms below, with what tyro is to make of some of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from aquanav_tools.evaluate.options import (
    Case,
    EvaluateOptions,
    ReplayOptions,
    SequentialOptions,
    StressOptions,
    WorstOptions,
)


@dataclass(frozen=True, kw_only=True)
class EvaluateCommand(EvaluateOptions):
    """How a policy is evaluated."""

    policies: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="POLICY...")]
    """A Stable-Baselines3 zip (PPO, A2C, DQN, SAC, TD3, RecurrentPPO; one that observes a dictionary needs
    --observation and --sensors), the folder of a training run (its best.zip, or
    policy.zip where it was not validated), an ONNX file of ML-Agents, TorchScript (.pt, with --trust), module:function
    for code of your own in the working directory, or a baseline: baseline:random, baseline:reactive,
    baseline:reference, which was trained, or baseline:oracle, which knows the map. "shield:" before any of them puts a
    safety shield around it: it takes nine in ten collisions off random actions, but a good policy in strong current may
    collide more with it than without, at ten times the cost. Several are taken for training runs of one method."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("out/eval")
    """Folder for results.json, episodes.parquet, report.html, pictures and recordings; an earlier evaluation in it is
    replaced. Several policies get a folder each in it."""
    ray: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Fly on the Ray cluster at HOST:PORT (auto finds one that runs here), with the same results; --workers then counts
    its processes. This machine must be one of its nodes, and the working directory, the policy and the scenarios must
    lie at the same paths on all. Needs pip install 'aquanav[cluster]'."""
    cases: tyro.conf.Suppress[tuple[Case, ...]] = ()
    """In a protocol's file only."""


@dataclass(frozen=True, kw_only=True)
class StressCommand(StressOptions):
    """How a policy is searched for failures."""

    policy: Annotated[str, tyro.conf.Positional]
    """As aquanav-eval takes it."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("out/stress")
    """Folder for worst.toml, stress.json and report.html."""


@dataclass(frozen=True)
class CompareCommand:
    """What is compared."""

    evaluations: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER...")]
    """Output folders of aquanav-eval; one of several policies counts as training runs of one method."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("out/compare")
    """Folder for comparison.json and report.html."""
    sequential: bool = False
    """Fly two policies, named in place of folders, on the same episodes until one proves better, or neither by as much
    as matters: often with half of the episodes. Options and an example: aquanav-eval compare --sequential --help."""


@dataclass(frozen=True, kw_only=True)
class SequentialCommand(SequentialOptions):
    """How two policies are flown against each other."""

    policies: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="POLICY POLICY")]
    """Two, as aquanav-eval takes them."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("out/compare")
    """Folder for comparison.json and report.html, and a folder in it for each policy's evaluation."""
    record: tyro.conf.Suppress[Literal["all", "failures", "worst", "none"]] = "none"
    """Nothing is recorded: aquanav-eval replay flies any of the episodes again."""
    max_recordings: tyro.conf.Suppress[int] = 0
    """None."""
    film: tyro.conf.Suppress[bool] = False
    """No."""
    cases: tyro.conf.Suppress[tuple[Case, ...]] = ()
    """In a protocol's file only."""


@dataclass(frozen=True)
class ReplayCommand(ReplayOptions):
    """What is flown again."""

    results: Annotated[Path, tyro.conf.Positional]
    """results.json of an evaluation, or its folder."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """The recording; without it, replay-00017.rrd beside the results."""


@dataclass(frozen=True)
class WorstCommand(WorstOptions):
    """Which episodes are looked at."""

    results: Annotated[Path, tyro.conf.Positional]
    """results.json of an evaluation or a benchmark, or its folder."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Folder for the page, the stills and the films; without it, `worst` beside the results."""
