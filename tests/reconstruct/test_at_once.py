"""Where placing photos one after the other stops, all at once and few matches go on, and nothing loose is kept.

COLMAP's synthetic scenes: photos around a cloud of points, matches without noise.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.reconstruct.at_once import map_at_once
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.images import Photo, PhotoSet
from aquanav_tools.reconstruct.mapping import MappingOptions, SparseModel, map_photos
from aquanav_tools.reconstruct.rigid import rigid_part
from eval.photos.score import similarity

NUM_PHOTOS = 12
FIRST, SECOND = range(1, 8), range(8, 13)
"""Ids of two parts of the scene, the first one larger."""


def synthesize(database: Path, num_points: int) -> Any:
    """Write a database with the matches of all photos, and return their true model."""
    pycolmap = load_pycolmap()
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs = options.num_cameras_per_rig = 1
    options.num_frames_per_rig, options.num_points3D = NUM_PHOTOS, num_points
    options.camera_has_prior_focal_length = True
    pycolmap.set_random_seed(0)
    with pycolmap.Database.open(database) as store:
        return pycolmap.synthesize_dataset(options, store)


def keep_matches(store: Any, pairs: set[tuple[int, int]], keep: Callable[[Any], Any]) -> None:
    """Keep of the matches of pairs the rows that `keep` flags in their (M, 2) table."""
    for first, second in pairs:
        geometry = store.read_two_view_geometry(first, second)
        matches = np.array(geometry.inlier_matches)
        geometry.inlier_matches = matches[keep(matches)]
        store.update_two_view_geometry(first, second, geometry)


def hinge(store: Any, truth: Any) -> None:
    """Let either part match by points of its own, and both by one pair of photos whose points no third one matches."""
    for first in range(1, NUM_PHOTOS + 1):
        for second in range(first + 1, NUM_PHOTOS + 1):
            points = np.array([point.point3D_id for point in truth.images[first].points2D])
            group = 0 if second in FIRST else 1 if first in SECOND else 2 if (first, second) == (1, 8) else None
            if group is None:
                store.delete_two_view_geometry(first, second)
            else:
                keep_matches(store, {(first, second)}, lambda m, p=points, g=group: p[m[:, 0]] % 3 == g)


def errors(truth: Any, image_ids: list[int], centres: Any) -> Any:
    """Return how far (N, 3) camera centres lie off the true ones, up to a similarity."""
    expected = np.array([truth.images[i].projection_center() for i in image_ids])
    return np.linalg.norm(similarity(centres, expected).apply(centres) - expected, axis=1)


def mapped(truth: Any, folder: Path) -> SparseModel:
    names = [truth.images[i].name for i in range(1, NUM_PHOTOS + 1)]
    photos = PhotoSet(folder, tuple(Photo(name, 1024, 768, None, file=name) for name in names))
    return map_photos(photos, folder / "database.db", folder / "models", MappingOptions())


def test_a_scene_whose_photos_show_too_little_to_grow_from_is_placed_at_once(tmp_path: Path) -> None:
    truth = synthesize(tmp_path / "database.db", num_points=28)  # growing needs 30
    sparse = mapped(truth, tmp_path)
    assert sparse.is_at_once
    assert sparse.order == ()
    assert len(sparse.names) == NUM_PHOTOS
    assert errors(truth, sorted(sparse.model.reg_image_ids()), sparse.centres).max() < 0.01


def test_where_growing_places_all_that_is_what_is_kept(tmp_path: Path) -> None:
    truth = synthesize(tmp_path / "database.db", num_points=150)
    sparse = mapped(truth, tmp_path)
    assert not sparse.is_at_once
    assert len(sparse.order) == NUM_PHOTOS


def test_a_photo_that_shows_ten_points_of_the_model_is_placed_where_it_was_taken(tmp_path: Path) -> None:
    last, neighbour = NUM_PHOTOS, 1
    database = tmp_path / "database.db"
    truth = synthesize(database, num_points=150)
    # Keypoints of the neighbour that it shares with the last photo; other photos show the first ten of them only.
    known, alone = np.arange(10), np.arange(10, 60)
    with load_pycolmap().Database.open(database) as store:
        for other in range(2, NUM_PHOTOS):
            store.delete_two_view_geometry(other, last)
        others = {(neighbour, other) for other in range(2, NUM_PHOTOS)}
        keep_matches(store, others, lambda matches: ~np.isin(matches[:, 0], alone))
        keep_matches(store, {(neighbour, last)}, lambda matches: np.isin(matches[:, 0], [*known, *alone]))
    sparse = mapped(truth, tmp_path)
    assert not sparse.is_at_once
    ids = sorted(sparse.model.reg_image_ids())
    assert last in ids
    assert errors(truth, ids, sparse.centres)[ids.index(last)] < 0.01


def test_photos_placed_at_once_are_the_same_every_time(tmp_path: Path) -> None:
    truth = synthesize(tmp_path / "database.db", num_points=60)
    found = [map_at_once(tmp_path / "database.db", tmp_path, tmp_path / "scratch", 2.0, seed=3) for _ in range(2)]
    first, second = (np.array([one.images[i].projection_center() for i in truth.images]) for one in found)
    assert first.tobytes() == second.tobytes()
    assert not (tmp_path / "scratch").exists()


def test_parts_that_hang_together_by_one_pair_are_not_kept_as_one(tmp_path: Path) -> None:
    truth = synthesize(tmp_path / "database.db", num_points=90)
    with load_pycolmap().Database.open(tmp_path / "database.db") as store:
        hinge(store, truth)
    found = map_at_once(tmp_path / "database.db", tmp_path, tmp_path / "scratch", 2.0, seed=0)
    assert found is not None
    ids = sorted(found.reg_image_ids())
    assert ids == list(FIRST)
    centres = np.array([found.images[i].projection_center() for i in ids])
    assert errors(truth, ids, centres).max() < 0.01


@pytest.mark.parametrize("num_shared", [0, 5, 6])
def test_a_part_is_firm_with_another_from_six_points_on_that_three_photos_show(num_shared: int, tmp_path: Path) -> None:
    truth = synthesize(tmp_path / "database.db", num_points=60)
    shared = set(sorted(truth.points3D)[:num_shared])
    for point_id in sorted(truth.points3D):  # all others belong to either part alone
        elements = [(e.image_id, e.point2D_idx) for e in truth.points3D[point_id].track.elements]
        part = FIRST if point_id % 2 else SECOND
        for image_id, keypoint in elements:
            if point_id not in shared and image_id not in part:
                truth.delete_observation(image_id, keypoint)
    assert rigid_part(truth, 6) == (list(range(1, NUM_PHOTOS + 1)) if num_shared == 6 else list(FIRST))
