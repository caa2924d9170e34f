"""Photos as every later stage wants them: upright, in 8 bits, under names that COLMAP's lists can hold.

Files that are so already are linked, the others converted. What exists is kept, so a killed run loses one photo.
"""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np
from PIL import Image

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.images import MASKS_DIR, Photo, PhotoSet
from aquanav_tools.reconstruct.intake.decode import UnusableError, opacity, opened, upright
from aquanav_tools.reconstruct.intake.enhance import equalised
from aquanav_tools.reconstruct.intake.names import file_name
from aquanav_tools.types import BoolArray, Progress, ignore_progress

_QUALITY = 95
"""Of converted photos, as JPEG without colour subsampling: what it loses is below a sensor's noise."""


def prepare_photos(photos: PhotoSet, folder: Path, progress: Progress = ignore_progress) -> PhotoSet:
    """Return the set as it lies in a folder of the workspace, with its masks and copies of equalised contrast.

    Masks are PNG files in a folder `masks` beside the photos, called like the photo or, as in COLMAP, the photo with
    `.png` after it. Transparent parts of a photo are masked too.

    Raises:
        InputError: a mask cannot be read, or has another shape than its photo.
    """
    prepared = []
    for photo in photos.photos:
        prepared.append(_prepare(photos, photo, folder))
        progress(len(prepared), len(photos.photos))
    has_masks = (folder / "masks").is_dir()
    if has_masks:  # COLMAP wants one for every photo then
        _write_white_masks(prepared, folder / "masks")
    return dataclasses.replace(
        photos,
        folder=folder / "photos",
        photos=tuple(prepared),
        features_dir=folder / "equalised" if photos.intake.enhance == "features" else None,
        masks_dir=folder / "masks" if has_masks else None,
    )


def _write_white_masks(photos: list[Photo], folder: Path) -> None:
    for photo in photos:
        mask = folder / f"{photo.file}.png"
        if not mask.exists():
            _save(Image.new("L", (photo.width, photo.height), 255), mask)


def find_mask(folder: Path, name: str) -> Path | None:
    """Return the mask of a photo in a folder of photos; None when it has none."""
    stem = Path(name).stem
    named = [folder / MASKS_DIR / candidate for candidate in (f"{name}.png", f"{stem}.png", name)]
    return next((path for path in named if path.is_file()), None)


def _prepare(photos: PhotoSet, photo: Photo, folder: Path) -> Photo:
    enhance = photos.intake.enhance
    source = photos.path(photo.name).resolve()
    is_linked = photo.is_plain and enhance != "all"
    file = file_name(photo.name, "" if is_linked else "jpg")
    target = folder / "photos" / file
    if is_linked:
        _link(source, target)
    elif not target.exists():
        picture = _picture(source)
        _save(equalised(picture) if enhance == "all" else picture, target)
    if enhance == "features" and not (folder / "equalised" / file).exists():
        _save(equalised(_picture(source).convert("L")), folder / "equalised" / file)
    mask = folder / "masks" / f"{file}.png"
    if not mask.exists():
        _write_mask(source, photo, find_mask(photos.folder, photo.name), mask)
    return dataclasses.replace(photo, file=file, thumbnail=None)


def _link(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.is_symlink() and target.readlink() == source:
        return
    target.unlink(missing_ok=True)
    target.symlink_to(source)


def _picture(path: Path) -> Image.Image:
    with opened(path) as image:
        return upright(image)


def _save(picture: Image.Image, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    unfinished = target.with_name(target.name + ".unfinished")
    kind = "PNG" if target.suffix == ".png" else "JPEG"
    picture.save(unfinished, kind, quality=_QUALITY, subsampling=0)
    os.replace(unfinished, target)


def _write_mask(source: Path, photo: Photo, given: Path | None, target: Path) -> None:
    """Write the mask of a photo, of its size, where one was given or a part of it is transparent."""
    mask = None
    if not photo.is_plain:
        with opened(source) as image:
            mask = opacity(image)
    if given is not None:
        drawn = _read_mask(given, photo)
        mask = drawn if mask is None else mask & drawn
    if mask is not None:
        _save(Image.fromarray(np.where(mask, 255, 0).astype(np.uint8)), target)


def _read_mask(path: Path, photo: Photo) -> BoolArray:
    """Return the (H, W) flags of what a mask leaves in. It may have another size than its photo, not another shape."""
    try:
        with opened(path) as image:
            drawn = image.convert("L")
    except UnusableError as error:
        raise InputError(f"The mask {path} cannot be used: {error}. Draw it again, or remove it.") from error
    if abs(drawn.width * photo.height - drawn.height * photo.width) > photo.width + photo.height:
        raise InputError(
            f"The mask {path} is {drawn.width} x {drawn.height} px, its photo, held upright, {photo.width} x "
            f"{photo.height} px. The mask may belong to another photo. Give it the photo's shape, or remove it."
        )
    return np.asarray(drawn.resize((photo.width, photo.height), Image.Resampling.NEAREST)) > 127
