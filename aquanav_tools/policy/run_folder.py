"""The policies in the folder of a training run: training writes them, evaluation looks for the best."""

from __future__ import annotations

from pathlib import Path

from aquanav_tools.errors import InputError
from aquanav_tools.text_files import read_json

POLICY_FILE, BEST_FILE = "policy.zip", "best.zip"
KINDS = {
    BEST_FILE: "the best in its validation scenarios",
    POLICY_FILE: "the last one; a best one is kept where aquanav-train has --validation",
}
"""What each is, the better first."""


def observed_in(folder: Path) -> str:
    """Return, in the words of options, what a training run's folder says that its policy observes; "" of no run."""
    try:
        lesson = read_json(folder / "train.json")["lessons"][-1]
        sensors = [str(name) for name in lesson.get("sensors", ())]
        history = [str(ago) for ago in lesson.get("history", ())]
        words = [f"--observation {lesson['observation']}", *(["--sensors", *sensors] if sensors else [])]
        words += ["--history", *history] if history else []
    except (InputError, LookupError, TypeError, AttributeError):
        return ""
    return f" {folder} says that it was trained with {' '.join(words)}."


def best_policy(folder: Path) -> Path:
    """Return the best policy in the folder of a training run.

    Raises:
        InputError: the folder holds none.
    """
    for name in KINDS:
        if (folder / name).is_file():
            return folder / name
    if (folder / "results.json").is_file():
        raise InputError(
            f"{folder} is the output of an evaluation, and no policy. To compare it with others, run "
            f"aquanav-eval compare {folder} OTHER; to evaluate, name the policy or the folder of its training run."
        )
    raise InputError(
        f"{folder} is a folder without {' or '.join(KINDS)}: no training run, or one that has written no policy yet. "
        "Name the folder after aquanav-train's -o, or a policy's file."
    )
