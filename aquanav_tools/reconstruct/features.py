"""Keypoints of photos (SIFT), kept in COLMAP's database; sought in copies that show all texture alike.

The stage continues where a killed run stopped: photos with keypoints are not searched again. A database therefore
belongs to one photo set and one choice of options.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.machine import free_memory, num_cores
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.earlier import NOTHING_EARLIER, Earlier
from aquanav_tools.reconstruct.images import Photo, PhotoSet
from aquanav_tools.reconstruct.intake.camera import first_guess
from aquanav_tools.reconstruct.intake.decode import opened
from aquanav_tools.reconstruct.intake.faint import brought_out
from aquanav_tools.reconstruct.intake.memory import SIFT_SIDE, sift_threads
from aquanav_tools.reconstruct.pairs import coarsest, likeness_of
from aquanav_tools.types import Progress, ignore_progress

_PHOTOS_AT_ONCE = 8
_PROBED = 8
"""Consecutive photos from the middle of the set that tell how closely photos overlap."""
_CLOSE = 30
"""Coarse keypoints shared with the second best neighbour, from which photos overlap closely: 92 in fountain-P11, 11 and
less in dives with stations (measured)."""
_PX_PER_KEYPOINT = 170.0
"""Pixels that photos are shrunk to for each keypoint wanted, where keypoints get affine shapes. COLMAP keeps the
coarsest: what it finds in more pixels, at a cost in proportion, it throws away."""

Found = dict[str, tuple[Any, Any]]
"""Keypoints and descriptors of photos, by file."""


@dataclass(frozen=True)
class FeatureOptions:
    """Keypoint extraction (SIFT)."""

    max_features: int = 4096
    """Keypoints per photo at most; below 4096 passages fall apart into separate models (measured)."""
    focal_px: float | None = None
    """Focal length of the photos in pixels when you know it; otherwise EXIF gives it, or mapping finds it."""

    def __post_init__(self) -> None:
        if self.max_features < 100:
            raise ValueError(f"max_features = {self.max_features} is below 100.")
        if self.focal_px is not None and not self.focal_px > 0:
            raise ValueError(f"focal_px = {self.focal_px} is not above 0.")


def extract_features(
    photos: PhotoSet,
    database: Path,
    options: FeatureOptions,
    progress: Progress = ignore_progress,
    earlier: Earlier = NOTHING_EARLIER,
) -> None:
    """Write the keypoints of all photos into the database; photos of one size and focal length share a camera.

    Those of photos that an earlier run knew are taken from there.
    """
    scratch = database.with_name("scratch")  # on the same disk, whose room is watched
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    is_affine: bool | None = None
    done = 0
    for number, group in enumerate(photos.by_camera(), start=1):
        camera_id = _camera_of_group(photos, group, number, database, options)
        for files in _chunks([photo.file for photo in group], _PHOTOS_AT_ONCE):
            _enter(photos, database, camera_id, files)
            left = _without_keypoints(database, files)
            if left and is_affine is None:
                is_affine = not overlap_closely(photos, options, scratch)
            known = {file: one for file, one in earlier.keypoints(left).items() if _are_affine(one[0]) == is_affine}
            new = [file for file in left if file not in known]
            _write(database, known | _search(photos, new, options, scratch, bool(is_affine)))
            done += len(files)
            progress(done, len(photos.photos))
    scratch.rmdir()


def _camera_of_group(
    photos: PhotoSet, group: Sequence[Photo], number: int, database: Path, options: FeatureOptions
) -> int:
    """Return the id of the camera shared by the photos of a group, its number; a run before may have made it."""
    pycolmap = load_pycolmap()
    first = group[0]
    guess = first_guess(first, photos.intake, options.focal_px)
    with pycolmap.Database.open(database) as store:
        if store.exists_camera(number):
            return number
        camera = pycolmap.Camera.create_from_model_name(0, guess.model, guess.focal_px, first.width, first.height)
        camera.has_prior_focal_length = guess.is_known
        return int(store.write_camera(camera))


def _enter(photos: PhotoSet, database: Path, camera_id: int, files: list[str]) -> None:
    """Enter photos in their order: it gives them their ids."""
    pycolmap = load_pycolmap()
    reader = pycolmap.ImageReaderOptions()
    reader.existing_camera_id = camera_id
    with pycolmap.Database.open(database) as store:
        new = [file for file in files if not store.exists_image(file)]
    if new:
        pycolmap.import_images(database, photos.folder, image_names=new, options=reader)


def _without_keypoints(database: Path, files: list[str]) -> list[str]:
    with load_pycolmap().Database.open(database) as store:
        return [file for file in files if not store.exists_descriptors(store.read_image_with_name(file).image_id)]


def overlap_closely(photos: PhotoSet, options: FeatureOptions, scratch: Path) -> bool:
    """Return whether photos show their rock from so near each other that keypoints need no affine shape.

    That finds more of what is seen at a slant, but places it less exactly: on fountain-P11 camera centres are off by
    2.9 mm with it and 2.2 mm without. On a dive with stations 1.5 m apart it verifies 24 of 26 pairs, without 21.

    Args:
        photos: Eight from the middle of the sequence are looked at.
        options: For the search.
        scratch: Folder for copies.
    """
    middle = len(photos.photos) // 2
    files = [photo.file for photo in photos.photos[max(middle - _PROBED // 2, 0) : middle + _PROBED // 2]]
    found = _search(photos, files, options, scratch, is_affine=False)
    likeness = np.sort(likeness_of([coarsest(*found[file]) for file in files]), axis=1)
    return float(np.median(likeness[:, -2])) >= _CLOSE


def _search(photos: PhotoSet, files: list[str], options: FeatureOptions, scratch: Path, is_affine: bool) -> Found:
    """Return what photos show, with their texture brought out."""
    if not files:
        return {}
    with tempfile.TemporaryDirectory(dir=scratch) as folder:
        _bring_out(photos.features_dir or photos.folder, files, Path(folder))
        return _sift(Path(folder), files, photos.masks_dir, options.max_features, scratch, is_affine)


def _bring_out(source: Path, files: list[str], target: Path) -> None:
    import cv2

    def bring_out(file: str) -> None:
        grey = np.asarray(cv2.imread(str(source / file), cv2.IMREAD_GRAYSCALE), np.uint8)
        is_jpeg = Path(file).suffix.lower() in (".jpg", ".jpeg")  # PNG and TIFF know no such setting
        cv2.imwrite(str(target / file), brought_out(grey), [cv2.IMWRITE_JPEG_QUALITY, 100] if is_jpeg else [])

    with ThreadPoolExecutor(num_cores()) as threads:
        list(threads.map(bring_out, files))


def _sift(
    folder: Path, files: list[str], masks_dir: Path | None, max_features: int, scratch: Path, is_affine: bool
) -> Found:
    """Return the keypoints of photos, by way of a database of their own."""
    pycolmap = load_pycolmap()
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.num_threads = sift_threads([_size(folder / file) for file in files], free_memory())
    extraction.sift.max_num_features = max_features
    extraction.sift.first_octave = 0  # not -1, of doubled pixels: noise was averaged, and nothing finer is left
    extraction.sift.estimate_affine_shape = is_affine
    if is_affine:
        extraction.max_image_size = _side(*_size(folder / files[0]), max_features)  # all of a camera have one size
    reader = pycolmap.ImageReaderOptions()
    if masks_dir is not None:
        reader.mask_path = masks_dir
    with tempfile.TemporaryDirectory(dir=scratch) as own:
        database = Path(own) / "found.db"
        pycolmap.extract_features(
            database,
            folder,
            image_names=files,
            reader_options=reader,
            extraction_options=extraction,
            device=pycolmap.Device.cpu,
        )
        with pycolmap.Database.open(database) as store:
            ids = {image.name: image.image_id for image in store.read_all_images()}
            return {file: (store.read_keypoints(ids[file]), store.read_descriptors(ids[file])) for file in files}


def _side(width: int, height: int, max_features: int) -> int:
    """Return the longer side of a photo, px, that holds as many keypoints as are wanted."""
    shrink = np.sqrt(_PX_PER_KEYPOINT * max_features / (width * height))
    return int(min(max(width, height) * min(shrink, 1.0), SIFT_SIDE))


def _size(path: Path) -> tuple[int, int]:
    with opened(path) as image:
        return image.size


def _are_affine(keypoints: Any) -> bool:
    """Return whether any of (K, 6) keypoints has an affine shape, not just a size and a direction."""
    x_from_u, x_from_v, y_from_u, y_from_v = np.asarray(keypoints)[:, 2:].T
    return not (np.allclose(x_from_u, y_from_v, rtol=1e-3) and np.allclose(x_from_v, -y_from_u, rtol=1e-3))


def _write(database: Path, found: Found) -> None:
    """Write keypoints, then descriptors: those mark a photo as done."""
    pycolmap = load_pycolmap()
    with pycolmap.Database.open(database) as store:
        for file, (keypoints, descriptors) in found.items():
            image_id = store.read_image_with_name(file).image_id
            with pycolmap.DatabaseTransaction(store):
                store.write_keypoints(image_id, keypoints)
                store.write_descriptors(image_id, descriptors)


def _chunks(items: list[Any], size: int) -> Iterator[list[Any]]:
    return (items[start : start + size] for start in range(0, len(items), size))
