"""How texts speak of what a cave was made from: a scan, photos, a survey, or a made-up cave. All of it is here."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SourceWords:
    """Words that fit one kind of source."""

    name: str
    """What the surface comes from."""
    observed: str
    """Heading of the share of wall that the source shows."""
    seen: str
    """What is said of that wall."""
    filled: str
    """What is said of the other wall."""
    advice: str
    """What to do where too much of the wall is of that other kind."""
    reopen: str
    """What to do where an open end was not found."""
    north_unknown: str
    """What is known of directions where nothing says where north is."""

    @property
    def fit(self) -> str:
        """Heading of the distance between source and cavity."""
        return f"Fit to {self.name}"


_WORDS = {
    "scan": SourceWords(
        name="scan",
        observed="Seen wall",
        seen="seen by the scan",
        filled="filled in",
        advice="Scan the missing parts, or treat clearance there with care",
        reopen="check that the scan is open there, lower --min-portal, or cut it with --cut",
        north_unknown="north is not known: the scan has coordinates of its own",
    ),
    "photos": SourceWords(
        name="point cloud",
        observed="Seen wall",
        seen="seen in the photos",
        filled="filled in",
        advice="Take photos of the missing parts, or treat clearance there with care",
        reopen="take photos of that end, lower --min-portal, or cut it with --cut",
        north_unknown="north is not known: the photos do not tell it",
    ),
    "survey": SourceWords(
        name="model",
        observed="Measured wall",
        seen="measured",
        filled="modelled",
        advice="Shoot more splays, or treat clearance there with care",
        reopen="mark the station there as an entrance, lower --min-portal, or cut it with --cut",
        north_unknown="north is not known",
    ),
    "synthetic": SourceWords(
        name="made-up surface",
        observed="Known wall",
        seen="as made up",
        filled="filled in",
        advice="Make it up with other options",
        reopen="cut it with --cut",
        north_unknown="a made-up cave has no north",
    ),
}


def words_for(kind: str) -> SourceWords:
    """Return the words for a way of building (`BuiltBy.kind`); those of a scan for caves taken over as meshes."""
    return _WORDS.get(kind, _WORDS["scan"])
