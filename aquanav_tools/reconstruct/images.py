"""The photos handed in: which there are, whether each can be read, and the focal length it claims."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from aquanav_tools.errors import InputError
from aquanav_tools.types import Progress, ignore_progress

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
MIN_PHOTOS = 3
FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
"""Diagonal of 35 mm film: equivalent focal lengths refer to it (CIPA DCG-001)."""
EXIF_IFD = 0x8769
FOCAL_LENGTH_TAG = 0x920A
FOCAL_LENGTH_35MM_TAG = 0xA405


@dataclass(frozen=True)
class Photo:
    """One readable image file."""

    name: str
    """File name within its folder."""
    width: int
    """px."""
    height: int
    """px."""
    focal_px: float | None
    """Focal length from the file's EXIF record, or None when it has none."""


@dataclass(frozen=True)
class PhotoSet:
    """The photos of a folder, in natural order of their names."""

    folder: Path
    photos: tuple[Photo, ...]

    @property
    def names(self) -> list[str]:
        """File names."""
        return [photo.name for photo in self.photos]

    def path(self, name: str) -> Path:
        """Return where a photo lies."""
        return self.folder / name

    def by_camera(self) -> list[list[Photo]]:
        """Return the photos grouped by size and focal length: photos of one group share a camera."""
        groups: dict[tuple[int, int, float | None], list[Photo]] = {}
        for photo in self.photos:
            focal = None if photo.focal_px is None else round(photo.focal_px, 1)
            groups.setdefault((photo.width, photo.height, focal), []).append(photo)
        return list(groups.values())


def read_photos(folder: Path, progress: Progress = ignore_progress) -> PhotoSet:
    """Return the photos of a folder, every one decoded once to prove that it can be.

    Raises:
        InputError: the folder is missing or has fewer than MIN_PHOTOS photos, or a photo is damaged (it is named).
    """
    paths = _list_photos(folder)
    photos = []
    for index, path in enumerate(paths):
        photos.append(_read_photo(path))
        progress(index + 1, len(paths))
    return PhotoSet(folder, tuple(photos))


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Return a sort key that puts photo2 before photo10."""
    parts = re.findall(r"\d+|\D+", name.lower())
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]


def _list_photos(folder: Path) -> list[Path]:
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
            "per metre. Put the photos there as JPEG, PNG or TIFF, all in this one folder."
        )
    spaced = [path.name for path in paths if len(path.name.split()) > 1]
    if spaced:
        raise InputError(
            f"{len(spaced)} photo names in {folder} hold spaces, the first is '{spaced[0]}'; COLMAP's lists of photo "
            "pairs end a name there. Rename them, for instance with: rename 's/ /_/g' *"
        )
    return paths


def _read_photo(path: Path) -> Photo:
    try:
        with Image.open(path) as image:
            width, height = image.size
            focal_px = _focal_px(image)
            image.draft("L", (width // 8, height // 8))  # a JPEG is then decoded at an eighth, yet to its last byte
            image.load()
    except (OSError, SyntaxError, ValueError) as error:  # what Pillow raises for damaged files
        raise InputError(
            f"The photo {path} cannot be read: {error}. The file is damaged or its copy was cut short. "
            "Copy it from the camera again, or remove it from the folder."
        ) from error
    return Photo(path.name, width, height, focal_px)


def _focal_px(image: Image.Image) -> float | None:
    """Return the focal length in pixels from the equivalent on 35 mm film, which phones and cameras record."""
    equivalent_mm = image.getexif().get_ifd(EXIF_IFD).get(FOCAL_LENGTH_35MM_TAG)
    if not equivalent_mm or equivalent_mm <= 0:
        return None
    return float(equivalent_mm) * math.hypot(*image.size) / FILM_DIAGONAL_MM
