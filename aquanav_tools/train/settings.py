"""What a training run is made of. Light to import: the command line reads it before anything else."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from aquanav_tools.task import TaskOptions


@dataclass(frozen=True)
class TrainSettings(TaskOptions):
    """PPO on one scenario. The defaults are the original benchmark's first lesson, with fewer steps."""

    steps: int = 300_000
    """Decisions to learn from, over all environments."""
    observation: Literal["paper", "full", "original"] = "full"
    """What the agent sees: the paper's 31 values, those and the vehicle's own motion, or the 120 of the original's
    code."""
    action: Literal["multidiscrete", "discrete", "continuous"] = "multidiscrete"
    """Form of the action."""
    reward: Literal["dense", "safe", "sparse"] = field(default="safe", kw_only=True)
    """What is paid for: progress; progress away from walls; the outcome alone."""
    num_envs: int = 8
    """Environments that take turns in one process."""
    hidden: tuple[int, ...] = (128, 128, 128)
    """Widths of the hidden layers, for the policy and for the value."""
    learning_rate: float = 3e-4
    """At the start; it falls to zero in a straight line."""
    clip: float = 0.2
    """PPO's clip range."""
    buffer: int = 20_480
    """Decisions collected before each update, over all environments."""
    batch: int = 1024
    """Decisions per gradient step."""
    epochs: int = 5
    """Passes over the buffer per update."""
    discount: float = 0.99
    """Gamma."""
    trace: float = 0.95
    """Lambda of the generalised advantage estimate."""
    entropy: float = 0.005
    """Weight of the entropy bonus."""
    checkpoint_every: int = 50_000
    """The policy is written after the first buffer beyond each multiple of these decisions, and at the end."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("steps", "num_envs", "buffer", "batch", "epochs", "checkpoint_every", "learning_rate", "clip"):
            _check(getattr(self, name) > 0, f"{name} must be positive, got {getattr(self, name)}.")
        for name in ("discount", "trace"):
            _check(0.0 <= getattr(self, name) <= 1.0, f"{name} must be in [0, 1], got {getattr(self, name)}.")
        _check(math.isfinite(self.entropy) and self.entropy >= 0, f"entropy must not be negative, got {self.entropy}.")
        _check(bool(self.hidden) and min(self.hidden) > 0, f"hidden must list positive widths, got {self.hidden}.")
        for name in ("num_envs", "batch"):
            _check(
                self.buffer % getattr(self, name) == 0,
                f"buffer ({self.buffer}) must be a multiple of {name} ({getattr(self, name)}).",
            )


def _check(is_right: bool, message: str) -> None:
    if not is_right:
        raise ValueError(message)
