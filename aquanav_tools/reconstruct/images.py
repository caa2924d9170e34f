"""The photos handed in: which there are, whether each can be read, and which camera took it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from pathlib import Path

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.intake.decode import (
    HEIC_SUFFIXES,
    SUFFIXES,
    GreyImage,
    UnusableError,
    has_alpha,
    load_heic,
    opened,
    thumbnail,
    used_size,
)
from aquanav_tools.reconstruct.intake.exif import read_shot
from aquanav_tools.reconstruct.intake.names import natural_key, order
from aquanav_tools.reconstruct.intake.options import IntakeOptions
from aquanav_tools.types import Progress, ignore_progress

MIN_PHOTOS = 3
MASKS_DIR = "masks"
"""Folder beside the photos with a mask for some or all of them: black is left out."""
MAX_NAMED = 5
"""Photos that a sentence lists by name; report.json has them all."""


@dataclass(frozen=True)
class Photo:
    """One readable image file."""

    name: str
    """File name within its folder, as its owner knows it."""
    width: int
    """Of the upright picture as it is used, px."""
    height: int
    """px."""
    focal_px: float | None
    """Focal length from the file's EXIF record, or None when it has none."""
    camera: str = ""
    """Make and model; empty when unknown."""
    is_plain: bool = True
    """The file can be used as it lies: upright, 8 bits, no transparency, not too large."""
    file: str = ""
    """Name under which it lies in the folder of its set; the same as `name` until it was prepared."""
    taken: datetime | None = None
    thumbnail: GreyImage | None = field(default=None, repr=False, compare=False)
    """(h, w) small grey copy, upright; dropped once the photos are prepared."""


@dataclass(frozen=True)
class LeftOut:
    """A file that looked like a photo but is not used."""

    name: str
    reason: str


@dataclass(frozen=True)
class PhotoSet:
    """The photos of a folder in the order they were taken."""

    folder: Path
    photos: tuple[Photo, ...]
    left_out: tuple[LeftOut, ...] = ()
    intake: IntakeOptions = field(default_factory=IntakeOptions)
    """What is known about the camera, and how contrast is treated."""
    features_dir: Path | None = None
    """Copies with equalised contrast that features are sought in; the photos themselves when None."""
    masks_dir: Path | None = None
    """Folder with a mask FILE.png for each masked photo FILE, white where it is used; None without masks."""

    @property
    def names(self) -> list[str]:
        """File names, as the owner knows them."""
        return [photo.name for photo in self.photos]

    def path(self, name: str) -> Path:
        """Return where a photo lies."""
        return self.folder / self._files[name]

    @cached_property
    def _files(self) -> dict[str, str]:
        return {photo.name: photo.file for photo in self.photos}

    def by_camera(self) -> list[list[Photo]]:
        """Return the photos grouped by camera, size and focal length: photos of one group share intrinsics."""
        groups: dict[tuple[str, int, int, float | None], list[Photo]] = {}
        for photo in self.photos:
            focal = None if photo.focal_px is None else round(photo.focal_px, 1)
            groups.setdefault((photo.camera, photo.width, photo.height, focal), []).append(photo)
        return list(groups.values())

    def without(self, left_out: Sequence[LeftOut]) -> PhotoSet:
        """Return the set with some more photos left out."""
        names = {one.name for one in left_out}
        kept = tuple(photo for photo in self.photos if photo.name not in names)
        return dataclasses.replace(self, photos=kept, left_out=(*self.left_out, *left_out))


def read_photos(folder: Path, progress: Progress = ignore_progress) -> PhotoSet:
    """Return the photos of a folder, every one decoded once to its last byte; damaged ones are left out by name.

    Raises:
        InputError: the folder is missing or has fewer than MIN_PHOTOS readable photos, or the library that opens
            its HEIC photos does.
    """
    paths = list_photos(folder)
    photos: dict[str, Photo] = {}
    left_out = []
    for index, path in enumerate(paths):
        try:
            photos[path.name] = _read_photo(path)
        except UnusableError as error:
            left_out.append(LeftOut(path.name, str(error)))
        progress(index + 1, len(paths))
    if len(photos) < MIN_PHOTOS:
        raise InputError(
            f"Only {len(photos)} of the {len(paths)} photos in {folder} can be read: {list_left_out(left_out)}. "
            f"At least {MIN_PHOTOS} are needed. Copy them from the camera again."
        )
    names = order({name: photo.taken for name, photo in photos.items()})
    return PhotoSet(folder, tuple(photos[name] for name in names), tuple(left_out))


def list_left_out(left_out: Sequence[LeftOut]) -> str:
    """Return the names, and why, of files that are not used; the first MAX_NAMED of them."""
    named = "; ".join(f"{one.name} ({one.reason})" for one in left_out[:MAX_NAMED])
    more = len(left_out) - MAX_NAMED
    return f"{named}; and {more} more" if more > 0 else named


def list_photos(folder: Path) -> list[Path]:
    """Return the image files of a folder, in the order of their names, without opening them.

    Raises:
        InputError: it is no folder or has too few, or the library that opens its HEIC photos is missing.
    """
    if not folder.is_dir():
        problem = "is a file, not a folder" if folder.exists() else "does not exist"
        raise InputError(f"The photo folder {folder} {problem}. Check the path; photos are read from one folder.")
    files = [path for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")]
    paths = sorted((p for p in files if p.suffix.lower() in SUFFIXES), key=lambda p: natural_key(p.name))
    if len(paths) < MIN_PHOTOS:
        others = sorted({path.suffix.lower() or "no suffix" for path in files} - set(SUFFIXES))
        found = f" (it also holds {len(files) - len(paths)} other files: {', '.join(others)})" if others else ""
        raise InputError(
            f"{folder} holds {len(paths)} photos{found}; at least {MIN_PHOTOS} are needed, and a cave takes 4 or more "
            "per metre. Put the photos there as JPEG, PNG, TIFF or HEIC, all in this one folder."
        )
    if any(path.suffix.lower() in HEIC_SUFFIXES for path in paths):
        load_heic()
    return paths


def _read_photo(path: Path) -> Photo:
    with opened(path) as image:
        shot = read_shot(image)
        stored, used = image.size, used_size(image.size)
        is_plain = (
            image.mode in ("L", "RGB")
            and not has_alpha(image)
            and not shot.is_turned
            and stored == used
            and path.suffix.lower() not in HEIC_SUFFIXES
        )
        small = thumbnail(image)
    focal_px = None if shot.focal_px is None else shot.focal_px * used[0] / stored[0]
    # Turned by a quarter or not: the small copy is upright.
    width, height = sorted(used, reverse=small.shape[1] >= small.shape[0])
    return Photo(path.name, width, height, focal_px, shot.camera, is_plain, path.name, shot.taken, small)
