"""What can be chosen about an evaluation."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from aquanav_tools.errors import InputError
from aquanav_tools.task import TaskOptions

MAX_EPISODES = 100_000


@dataclass(frozen=True)
class EvaluateOptions(TaskOptions):
    """How a policy is evaluated. Each field is an option of aquanav-eval."""

    policy: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="POLICY")]
    """A Stable-Baselines3 zip (PPO or A2C), an ONNX file of ML-Agents, baseline:reactive or baseline:random."""
    scenario: Path
    """Scenario folder."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = field(default=Path("out/eval"))
    """Folder for results.json, report.html, pictures and recordings; an earlier evaluation in it is replaced."""
    episodes: int = 50
    """Number of episodes. All starts take their turn, in an order shuffled by the seed."""
    seed: int = 0
    """Episode i has seed + i."""
    record: Literal["all", "failures", "none"] = "all"
    """Which episodes get a rerun recording; failures are those without collision-free success."""
    max_recordings: int = 50
    """Recordings stop at this number; each takes about 1 MB."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.episodes <= MAX_EPISODES:
            raise InputError(
                f"--episodes is {self.episodes}; an evaluation has 1 to {MAX_EPISODES}. Choose a number there."
            )
        if self.seed < 0:
            raise InputError(f"--seed is {self.seed}; seeds are not negative. Choose 0 or more.")
        if self.max_recordings < 0:
            raise InputError(f"--max-recordings is {self.max_recordings}; choose 0 or more.")
