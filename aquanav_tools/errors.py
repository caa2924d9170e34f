"""The errors a user can meet. Each class carries the exit code its command ends with.

A message says what happened with numbers, the likely cause, and what to do next.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class AquanavError(Exception):
    """Base of every error that commands print as a sentence instead of a traceback."""

    exit_code = 1


class InputError(AquanavError):
    """What the user handed over cannot be read or makes no sense."""

    exit_code = 2


class OwnCodeError(InputError):
    """A reward, sensor, rule or the like of the user's own raised an error, or returned what is none."""

    def __init__(self, message: str, reasons: dict[int, str] | None = None) -> None:
        super().__init__(message)
        self.reasons = reasons or {}
        """Why, for each vehicle that it concerns."""


class ReconstructionError(AquanavError):
    """Photos could not be turned into cameras and points."""

    exit_code = 3

    def __init__(self, message: str, unregistered: Iterable[dict[str, str]] = ()) -> None:
        super().__init__(message)
        self.unregistered = tuple(unregistered)
        """Photos that found no place, for a table: `name`, `cause` and `sentence` of each."""


class MeshError(AquanavError):
    """A surface could not be turned into a watertight, navigable cavity."""

    exit_code = 4

    def __init__(self, message: str, places: Iterable[tuple[tuple[float, float, float], str]] = ()) -> None:
        super().__init__(message)
        self.places = tuple(places)
        """Where it went wrong, for a picture: world positions (m) and what is there."""


class UnseenWallsError(MeshError):
    """What is known of the walls may be of no cave; --accept-open goes on with it all the same."""

    def __init__(
        self, code: str, facts: str, advice: str, places: Iterable[tuple[tuple[float, float, float], str]] = ()
    ) -> None:
        super().__init__(
            f"{facts} {advice} Or go on with what there is by --accept-open: wall that nobody saw is then invented, "
            "and marked as unobserved.",
            places,
        )
        self.code, self.facts, self.advice = code, facts, advice

    @property
    def caution(self) -> tuple[str, str]:
        """Code and sentence of the warning that it becomes where it is accepted."""
        return self.code, f"{self.facts} The build went on all the same."


class ScenarioError(AquanavError):
    """A scenario folder is missing, damaged or inconsistent."""

    exit_code = 5


class ResourceError(AquanavError):
    """The work needs more memory, disk or time than there is."""

    exit_code = 6


class LibraryError(ResourceError):
    """A library that the work needs is not installed, or does not load."""


class TrainingError(AquanavError):
    """Learning came to nothing."""

    exit_code = 7


class PolicyError(AquanavError):
    """A policy could not act: it raised an error, hung, or gave what is no action."""

    exit_code = 8


FEW_NAMES = 12
"""So many are listed; of more, the nearest."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return " Did you mean 'x'?" for the closest known name, else the known names, of many the nearest three."""
    known = list(known)
    closest = difflib.get_close_matches(name, known, n=1)
    if closest:
        return f" Did you mean '{closest[0]}'?"
    if len(known) > FEW_NAMES:
        return f" The nearest of {len(known)} names: {', '.join(near_names(name, known))}."
    return f" Known: {', '.join(sorted(known))}."


def near_names(name: str, known: Iterable[str], count: int = 3) -> list[str]:
    """Return the known names that are most like a name, the most alike first; equals in the order they come in."""
    return sorted(known, key=lambda one: -difflib.SequenceMatcher(None, name, one).ratio())[:count]
