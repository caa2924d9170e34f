"""Photos placed against their own matches are found, and no others; COLMAP's synthetic scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.misplaced import misplaced_photos
from tests.reconstruct.models import matched_scene


@pytest.fixture
def scene(tmp_path: Path) -> tuple[Path, Any]:
    """A database with the matches of ten photos, and their true model."""
    return matched_scene(tmp_path, 10)


def put_elsewhere(model: Any, image_id: int) -> None:
    """Turn a photo by 40 degrees about its vertical axis, in place: its centre stays right."""
    pycolmap = load_pycolmap()
    half = np.deg2rad(20.0)
    turn = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array([0.0, np.sin(half), 0.0, np.cos(half)])), np.zeros(3))
    frame = model.frames[model.images[image_id].frame_id]
    frame.rig_from_world = turn * frame.rig_from_world


def test_true_places_contradict_nothing(scene: tuple[Path, Any]) -> None:
    database, model = scene
    assert misplaced_photos(model, database, 2.0) == []


@pytest.mark.parametrize("wrong", [[3], [2, 7], [1, 5, 9]])
def test_photos_turned_away_from_what_they_show_are_found(scene: tuple[Path, Any], wrong: list[int]) -> None:
    database, model = scene
    for image_id in wrong:
        put_elsewhere(model, image_id)
    assert misplaced_photos(model, database, 2.0) == wrong


def test_a_photo_without_matches_is_left_alone(scene: tuple[Path, Any]) -> None:
    database, model = scene
    with load_pycolmap().Database.open(database) as store:
        for other in range(2, 11):
            store.delete_two_view_geometry(1, other)
    put_elsewhere(model, 1)
    assert misplaced_photos(model, database, 2.0) == []
