"""A look at all photos before hours of work: what is wrong with which, told by small copies of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.diagnosis import BLURRED_BELOW, DARK_BELOW, Caution
from aquanav_tools.reconstruct.images import MAX_NAMED, MIN_PHOTOS, LeftOut, Photo, PhotoSet, list_left_out
from aquanav_tools.reconstruct.intake.decode import GreyImage
from aquanav_tools.reconstruct.intake.exif import is_action_camera
from aquanav_tools.reconstruct.intake.likeness import REACH, find_copies, find_groups, find_still
from aquanav_tools.reconstruct.intake.refraction import describe_housing
from aquanav_tools.reconstruct.intake.sharpness import sharpness
from aquanav_tools.types import Progress, ignore_progress

CLIPPED_FROM = 250
"""Grey value from which a pixel counts as burnt out."""
MAX_CLIPPED = 0.2
"""Share of burnt-out pixels above which a photo is named."""
LINKED_SHARE = 0.5
"""Share of photos in the largest group of overlapping neighbours above which the ones outside of it are named."""
LITTLE_SHARE = 0.25
"""A largest group with less than this share speaks of gaps. In between, small copies cannot tell: of the demo's photos,
taken all around at every station, 46 % hang together in them, and nearly all register."""


@dataclass(frozen=True)
class Finding:
    """What is wrong with one photo."""

    name: str
    code: str
    value: str


@dataclass(frozen=True)
class Preflight:
    """What a first look tells."""

    photos: PhotoSet
    """Without the ones that add nothing."""
    findings: tuple[Finding, ...]
    cautions: tuple[Caution, ...]


def preflight(photos: PhotoSet, progress: Progress = ignore_progress) -> Preflight:
    """Return what is wrong with the photos of a set from `read_photos`, and the set without copies of one picture.

    Raises:
        InputError: fewer than MIN_PHOTOS different pictures are left.
    """
    photos = _without_copies(photos)
    pictures = [photo.thumbnail for photo in photos.photos if photo.thumbnail is not None]
    findings = (*_exposure(photos.photos, pictures), *_blur(photos.photos, pictures), *_still(photos.photos, pictures))
    cautions = [caution for code in _SENTENCES if (caution := _sum_up(code, findings, len(pictures)))]
    cautions += _overlap(photos.names, find_groups(pictures, progress))
    cautions += [*_left_out(photos), *_optics(photos)]
    return Preflight(photos, findings, tuple(cautions))


def _without_copies(photos: PhotoSet) -> PhotoSet:
    names = photos.names
    copies = find_copies([photo.thumbnail for photo in photos.photos if photo.thumbnail is not None])
    rest = photos.without([LeftOut(names[copy], f"the same picture as {names[original]}") for copy, original in copies])
    if len(rest.photos) < MIN_PHOTOS:
        raise InputError(
            f"The {len(names)} photos in {photos.folder} show {len(rest.photos)} different "
            f"{'picture' if len(rest.photos) == 1 else 'pictures'}: {list_left_out(rest.left_out)}. Depth needs photos "
            f"from at least {MIN_PHOTOS} places. Move the camera between photos."
        )
    return rest


def _exposure(photos: Sequence[Photo], pictures: Sequence[GreyImage]) -> list[Finding]:
    findings = []
    for photo, picture in zip(photos, pictures, strict=True):
        grey, clipped = float(picture.mean()), float((picture >= CLIPPED_FROM).mean())
        if grey < DARK_BELOW:
            findings.append(Finding(photo.name, "dark-photos", f"mean grey {grey:.0f} of 255"))
        elif clipped > MAX_CLIPPED:
            findings.append(Finding(photo.name, "burnt-photos", f"{clipped:.0%} white"))
    return findings


def _blur(photos: Sequence[Photo], pictures: Sequence[GreyImage]) -> list[Finding]:
    values = np.array([sharpness(picture) for picture in pictures])
    usual = float(np.median(values))
    return [
        Finding(photo.name, "blurred-photos", f"{value / usual:.0%} of the usual sharpness")
        for photo, value, picture in zip(photos, values, pictures, strict=True)
        if value < BLURRED_BELOW * usual and picture.mean() >= DARK_BELOW
    ]


def _still(photos: Sequence[Photo], pictures: Sequence[GreyImage]) -> list[Finding]:
    return [Finding(photos[i].name, "still-photos", f"as {photos[i - 1].name}") for i in find_still(pictures)]


_SENTENCES: dict[str, Callable[[str], str]] = {
    "dark-photos": lambda who: f"{who} too dark (mean grey below {DARK_BELOW:.0f} of 255). Add light or photos there.",
    "burnt-photos": lambda who: f"{who} burnt out in more than {MAX_CLIPPED:.0%}. Turn the lamp down or step back.",
    "blurred-photos": lambda who: f"{who} blurred beside the others. Take them again, slower or with more light.",
    "still-photos": lambda who: f"{who} nearly the same as the photo before; the camera stood still. They cost time.",
}


def _sum_up(code: str, findings: Sequence[Finding], count: int) -> Caution | None:
    found = [finding for finding in findings if finding.code == code]
    if not found:
        return None
    named = ", ".join(f"{finding.name} ({finding.value})" for finding in found[:MAX_NAMED])
    more = f" and {len(found) - MAX_NAMED} more" if len(found) > MAX_NAMED else ""
    verb = "is" if len(found) == 1 else "are"
    return Caution(code, _SENTENCES[code](f"{len(found)} of {count} photos, {named}{more}, {verb}"))


def _overlap(names: Sequence[str], groups: Sequence[Sequence[int]]) -> list[Caution]:
    """Return what small copies tell about gaps: outsiders by name where most photos hang together."""
    if len(groups) == 1:
        return []
    largest = max(groups, key=len)
    if len(largest) < max(2.0, LITTLE_SHARE * len(names)):
        message = (
            f"In small copies, neighbouring photos overlap little: the largest of {len(groups)} groups that hang "
            f"together has {len(largest)} of {len(names)} photos. They may be out of order, turned away from each "
            "other, or taken too far apart; expect gaps, and take more photos in between if you can."
        )
        return [Caution("little-overlap", message)]
    if len(largest) < LINKED_SHARE * len(names):
        return []
    outside = [group for group in groups if group is not largest]
    named = ", ".join(names[g[0]] if len(g) == 1 else f"{names[g[0]]} to {names[g[-1]]}" for g in outside[:MAX_NAMED])
    more = f" and {len(outside) - MAX_NAMED} more groups" if len(outside) > MAX_NAMED else ""
    message = (
        f"{sum(len(group) for group in outside)} of {len(names)} photos overlap with none of the {REACH} before and "
        f"after them in small copies: {named}{more}. They may be left out later; add photos that lead there."
    )
    return [Caution("gaps", message)]


def _left_out(photos: PhotoSet) -> list[Caution]:
    if not photos.left_out:
        return []
    total = len(photos.photos) + len(photos.left_out)
    message = (
        f"{len(photos.left_out)} of {total} photos are not used: {list_left_out(photos.left_out)}. "
        "Damaged ones may be whole on the camera; copy them again."
    )
    return [Caution("photos-left-out", message)]


def _optics(photos: PhotoSet) -> list[Caution]:
    cautions = []
    groups = photos.by_camera()
    for first in [group[0] for group in groups][:1]:
        sentence = describe_housing(photos.intake.housing, first.focal_px, first.width, first.height)
        if sentence:
            cautions.append(Caution("refraction", sentence))
    wide = sorted({photo.camera for photo in photos.photos if is_action_camera(photo.camera)})
    if wide and photos.intake.lens == "standard":
        message = (
            f"{', '.join(wide)} photographs as a fisheye in its wide setting, which EXIF does not tell. If it was on, "
            "run again with --lens fisheye."
        )
        cautions.append(Caution("perhaps-fisheye", message))
    return cautions
