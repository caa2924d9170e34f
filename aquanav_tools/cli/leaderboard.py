"""aquanav leaderboard: the page of all submissions, and diving one again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from aquanav_tools.errors import InputError


@dataclass(frozen=True)
class Leaderboard:
    """Make the page of all submissions in a folder, or dive one again: aquanav leaderboard verify FILE.

    aquanav-eval POLICY --benchmark aquanav-300 --submit NAME writes a submission: one file with the policy, every
    episode and the score. verify computes the score anew, dives the episodes again and compares them to the bit; on
    another kind of processor, or with other versions, within bounds that it states. Policies are read without running
    code from them.
    """

    action: Annotated[Literal["page", "verify"], tyro.conf.Positional] = "page"
    """What to do."""
    file: Annotated[Path | None, tyro.conf.Positional] = None
    """The submission to verify."""
    submissions: Path = Path("eval/leaderboard")
    """Folder of the submissions on the page."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("out/leaderboard")
    """Folder for leaderboard.html."""
    caves: int | None = None
    """Dive in so many caves only, drawn at random, to verify sooner; in all of them without it."""
    seed: int = 0
    """Of that draw."""
    workers: int | None = None
    """Processes; as many as there are cores without it."""


def run_leaderboard(options: Leaderboard) -> None:
    """Write the page, or verify a submission.

    Raises:
        InputError: no file is named, or there is no submission, or one contradicts itself.
        VerificationError: the episodes of a submission are not what its file says.
    """
    if options.action == "page":
        from aquanav_tools.benchmark.leaderboard import make_leaderboard

        print(f"Leaderboard: {make_leaderboard(options.submissions, options.output)}")
        return
    if options.file is None:
        raise InputError("Name the submission to verify: aquanav leaderboard verify FILE.")
    from aquanav_tools.api.bars import bar
    from aquanav_tools.benchmark.verify import verify

    with bar("", "cave") as show:
        found = verify(options.file, options.caves, options.workers, options.seed, show)
    print(found.text)
