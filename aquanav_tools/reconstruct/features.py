"""Keypoints and the matches between them, kept in COLMAP's database.

Both stages continue where a killed run stopped: photos with keypoints and pairs with matches are not done again. A
database therefore belongs to one photo set and one choice of options.
"""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.images import Photo, PhotoSet
from aquanav_tools.reconstruct.intake.camera import first_guess
from aquanav_tools.types import Progress, ignore_progress

_PHOTOS_AT_ONCE = 8
_PAIRS_AT_ONCE = 50


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


@dataclass(frozen=True)
class MatchOptions:
    """Which photos are compared."""

    exhaustive_up_to: int = 150
    """Compare every photo with every other one in sets up to this size; larger sets are taken as a sequence."""
    overlap: int = 10
    """In a sequence: photos compared with each one's next neighbours, and with those 2, 4, 8, ... further on."""
    seed: int = 0
    """Of the robust geometric check."""

    def __post_init__(self) -> None:
        if self.exhaustive_up_to < 0 or self.overlap < 1:
            raise ValueError(
                f"exhaustive_up_to = {self.exhaustive_up_to} must be 0 or more, overlap = {self.overlap} 1 or more."
            )


def extract_features(
    photos: PhotoSet, database: Path, options: FeatureOptions, progress: Progress = ignore_progress
) -> None:
    """Write the keypoints of all photos into the database; photos of one size and focal length share a camera."""
    database.parent.mkdir(parents=True, exist_ok=True)
    done = 0
    for group in photos.by_camera():
        camera_id = _camera_of_group(photos, group, database, options)
        for files in _chunks([photo.file for photo in group], _PHOTOS_AT_ONCE):
            _extract(photos, database, camera_id, files, options)
            done += len(files)
            progress(done, len(photos.photos))


def match_features(
    photos: PhotoSet, database: Path, options: MatchOptions, progress: Progress = ignore_progress
) -> None:
    """Match the keypoints of photo pairs and keep the matches that fit one rigid scene."""
    pairs = choose_pairs([photo.file for photo in photos.photos], options)
    left = _unmatched(database, pairs)
    done = len(pairs) - len(left)
    for chunk in _chunks(left, _PAIRS_AT_ONCE):
        _match(database, chunk, options)
        done += len(chunk)
        progress(done, len(pairs))


def choose_pairs(names: Sequence[str], options: MatchOptions) -> list[tuple[str, str]]:
    """Return the pairs of photos worth comparing: all of a small set, near and doubling distances of a long one."""
    if len(names) <= options.exhaustive_up_to:
        return list(itertools.combinations(names, 2))
    steps = set(range(1, options.overlap + 1)) | {2**power for power in range(options.overlap)}
    last = len(names)
    return [(names[i], names[i + step]) for step in sorted(steps) for i in range(last - step)]


def _camera_of_group(photos: PhotoSet, group: Sequence[Photo], database: Path, options: FeatureOptions) -> int:
    """Return the id of the camera shared by some photos; a run before may have made it."""
    pycolmap = load_pycolmap()
    first = group[0]
    guess = first_guess(first, photos.intake, options.focal_px)
    with pycolmap.Database.open(database) as store:
        for photo in group:
            if store.exists_image(photo.file):
                return int(store.read_image_with_name(photo.file).camera_id)
        camera = pycolmap.Camera.create_from_model_name(0, guess.model, guess.focal_px, first.width, first.height)
        camera.has_prior_focal_length = guess.is_known
        return int(store.write_camera(camera))


def _extract(photos: PhotoSet, database: Path, camera_id: int, files: list[str], options: FeatureOptions) -> None:
    pycolmap = load_pycolmap()
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.sift.max_num_features = options.max_features
    reader = pycolmap.ImageReaderOptions()
    reader.existing_camera_id = camera_id
    if photos.masks_dir is not None:
        reader.mask_path = photos.masks_dir
    folder = photos.features_dir or photos.folder
    with pycolmap.Database.open(database) as store:
        new = [file for file in files if not store.exists_image(file)]
    if new:  # entered in order first: the extractor's threads would number the photos in the order they finish
        pycolmap.import_images(database, folder, image_names=new, options=reader)
    pycolmap.extract_features(
        database,
        folder,
        image_names=files,
        reader_options=reader,
        extraction_options=extraction,
        device=pycolmap.Device.cpu,
    )


def _match(database: Path, pairs: list[tuple[str, str]], options: MatchOptions) -> None:
    pycolmap = load_pycolmap()
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = options.seed
    with tempfile.TemporaryDirectory() as folder:
        pairing = pycolmap.ImportedPairingOptions()
        pairing.match_list_path = Path(folder) / "pairs.txt"
        Path(pairing.match_list_path).write_text("".join(f"{a} {b}\n" for a, b in pairs))
        pycolmap.match_image_pairs(
            database, pairing_options=pairing, verification_options=verification, device=pycolmap.Device.cpu
        )


def _unmatched(database: Path, pairs: list[tuple[str, str]]) -> list[tuple[str, str]]:
    with load_pycolmap().Database.open(database) as store:
        ids = {image.name: image.image_id for image in store.read_all_images()}
        return [(a, b) for a, b in pairs if not store.exists_two_view_geometry(ids[a], ids[b])]


def _chunks(items: list[Any], size: int) -> Iterator[list[Any]]:
    return (items[start : start + size] for start in range(0, len(items), size))
