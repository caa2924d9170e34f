"""Pixels in, surface out: a rendered cave is reconstructed and held against its truth.

Every test of that one reconstruction is in this file: processes that share the suite by files then make it once.
"""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from aquanav_tools.errors import ReconstructionError
from aquanav_tools.photograph.scene import SmoothScene
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.dense import cpu
from aquanav_tools.reconstruct.dense.engine import Solver, solver
from aquanav_tools.reconstruct.dense.pictures import MASKS_DIR
from aquanav_tools.reconstruct.depth import DepthOptions, depth_path, estimate_depth, load_depth, memory_bytes
from aquanav_tools.reconstruct.fusion import FusionOptions, fuse_depth
from aquanav_tools.reconstruct.georeference.options import ScaleSources
from aquanav_tools.reconstruct.georeference.solve import upright_rotation
from aquanav_tools.reconstruct.georeference.sources import read_world
from aquanav_tools.reconstruct.reconstruction import reconstruct
from aquanav_tools.types import Sim3
from tests.reconstruct.conftest import SMALL_OPTIONS, Dive
from tests.reconstruct.scenes import scores, true_centres


def test_all_photos_register_where_they_were_taken(dive: Dive) -> None:
    assert dive.result.statistics["registered"] == len(dive.photos.photos)
    errors = np.linalg.norm(
        dive.result.camera_centres - true_centres(dive.photos.folder, dive.result.camera_names), axis=1
    )
    assert errors.mean() < 0.01  # a third of a pixel at 2 m is 2 mm; drift over the passage adds some
    assert dive.result.statistics["scale_sources"][0]["rms_m"] < 0.01


def test_cloud_lies_on_the_true_wall_and_covers_what_was_seen(dive: Dive) -> None:
    figures = scores(dive.cave, dive.photos.folder, dive.result.cloud.points)
    print(figures)
    assert figures["median"] < 0.01
    assert figures["precision"] > 0.95
    assert figures["recall"] > 0.6  # at 240 px; the demo's 480 px reaches more


def test_normals_point_into_the_water(dive: Dive) -> None:
    cloud = dive.result.cloud
    assert cloud.normals is not None
    np.testing.assert_allclose(np.linalg.norm(cloud.normals, axis=1), 1.0, atol=1e-3)
    chosen = slice(None, None, 37)
    steps, wall_normals = SmoothScene(dive.cave.mesh).cast(
        dive.cave.centreline[0], cloud.points[chosen] - dive.cave.centreline[0]
    )
    is_seen = np.abs(steps - 1.0) < 0.03
    agreement = np.einsum("ij,ij->i", -wall_normals[is_seen], cloud.normals[chosen][is_seen])
    assert np.median(agreement) > 0.8
    assert np.mean(agreement > 0.0) > 0.95


def test_colours_come_with_every_point(dive: Dive) -> None:
    colours = dive.result.cloud.colours
    assert colours is not None
    assert colours.shape == dive.result.cloud.points.shape
    assert 20 < colours.mean() < 235


def test_statistics_can_be_written_as_json(dive: Dive) -> None:
    assert json.loads(json.dumps(dive.result.statistics, allow_nan=False))["photos"] == len(dive.photos.photos)


def test_a_second_run_takes_up_what_the_first_one_kept(dive: Dive, monkeypatch: pytest.MonkeyPatch) -> None:
    pycolmap = load_pycolmap()

    def refuse(*args: object, **kwargs: object) -> None:
        raise AssertionError("done again")

    for name in ("estimate_two_view_geometry", "incremental_mapping", "undistort_images"):
        monkeypatch.setattr(pycolmap, name, refuse)
    monkeypatch.setattr("aquanav_tools.reconstruct.depth._Estimation._find", refuse)
    world = read_world(ScaleSources(positions=dive.photos.folder / "positions.csv"), dive.photos)
    again = reconstruct(dive.photos, dive.workspace, SMALL_OPTIONS, world)
    np.testing.assert_array_equal(again.camera_centres, dive.result.camera_centres)
    np.testing.assert_array_equal(again.cloud.points, dive.result.cloud.points)


KILLED = """
import os, signal, sys
from contextlib import contextmanager
from pathlib import Path
from aquanav_tools.reconstruct.images import read_photos
from aquanav_tools.reconstruct.reconstruction import reconstruct
from tests.reconstruct.conftest import SMALL_OPTIONS

@contextmanager
def stage(title):
    def progress(done, total):
        if title == sys.argv[3]:
            os.kill(os.getpid(), signal.SIGKILL)
    yield progress

reconstruct(read_photos(Path(sys.argv[1])), Path(sys.argv[2]), SMALL_OPTIONS, stage=stage)
"""


@pytest.mark.slow
def test_a_reconstruction_killed_in_two_stages_ends_the_same(dive: Dive, tmp_path: Path) -> None:
    for kept in [*dive.workspace.glob("prepared-*"), *dive.workspace.glob("features-*")]:
        shutil.copytree(kept, tmp_path / kept.name, symlinks=True)
    for title in ("Matching photos", "Measuring depth"):
        command = [sys.executable, "-c", KILLED, str(dive.photos.folder), str(tmp_path), title]
        assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    world = read_world(ScaleSources(positions=dive.photos.folder / "positions.csv"), dive.photos)
    again = reconstruct(dive.photos, tmp_path, SMALL_OPTIONS, world)
    np.testing.assert_array_equal(again.camera_centres, dive.result.camera_centres)
    np.testing.assert_array_equal(again.cloud.points, dive.result.cloud.points)
    np.testing.assert_array_equal(again.cloud.colours, dive.result.cloud.colours)


@pytest.mark.parametrize("at_once", [1, 3])
def test_a_killed_dense_step_loses_a_photo_per_thread_and_ends_the_same_for_any_number_of_threads(
    dive: Dive, at_once: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("aquanav_tools.reconstruct.depth.solver", lambda device: Solver(cpu.solve, at_once))
    lacking = (0, 3, 8)
    dense = without_depth(dive, tmp_path, *lacking)
    estimate_depth(dense, SMALL_OPTIONS.depth)
    for photo in lacking:
        first, again = (load_depth(depth_path(one, dive.result.camera_names[photo])) for one in (dive.dense_dir, dense))
        np.testing.assert_array_equal(again.depth, first.depth)
        np.testing.assert_array_equal(again.normals, first.normals)


def test_another_seed_gives_another_depth(dive: Dive) -> None:
    dense = dive.dense_dir
    path = depth_path(dense, dive.result.camera_names[0])
    first = path.read_bytes()
    kept = load_depth(path)
    path.unlink()
    estimate_depth(dense, replace(SMALL_OPTIONS.depth, seed=1))
    assert not np.array_equal(load_depth(path).depth, kept.depth)
    path.write_bytes(first)


def test_masked_and_black_pixels_get_no_depth(dive: Dive, tmp_path: Path) -> None:
    name = dive.result.camera_names[0]
    dense = without_depth(dive, tmp_path, 0)
    photo = cv2.imread(str(dense / "images" / name))
    photo[:60] = 0
    cv2.imwrite(str(dense / "images" / name), photo, [cv2.IMWRITE_JPEG_QUALITY, 100])
    mask = np.full(photo.shape[:2], 255, np.uint8)
    mask[:, :80] = 0
    (dense / MASKS_DIR).mkdir()
    cv2.imwrite(str(dense / MASKS_DIR / f"{name}.png"), mask)
    estimate_depth(dense, SMALL_OPTIONS.depth)
    found = load_depth(depth_path(dense, name))
    assert not found.depth[:, :80].any()
    assert not found.depth[:56].any()  # JPEG blurs the black edge by half a block
    assert not found.normals[found.depth == 0.0].any()
    assert np.mean(found.depth[64:, 84:] > 0.0) > 0.8


def without_depth(dive: Dive, folder: Path, *photos: int) -> Path:
    """A copy of the undistorted photos of a dive with their depth, which some of them lack."""
    dense = folder / "dense"
    for part in ("images", "sparse", "depth"):
        shutil.copytree(dive.dense_dir / part, dense / part)
    for photo in photos:
        depth_path(dense, dive.result.camera_names[photo]).unlink()
    return dense


def test_agreement_ends_the_same_after_a_kill_and_leaves_nothing_behind(dive: Dive, tmp_path: Path) -> None:
    dense = without_depth(dive, tmp_path, 3, 8)
    path = depth_path(dense, dive.result.camera_names[3])
    options = replace(SMALL_OPTIONS.depth, agreement=True)
    estimate_depth(dense, options)
    assert not (dense / "alone").exists()
    first = load_depth(path)
    assert not np.array_equal(first.depth, load_depth(depth_path(dive.dense_dir, path.name[:-4])).depth)
    path.unlink()
    estimate_depth(dense, options)
    np.testing.assert_array_equal(load_depth(path).depth, first.depth)


def test_memory_stays_below_what_is_said(dive: Dive, tmp_path: Path) -> None:
    dense = without_depth(dive, tmp_path, 0, 4, 8)  # these and their sources are nearly all
    tracemalloc.start()
    try:
        estimate_depth(dense, SMALL_OPTIONS.depth)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # Beside the arrays of the formula: the sparse model's points, and the triangulation of one photo's.
    assert peak < memory_bytes(240, 180, SMALL_OPTIONS.depth, solver("cpu").at_once) + 8e6


def test_moving_a_reconstruction_scales_distances_and_turns_normals(dive: Dive) -> None:
    turned = upright_rotation(np.array([0.6, 0.0, 0.8]), np.array([1.0, 2.0, 0.0]))
    moved = dive.result.moved(Sim3(2.0, turned, np.array([1.0, 2.0, 3.0])))
    before = np.linalg.norm(np.diff(dive.result.camera_centres, axis=0), axis=1)
    after = np.linalg.norm(np.diff(moved.camera_centres, axis=0), axis=1)
    np.testing.assert_allclose(after, 2.0 * before)
    assert moved.cloud.normals is not None
    np.testing.assert_allclose(np.linalg.norm(moved.cloud.normals, axis=1), 1.0, atol=1e-3)


@pytest.mark.parametrize("wrong", [{"width": 10}, {"sources": 1}, {"radius": 0}, {"iterations": 0}])
def test_senseless_depth_options_are_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        DepthOptions(**wrong)


def test_photos_without_neighbours_at_a_useful_angle_end_the_dense_step(
    dive: Dive, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("aquanav_tools.reconstruct.depth.rank_sources", lambda views, count: [[]] * len(views))
    with pytest.raises(ReconstructionError, match=r"None of the 12 registered photos shares rock with two others"):
        estimate_depth(dive.dense_dir, SMALL_OPTIONS.depth)


def test_depth_maps_without_a_sure_pixel_end_the_fusion(dive: Dive, tmp_path: Path) -> None:
    dense = tmp_path / "dense"
    shutil.copytree(dive.dense_dir, dense)
    paths = sorted((dense / "depth").iterdir())
    with pytest.raises(ReconstructionError, match=r"depth maps of 12 photos agree on no point"):
        fuse_depth(dense, paths, FusionOptions(max_cost=1e-9))


@pytest.mark.parametrize("wrong", [{"max_cost": 0.0}, {"min_photos": 1}, {"max_depth_error": 0.0}])
def test_senseless_fusion_options_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="FusionOptions"):
        FusionOptions(**wrong)  # type: ignore[arg-type]
