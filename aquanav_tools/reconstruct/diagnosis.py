"""Why a photo found no place in the model, and what to do about it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from aquanav_tools.errors import ReconstructionError
from aquanav_tools.reconstruct.evidence import Evidence

GOOD_SHARE = 0.8
"""Registered share below which a reconstruction of a passage has gaps (measured)."""
MIN_REGISTERED = 3
DARK_BELOW = 20.0
"""Mean grey value, of 255, below which SIFT finds next to nothing."""
BLURRED_BELOW = 0.6
"""Sharpness relative to the usual: blur of 5 px in a small copy halves it (measured on real photos)."""
FEW_KEYPOINTS = 300
FEW_MATCHES = 15
"""Matches with points of the model that must agree on where a photo was taken."""
CAUSES = {
    "dark": "too dark (mean grey below 20 of 255); add light or frames there",
    "blurred": "blurred; move slower or take sharper frames there",
    "plain": f"without texture (fewer than {FEW_KEYPOINTS} keypoints); move back or light the rock from the side there",
    "unmatched": "without a neighbour that shows their rock; add photos in between, each with half of the one before",
    "stranded": "matched with each other at most, and with nothing in the model; add photos that lead there",
    "detached": "in a model of their own; build it apart, or add photos that show rock of both",
    "unseen": f"matched with too little of the model (under {FEW_MATCHES} of its points); take that rock from a second "
    "place too",
    "contradicted": "matched, but with no place that the matches agree on; mask out what moved there (divers, silt) "
    "or add photos between places that look alike",
}
MAX_RUNS = 5
"""Runs of photos that a sentence lists."""


@dataclass(frozen=True)
class Caution:
    """A result that is poor but usable."""

    code: str
    """For looking it up."""
    message: str
    """What happened with numbers, the likely cause, what to do next."""


@dataclass(frozen=True)
class Diagnosis:
    """Why one photo is not in the model."""

    name: str
    cause: str
    """A key of CAUSES."""
    sentence: str

    @property
    def row(self) -> dict[str, str]:
        """For the report's table, ready for JSON."""
        return {"name": self.name, "cause": self.cause, "sentence": self.sentence}


def diagnose(evidence: Mapping[str, Evidence], groups: Sequence[Sequence[str]]) -> tuple[Diagnosis, ...]:
    """Return the diagnosis of every photo that evidence was gathered of.

    Args:
        evidence: Of the photos that are not in the first group.
        groups: Photos of each model, the largest first.
    """
    diagnoses = []
    for name, known in evidence.items():
        own = next((group for group in groups[1:] if name in group), ())
        cause = cause_of(known, is_in_other_model=bool(own))
        diagnoses.append(Diagnosis(name, cause, f"{name}: {_told(cause, known, own)}."))
    return tuple(diagnoses)


def cause_of(known: Evidence, is_in_other_model: bool) -> str:
    """Return the key of CAUSES for a photo; how it looks counts where it shows too little of the model."""
    if is_in_other_model:
        return "detached"
    if known.points >= FEW_MATCHES:
        return "contradicted"
    if known.brightness < DARK_BELOW:
        return "dark"
    if known.sharpness < BLURRED_BELOW:
        return "blurred"
    if known.keypoints < FEW_KEYPOINTS:
        return "plain"
    if known.placed:
        return "unseen"
    return "stranded" if known.unplaced else "unmatched"


def _told(cause: str, known: Evidence, own: Sequence[str]) -> str:
    """Return what speaks for a cause, with numbers and names."""
    if cause == "dark":
        return f"mean grey {known.brightness:.0f} of 255; {_matches(known)}"
    if cause == "blurred":
        return f"{100.0 * known.sharpness:.0f} % of the usual sharpness; {_matches(known)}"
    if cause == "plain":
        return f"{known.keypoints} keypoints; {_matches(known)}"
    if cause == "detached":
        return f"in another model of {_span(own)}; {_matches(known)}"
    if cause == "unseen":
        return f"{_matches(known)}, of which {known.points} show points of the model"
    if cause == "contradicted":
        return f"{_matches(known)}; of {known.points} that show points of the model, {known.fitting} agree on a place"
    return f"{known.keypoints} keypoints; {_matches(known)}"


def _matches(known: Evidence) -> str:
    """Return whom a photo matches, the two best of them by name."""
    for others, where in ((known.placed, "in the model"), (known.unplaced, "without a place")):
        if others:
            total = sum(count for _, count in others)
            named = ", ".join(f"{count} with {name}" for name, count in others[:2])
            return f"{total} matches with {len(others)} of the photos {where} ({named})"
    return "no matches with any photo of the model"


def _span(names: Sequence[str]) -> str:
    return f"{len(names)} photos from {names[0]} to {names[-1]}"


def check_registration(
    names: Sequence[str], groups: Sequence[Sequence[str]], diagnoses: Sequence[Diagnosis], min_share: float
) -> tuple[Caution, ...]:
    """Return the cautions about a mapping that left photos out.

    Args:
        names: Of all photos, in their order.
        groups: Photos of each model, the largest first.
        diagnoses: Of those that are not in the first group.
        min_share: Of photos in the first group.

    Raises:
        ReconstructionError: fewer than MIN_REGISTERED photos, or less than `min_share` of them, are in the first group.
    """
    count = len(groups[0]) if groups else 0
    share = count / len(names)
    message = f"Only {count} of {len(names)} photos registered ({100 * share:.0f} %). {summarise(names, diagnoses)}"
    if count < MIN_REGISTERED or share < min_share:
        raise ReconstructionError(message, (one.row for one in diagnoses))
    cautions = []
    if share < GOOD_SHARE:
        cautions.append(Caution("few-registered", message))
    elif diagnoses:
        message = f"{len(diagnoses)} of {len(names)} photos did not register. {summarise(names, diagnoses)}"
        cautions.append(Caution("unregistered-photos", message))
    apart = [rest for group in groups[1:] if (rest := [name for name in group if name not in groups[0]])]
    if apart:
        cautions.append(_separate_models(groups[0], apart))
    return tuple(cautions)


def _separate_models(kept: Sequence[str], apart: Sequence[Sequence[str]]) -> Caution:
    message = (
        f"The photos fell apart into {1 + len(apart)} groups; the largest, {_span(kept)}, is used, not "
        f"{'; '.join(_span(group) for group in apart)}. They may show two places, or photos that link the groups are "
        "missing: build the groups apart, or add photos that show the rock of both."
    )
    return Caution("separate-models", message)


def summarise(names: Sequence[str], diagnoses: Sequence[Diagnosis]) -> str:
    """Return one sentence per cause, the most frequent first, with the count and the runs of photos.

    Args:
        names: Of all photos, in their order.
        diagnoses: Of some of them.
    """
    sentences = []
    for cause, count in Counter(diagnosis.cause for diagnosis in diagnoses).most_common():
        where = _runs(names, {d.name for d in diagnoses if d.cause == cause})
        verb = "is" if count == 1 else "are"
        sentences.append(f"{count} {verb} {CAUSES[cause].replace(';', f': {where};', 1)}.")
    return " ".join(sentences)


def _runs(names: Sequence[str], chosen: set[str]) -> str:
    """Return the chosen names as runs in the order of all; the first MAX_RUNS of them."""
    runs: list[list[str]] = []
    for before, name in zip(("", *names), names, strict=False):
        if name in chosen:
            if before in chosen:
                runs[-1].append(name)
            else:
                runs.append([name])
    named = ", ".join(run[0] if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs[:MAX_RUNS])
    more = sum(len(run) for run in runs[MAX_RUNS:])
    return f"{named} and {more} more" if more else named
