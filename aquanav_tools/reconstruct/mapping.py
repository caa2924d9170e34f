"""Camera poses and sparse points from matches: placed one after the other and, where that stops early, at once."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.reconstruct.at_once import map_at_once
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.diagnosis import Caution, Diagnosis, check_registration, diagnose
from aquanav_tools.reconstruct.evidence import gather_evidence
from aquanav_tools.reconstruct.growth import keep_order, note_at_once, read_order, was_at_once
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.intake.names import name_of, natural_key
from aquanav_tools.reconstruct.joining import join
from aquanav_tools.reconstruct.misplaced import misplaced_photos
from aquanav_tools.reconstruct.refinement import TOLERANCE, refined_optical_centres
from aquanav_tools.types import Array, Progress, ignore_progress

_SNAPSHOTS_FROM = 300
"""Photos from which snapshots are kept. Smaller sets take minutes, and a run that begins again ends the same."""
_SNAPSHOT_PHOTOS = 50
"""Placed between two snapshots: a killed run loses two of them at most."""
_GROWTH = 1.3
"""All cameras are adjusted together whenever the model has grown by this factor. With COLMAP's 1.1, three rendered sets
of 85 to 120 photos took half as long again; mean errors were the same to 0.1 mm."""
_LOCAL_ROUNDS = 1
"""Adjustments of the cameras around each new one; COLMAP's second takes a quarter of the whole time and changes nothing
(six rendered sets: the same photos registered, mean errors the same to 0.1 mm or, turbid, 0.4 mm smaller)."""
_LENIENT = ((15, 0.15), (8, 0.8))
"""Matches that a photo left over needs with the model, and the share of them that must agree on its pose: first more,
then fewer that nearly all agree. While the model grows 30 are needed, where a wrong camera would mislead others."""
_MIN_GAIN = 0.05
"""Share of the photos that placing all at once must add: cameras are then off by half as much again (measured)."""
_LENIENT_TRIALS = 10
"""To place it, as the model grows."""


@dataclass(frozen=True)
class MappingOptions:
    """Structure from motion."""

    seed: int = 0
    """Of its random choices; the same seed gives the same cameras."""
    min_share: float = 0.3
    """Stop below this share of registered photos; a warning is given below 0.8."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.min_share <= 1.0:
            raise ValueError(f"min_share = {self.min_share} is outside [0, 1].")


@dataclass(frozen=True, eq=False)
class SparseModel:
    """The largest set of cameras that hang together, in the arbitrary scale and axes of frame `sfm`."""

    model: Any
    """pycolmap.Reconstruction."""
    diagnoses: tuple[Diagnosis, ...] = ()
    """One for every photo that is not in the model."""
    cautions: tuple[Caution, ...] = ()
    order: tuple[str, ...] = ()
    """Registered photos in the order they were placed in; empty where that was not kept, or there was none."""
    is_at_once: bool = False
    """Whether photos were placed all at once (global mapping), not one after the other (incremental)."""

    @property
    def names(self) -> list[str]:
        """Registered photos, in the order of their ids."""
        return [name_of(image.name) for image in self._images()]

    @property
    def centres(self) -> Array:
        """(N, 3) camera centres of the registered photos."""
        return np.array([image.projection_center() for image in self._images()])

    @property
    def rotations(self) -> Array:
        """(N, 3, 3) `cam_from_world` rotations of the registered photos."""
        return np.array([image.cam_from_world().rotation.matrix() for image in self._images()])

    def _images(self) -> list[Any]:
        return [self.model.images[image_id] for image_id in sorted(self.model.reg_image_ids())]


def map_photos(
    photos: PhotoSet, database: Path, folder: Path, options: MappingOptions, progress: Progress = ignore_progress
) -> SparseModel:
    """Return the largest model; all models are kept in `folder`, from where a second call takes them.

    A killed call begins again, to the same cameras. From 300 photos on it goes on from a snapshot, not from the same
    random numbers: cameras may then differ by as much as they do between seeds.

    Raises:
        ReconstructionError: fewer than 3 photos or less than `min_share` of them register; the message counts causes.
    """
    if not folder.is_dir():
        _fill(photos, database, folder, options, progress)
    paths = _by_size(folder)
    models = [load_pycolmap().Reconstruction(path) for path in paths]
    groups = [
        sorted((name_of(model.image(i).name) for i in model.reg_image_ids()), key=natural_key) for model in models
    ]
    diagnoses = diagnose(gather_evidence(photos, database, models, 3.0 * _tolerance_px(photos)), groups)
    cautions = check_registration(photos.names, groups, diagnoses, options.min_share)
    order = tuple(name_of(file) for file in read_order(paths[0]))
    return SparseModel(models[0], diagnoses, cautions, order, was_at_once(paths[0]))


def _fill(photos: PhotoSet, database: Path, folder: Path, options: MappingOptions, progress: Progress) -> None:
    """Write the models: those of the mapper, then the largest with others joined and what fewer matches can add."""
    mapped, snapshots = folder.with_name(folder.name + ".unfinished"), folder.with_name(folder.name + ".snapshots")
    shutil.rmtree(mapped, ignore_errors=True)
    mapped.mkdir(parents=True)
    snapshots.mkdir(exist_ok=True)
    pipeline = _pipeline(photos, options)
    if len(photos.photos) >= _SNAPSHOTS_FROM:
        pipeline.snapshot_path, pipeline.snapshot_frames_freq = snapshots, _SNAPSHOT_PHOTOS
    run_mapper(photos, database, mapped, pipeline, last_snapshot(snapshots), progress)
    models = _by_size(mapped)
    if models:
        _take_out_misplaced(models[0], photos, database)
        _complete(models, mapped / "completed", photos, database, options)
    is_at_once = _place_at_once(models, mapped, photos, database, options)
    if models:
        _refine(models[0])
        if is_at_once:
            note_at_once(models[0])
    mapped.rename(folder)
    shutil.rmtree(snapshots)


def _complete(models: list[Path], scratch: Path, photos: PhotoSet, database: Path, options: MappingOptions) -> None:
    """Join the first model on disk with others, and place what fewer matches can, where photos are left over."""
    if _size(models[0])[0] == len(photos.photos):
        return
    join_models(models, photos, database, _pipeline(photos, options))
    matched = _num_matched(database)
    for least, share in _LENIENT:
        if _size(models[0])[0] < matched:
            pipeline = _lenient(_pipeline(photos, options), least, share)
            scratch.mkdir()
            run_mapper(photos, database, scratch, pipeline, models[0], ignore_progress)
            _replace_if_larger(models[0], scratch)
            _take_out_misplaced(models[0], photos, database)


def _place_at_once(models: list[Path], mapped: Path, photos: PhotoSet, database: Path, options: MappingOptions) -> bool:
    """Map all matched photos at once where some are left over, and go on with that where it places more of them.

    Args:
        models: In `mapped`; their first is replaced, or made.
        mapped: Folder of all models.
        photos: Of the database.
        database: With their verified matches.
        options: Of the mapping.

    Returns:
        Whether the first model is now one of photos placed at once.
    """
    wanted = (_size(models[0])[0] if models else 0) + _MIN_GAIN * len(photos.photos)
    if _num_matched(database) < wanted:
        return False
    found = map_at_once(database, photos.folder, mapped / "at-once", _tolerance_px(photos), options.seed)
    if found is None or found.num_reg_images() < wanted:
        return False
    if not models:
        models.append(mapped / "0")
    shutil.rmtree(models[0], ignore_errors=True)
    models[0].mkdir()
    found.write(models[0])
    _complete(models, mapped / "completed", photos, database, options)
    return True


def _num_matched(database: Path) -> int:
    """Return how many photos have verified matches with any other."""
    pycolmap = load_pycolmap()
    with pycolmap.Database.open(database) as store:
        pair_ids, counts = store.read_two_view_geometry_num_inliers()
    pairs = [pycolmap.pair_id_to_image_pair(one) for one, count in zip(pair_ids, counts, strict=True) if count > 0]
    return len({image_id for pair in pairs for image_id in pair})


def _take_out_misplaced(path: Path, photos: PhotoSet, database: Path) -> None:
    """Take photos that contradict their own matches out of a model on disk."""
    model = load_pycolmap().Reconstruction(path)
    misplaced = misplaced_photos(model, database, _tolerance_px(photos))
    for image_id in misplaced:
        model.deregister_frame(model.images[image_id].frame_id)
    if misplaced:
        model.write(path)
        keep_order({int(path.name): model}, path.parent, path)


def join_models(paths: list[Path], photos: PhotoSet, database: Path, pipeline: Any) -> None:
    """Write the first model on disk joined with those of the others that can be, and remove these."""
    kept = load_pycolmap().Reconstruction(paths[0])
    for path in paths[1:]:
        other = load_pycolmap().Reconstruction(path)
        joined = join(kept, other, database, photos.folder, pipeline)
        if joined is None or joined.num_reg_images() < kept.num_reg_images():
            continue
        kept = joined
        kept.write(paths[0])
        keep_order({int(paths[0].name): kept}, paths[0].parent, paths[0])
        shutil.rmtree(path)


def last_snapshot(folder: Path) -> Path | None:
    """Return the snapshot to go on from: the last but one, for the last may be half written."""
    snapshots = sorted(path for path in folder.iterdir() if path.is_dir())
    return snapshots[-2] if len(snapshots) > 1 else None


def _refine(path: Path) -> None:
    """Give the cameras of a model on disk their optical centres."""
    refined = refined_optical_centres(load_pycolmap().Reconstruction(path))
    if refined is not None:
        refined.write(path)


def _replace_if_larger(model: Path, folder: Path) -> None:
    """Put the largest model of a folder in the place of another one, where it has more photos; remove the rest."""
    largest = max((path for path in folder.iterdir() if path.is_dir()), key=_size, default=model)
    if _size(largest) > _size(model):
        shutil.rmtree(model)
        largest.rename(model)
    shutil.rmtree(folder)


def _pipeline(photos: PhotoSet, options: MappingOptions) -> Any:
    """Return pycolmap's options."""
    pipeline = load_pycolmap().IncrementalPipelineOptions()
    pipeline.min_model_size = 3
    pipeline.num_threads = 1  # with more, sums are added in another order every time
    pipeline.ba_global_frames_ratio = pipeline.ba_global_points_ratio = _GROWTH
    pipeline.ba_global_function_tolerance = TOLERANCE
    pipeline.ba_local_max_refinements = _LOCAL_ROUNDS
    for part in (pipeline, pipeline.mapper, pipeline.triangulation):
        part.random_seed = options.seed
    tolerance = _tolerance_px(photos)
    pipeline.mapper.init_max_error = pipeline.mapper.filter_max_reproj_error = tolerance
    pipeline.mapper.abs_pose_max_error = 3.0 * tolerance
    pipeline.triangulation.merge_max_reproj_error = pipeline.triangulation.complete_max_reproj_error = tolerance
    return pipeline


def _lenient(pipeline: Any, least: int, share: float) -> Any:
    """Return options that place photos on other numbers of matches, in one model that is there already."""
    pipeline.multiple_models = False
    pipeline.mapper.abs_pose_min_num_inliers = least
    pipeline.mapper.abs_pose_min_inlier_ratio = share
    pipeline.mapper.max_reg_trials = _LENIENT_TRIALS
    return pipeline


def run_mapper(
    photos: PhotoSet, database: Path, folder: Path, pipeline: Any, start: Path | None, progress: Progress
) -> None:
    """Write models to `folder`, which is there and empty, each into a folder called by its number.

    Args:
        photos: Of the database.
        database: With their verified matches.
        folder: For the models.
        pipeline: pycolmap.IncrementalPipelineOptions.
        start: Model to go on with.
        progress: Called for every photo placed.
    """
    pycolmap = load_pycolmap()
    pycolmap.set_random_seed(pipeline.random_seed)
    total, done = len(photos.photos), 0

    def report() -> None:
        nonlocal done
        done = min(done + 1, total)  # a photo may be tried in more than one model
        progress(done, total)

    models = pycolmap.incremental_mapping(
        database,
        photos.folder,
        folder,
        options=pipeline,
        input_path="" if start is None else start,
        initial_image_pair_callback=report,
        next_image_callback=report,
    )
    for number, model in models.items():  # COLMAP puts one that it went on with into the folder itself
        (folder / str(number)).mkdir(exist_ok=True)
        model.write(folder / str(number))
    keep_order(models, folder, start)


def _tolerance_px(photos: PhotoSet) -> float:
    """Return the reprojection error to accept: COLMAP's 4 px for large photos, less for small ones.

    With 4 px, one of twelve photos 480 px wide was placed more than a metre off (three seeds tried); with 2 px none.
    """
    return float(np.clip(max(photo.width for photo in photos.photos) / 750.0, 2.0, 4.0))


def _by_size(folder: Path) -> list[Path]:
    """Return the models in a folder, the largest first: the first one that COLMAP writes may be a stray pair."""
    return sorted((path for path in folder.iterdir() if path.is_dir()), key=_size, reverse=True)


def _size(model: Path) -> tuple[int, int]:
    """Return the photos and points of a model on disk."""
    reconstruction = load_pycolmap().Reconstruction(model)
    return int(reconstruction.num_reg_images()), int(reconstruction.num_points3D())
