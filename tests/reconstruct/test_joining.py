"""Models that were mapped apart are joined where their points match, and nowhere else; COLMAP's synthetic scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.growth import read_order
from aquanav_tools.reconstruct.images import Photo, PhotoSet
from aquanav_tools.reconstruct.joining import join
from aquanav_tools.reconstruct.mapping import join_models, run_mapper
from aquanav_tools.types import ignore_progress
from eval.photos.score import similarity
from tests.reconstruct.models import matched_scene

FIRST, SECOND = range(1, 8), range(8, 15)
"""Ids of the photos of either half."""


@pytest.fixture
def scene(tmp_path: Path) -> tuple[Path, Any]:
    """A database with the matches of 14 photos, and their true model."""
    return matched_scene(tmp_path, 14)


def half(model: Any, photos: range) -> Any:
    part = load_pycolmap().Reconstruction(model)
    for frame_id in list(part.reg_frame_ids()):
        if frame_id not in photos:
            part.deregister_frame(frame_id)
    return part


def elsewhere(model: Any) -> Any:
    """Move a model to another frame, in place."""
    pycolmap = load_pycolmap()
    turn = pycolmap.Rotation3d(np.array([0.1, 0.2, 0.3, 0.9]) / np.sqrt(0.95))
    model.transform(pycolmap.Sim3d(2.5, turn, np.array([3.0, 4.0, 5.0])))
    return model


def options() -> Any:
    pipeline = load_pycolmap().IncrementalPipelineOptions()
    pipeline.random_seed, pipeline.num_threads, pipeline.extract_colors = 0, 1, False
    return pipeline


def centres(model: Any) -> np.ndarray:
    return np.array([model.images[image_id].projection_center() for image_id in sorted(model.reg_image_ids())])


def test_halves_of_a_scene_are_joined_in_the_frame_of_the_first(scene: tuple[Path, Any]) -> None:
    database, truth = scene
    kept, other = half(truth, FIRST), elsewhere(half(truth, SECOND))
    joined = join(kept, other, database, database.parent, options())
    assert joined is not None
    assert sorted(joined.reg_image_ids()) == sorted(truth.reg_image_ids())
    np.testing.assert_allclose(centres(joined), centres(truth), atol=1e-4)


def test_models_without_matches_between_them_stay_apart(scene: tuple[Path, Any]) -> None:
    database, truth = scene
    pycolmap = load_pycolmap()
    with pycolmap.Database.open(database) as store:
        for first in FIRST:
            for second in SECOND:
                store.delete_two_view_geometry(first, second)
    assert join(half(truth, FIRST), elsewhere(half(truth, SECOND)), database, database.parent, options()) is None


def test_matches_that_agree_on_no_place_join_nothing(scene: tuple[Path, Any], rng: np.random.Generator) -> None:
    database, truth = scene
    pycolmap = load_pycolmap()
    with pycolmap.Database.open(database) as store:
        for first in FIRST:
            for second in SECOND:
                geometry = store.read_two_view_geometry(first, second)
                matches = np.array(geometry.inlier_matches)
                matches[:, 1] = rng.permutation(matches[:, 1])
                geometry.inlier_matches = matches
                store.update_two_view_geometry(first, second, geometry)
    assert join(half(truth, FIRST), elsewhere(half(truth, SECOND)), database, database.parent, options()) is None


def photo_set(folder: Path, model: Any) -> PhotoSet:
    names = sorted(image.name for image in model.images.values())
    return PhotoSet(folder, tuple(Photo(name, 1024, 768, None, file=name) for name in names))


def written(model: Any, path: Path) -> Path:
    path.mkdir()
    model.write(path)
    return path


def test_joined_models_take_the_place_of_both_on_disk(scene: tuple[Path, Any], tmp_path: Path) -> None:
    database, truth = scene
    paths = [written(half(truth, FIRST), tmp_path / "0"), written(elsewhere(half(truth, SECOND)), tmp_path / "1")]
    join_models(paths, photo_set(tmp_path, truth), database, options())
    assert not paths[1].exists()
    assert load_pycolmap().Reconstruction(paths[0]).num_reg_images() == 14
    assert len(read_order(paths[0])) == 14


def test_a_model_that_mapping_went_on_with_lies_where_new_ones_do(scene: tuple[Path, Any], tmp_path: Path) -> None:
    database, truth = scene
    start, target = written(half(truth, FIRST), tmp_path / "start"), tmp_path / "completed"
    target.mkdir()
    run_mapper(photo_set(tmp_path, truth), database, target, options(), start, ignore_progress)
    model = load_pycolmap().Reconstruction(target / "0")
    found, expected = centres(model), centres(truth)
    np.testing.assert_allclose(similarity(found, expected).apply(found), expected, atol=1e-3)
    assert len(read_order(target / "0")) == 14
