"""Diving a submission's episodes again, to see whether they are what its file says.

On a processor of the same kind, with the same versions, episodes repeat to the bit. Elsewhere kernels may round
otherwise, so that some dives part; then the whole is held against bounds.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.benchmark.options import BenchmarkOptions
from aquanav_tools.benchmark.run import run_caves
from aquanav_tools.benchmark.submission import (
    Submission,
    benchmark_of,
    policy_file,
    processor,
    read_submission,
)
from aquanav_tools.errors import AquanavError
from aquanav_tools.evaluate.results import versions
from aquanav_tools.types import Progress

MAX_PARTED = 0.02
"""Fraction of the dives that may end otherwise on another kind of machine: chosen."""
MAX_SHIFT = 0.01
"""By which the mean over caves may differ there: chosen."""


class VerificationError(AquanavError):
    """A submission's episodes are not what its file says."""


@dataclass(frozen=True)
class Verified:
    """A submission that holds."""

    submission: Submission
    caves: int
    """Dived again."""
    episodes: int
    identical: int
    """Of these, to the bit."""
    shift: float
    """Of collision-free success, mean over these caves, from what the file says."""

    @property
    def text(self) -> str:
        """What is said of it."""
        found = f"{self.identical} of {self.episodes} dives in {self.caves} caves repeat to the bit"
        if self.identical == self.episodes:
            return f"{self.submission.name} holds: {found}."
        return (
            f"{self.submission.name} holds within the bounds for another kind of machine: {found}; the mean over caves "
            f"differs by {100.0 * self.shift:+.2f} points (bound {100.0 * MAX_SHIFT:g}). It was made on "
            f"{self.submission.processor}, and dived again on {processor()}."
        )


def verify(path: Path, caves: int | None, workers: int | None, seed: int, progress: Progress) -> Verified:
    """Dive a submission's episodes again and hold them against its file.

    Args:
        path: Of the submission.
        caves: How many of its caves, drawn at random by `seed`; None for all of them.
        workers: Processes; None for one for each core.
        seed: Of that draw.
        progress: Told how many caves are done.

    Raises:
        InputError: it is no submission, or contradicts itself.
        VerificationError: the episodes are not what it says.
    """
    submission = read_submission(path)
    whole = benchmark_of(submission, path)
    num = len(whole.caves) if caves is None else min(max(caves, 1), len(whole.caves))
    chosen = sorted(np.random.default_rng(seed).permutation(len(whole.caves))[:num].tolist())
    with policy_file(submission.policy) as spec, tempfile.TemporaryDirectory() as folder:
        options = BenchmarkOptions(
            policy=spec,
            benchmark=submission.benchmark,
            output=Path(folder),
            observation=submission.policy.observation,
            backend=submission.backend,  # type: ignore[arg-type]  # read as a text
            workers=workers,
        )
        rows = run_caves(options, whole, chosen, progress)
    return _compared(path, submission, rows)


def _compared(path: Path, submission: Submission, rows: list[dict[str, Any]]) -> Verified:
    told = {episode.index: episode for episode in submission.episodes}
    pairs = [(told[found["index"]], found) for row in rows for found in row["metrics"]]
    identical = sum(one.digest == found["digest"] for one, found in pairs)
    clean = np.array(
        [
            (one.is_collision_free_success, found["outcome"] == "success" and found["collisions"] == 0)
            for one, found in pairs
        ]
    )
    shift, parted = float(np.diff(clean.mean(axis=0))[0]), float((clean[:, 0] != clean[:, 1]).mean())
    verified = Verified(submission, len(rows), len(pairs), identical, shift)
    is_same_machine = submission.processor == processor() and dict(submission.versions) == versions()
    is_bound = abs(shift) <= MAX_SHIFT and parted <= MAX_PARTED
    if identical == len(pairs) or (is_bound and not is_same_machine):
        return verified
    first = next(one for one, found in pairs if one.digest != found["digest"])
    raise VerificationError(
        f"{path} does not hold: {identical} of {len(pairs)} dives repeat to the bit, {100 * parted:.1f} % end "
        f"otherwise, and the mean over caves differs by {100 * shift:+.1f} points. The first that differs is episode "
        f"{first.index} in {first.scenario}. "
        + (
            "Versions and processor are the same, so the file is not what was dived."
            if is_same_machine
            else f"It was made on {submission.processor}; the bounds for another machine are {100 * MAX_PARTED:g} % "
            f"and {100 * MAX_SHIFT:g} points."
        )
    )
