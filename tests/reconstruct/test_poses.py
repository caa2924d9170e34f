"""Cameras from rendered photos: hard sets hang together, the same photos give the same cameras, kills lose little."""

from __future__ import annotations

import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.photograph.dive import photograph
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.features import FeatureOptions, extract_features
from aquanav_tools.reconstruct.images import PhotoSet, read_photos
from aquanav_tools.reconstruct.mapping import MappingOptions, SparseModel, map_photos
from aquanav_tools.reconstruct.matching import MatchOptions, match_features, verified_matches
from aquanav_tools.synthetic.caves import SyntheticCave
from eval.photos.score import PoseScore, read_true_cameras, score_poses
from tests.reconstruct.scenes import SMALL_DIVE, small_cave

FEATURES = FeatureOptions(max_features=1000)
IN_ROUNDS = MatchOptions(exhaustive_up_to=0, overlap=1, alike=3)
"""Even a dozen photos are not compared completely."""
KILLED_MATCHING = """
import dataclasses, os, signal, sys
from pathlib import Path
from aquanav_tools.reconstruct import matching
from aquanav_tools.reconstruct.images import read_photos
matching._PAIRS_AT_ONCE = 4

def die(done, total):
    if done >= 8:
        os.kill(os.getpid(), signal.SIGKILL)

options = matching.MatchOptions(exhaustive_up_to=0, overlap=1, alike=3)
photos = read_photos(Path(sys.argv[1]))
matching.match_features(dataclasses.replace(photos, photos=photos.photos[:8]), Path(sys.argv[2]), options, die)
"""


def mapped(photos: PhotoSet, workspace: Path, matching: MatchOptions = IN_ROUNDS) -> SparseModel:
    database = workspace / "database.db"
    extract_features(photos, database, FEATURES)
    match_features(photos, database, matching)
    return map_photos(photos, database, workspace / "models", MappingOptions(min_share=0.0))


def score(photos: PhotoSet, sparse: SparseModel) -> PoseScore:
    return score_poses(tuple(sparse.names), sparse.centres, sparse.rotations, read_true_cameras(photos.folder))


@pytest.fixture
def few_photos(small_photos: tuple[SyntheticCave, PhotoSet]) -> PhotoSet:
    """Two stations of the small dive."""
    photos = small_photos[1]
    return replace(photos, photos=photos.photos[:8])


def test_the_same_photos_give_the_same_cameras(few_photos: PhotoSet, tmp_path: Path) -> None:
    first, second = (mapped(few_photos, tmp_path / name) for name in ("first", "second"))
    assert len(first.names) >= 6
    assert first.names == second.names
    assert first.centres.tobytes() == second.centres.tobytes()
    assert first.rotations.tobytes() == second.rotations.tobytes()
    assert first.model.num_points3D() == second.model.num_points3D()


@pytest.mark.slow
def test_killed_matching_goes_on_to_the_same_matches(few_photos: PhotoSet, tmp_path: Path) -> None:
    photos = few_photos
    names = [photo.file for photo in photos.photos]
    whole, killed = (tmp_path / name / "database.db" for name in ("whole", "killed"))
    for database in (whole, killed):
        extract_features(photos, database, FEATURES)
    match_features(photos, whole, IN_ROUNDS)
    child = subprocess.run([sys.executable, "-c", KILLED_MATCHING, str(photos.folder), str(killed)], check=False)
    assert child.returncode == -signal.SIGKILL
    with load_pycolmap().Database.open(killed) as store:
        assert 0 < store.num_matched_image_pairs() <= 8  # pairs that show nothing in common leave no trace
    match_features(photos, killed, IN_ROUNDS)
    np.testing.assert_array_equal(verified_matches(killed, names), verified_matches(whole, names))
    assert np.count_nonzero(verified_matches(whole, names)) > 10


@pytest.mark.slow
def test_photos_of_muddy_walls_by_a_noisy_sensor_register(tmp_path: Path) -> None:
    camera = replace(SMALL_DIVE.camera, width=640, height=480, noise=3.0)
    photograph(small_cave(), tmp_path / "photos", replace(SMALL_DIVE, camera=camera, texture=0.25))
    photos = read_photos(tmp_path / "photos")
    found = score(photos, mapped(photos, tmp_path / "work"))
    print(found.registered, found.centre_errors)
    assert found.registered >= 11
    assert found.centre_errors.mean() < 0.03
