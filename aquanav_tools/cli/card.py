"""aquanav card: what a policy is, what it scored and where it fails, on a page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Card:
    """Write the card of a policy from its file and its evaluations: aquanav card policy.zip --evaluations out/eval.

    What it observes and how it acts, its network, how long it learned, its hashes, its scores with intervals, and
    where it fails. An evaluation of another file is refused, so that a card never shows the scores of another policy.
    """

    policy: Annotated[str, tyro.conf.Positional]
    """A Stable-Baselines3 zip, or a baseline that was trained: baseline:reference."""
    evaluations: tuple[Path, ...] = ()
    """Output folders of aquanav-eval with this policy."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """File for the card, in Markdown; printed without it."""


def run_card(options: Card) -> None:
    """Print the card, or write it into a file.

    Raises:
        InputError: the policy says nothing of how it was made, or an evaluation is of another one.
    """
    from aquanav_tools.errors import InputError
    from aquanav_tools.evaluate.card import policy_card

    text = policy_card(options.policy, options.evaluations)
    if options.output is None:
        print(text, end="")
        return
    try:
        options.output.parent.mkdir(parents=True, exist_ok=True)
        options.output.write_text(text, encoding="utf-8")
    except OSError as cause:
        raise InputError(f"Cannot write the card to {options.output}: {cause}. Choose another with -o.") from cause
    print(f"Card: {options.output}")
