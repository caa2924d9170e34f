"""Scores of reconstructions against closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.photograph.dive import photograph
from aquanav_tools.photograph.lens import Lens
from aquanav_tools.photograph.options import CameraOptions, CaptureOptions, DiveOptions
from aquanav_tools.photograph.scene import SmoothScene
from aquanav_tools.photograph.trajectory import look
from aquanav_tools.synthetic.caves import SyntheticCave, tube
from aquanav_tools.types import Mesh, Sim3, rotation_matrix
from eval.photos.score import (
    CloudScore,
    TrueCameras,
    distances_to,
    is_seen,
    loop_gap,
    read_true_cameras,
    read_wall,
    score_cloud,
    score_poses,
    seen_wall,
)


def square(x: float, half: float) -> Mesh:
    """A square across x, around the axis."""
    corners = np.array([[x, -half, -half], [x, half, -half], [x, half, half], [x, -half, half]])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def camera_at_origin(focal_px: float = 50.0) -> TrueCameras:
    return TrueCameras(("a",), Lens(100, 100, focal_px), np.zeros((1, 3)), look(0.0, 0.0)[None])


def grid(spacing: float) -> np.ndarray:
    """Points on the square x = 2, |y|, |z| <= 1."""
    at = np.arange(-1.0, 1.0 + 1e-9, spacing)
    y, z = np.meshgrid(at, at)
    return np.stack([np.full(y.size, 2.0), y.ravel(), z.ravel()], axis=1)


def test_the_wall_itself_scores_one() -> None:
    wall = square(2.0, 1.0)
    seen = seen_wall(wall, camera_at_origin(), min_photos=1, num_samples=2000)
    assert len(seen) == 2000
    for score in score_cloud(grid(0.02), wall, seen):
        assert (score.precision, score.recall, score.f_score) == (1.0, 1.0, 1.0)


def test_a_cloud_off_by_3_cm_passes_at_5_cm_and_fails_at_2() -> None:
    wall = square(2.0, 1.0)
    seen = seen_wall(wall, camera_at_origin(), min_photos=1, num_samples=2000)
    np.testing.assert_allclose(distances_to(wall, grid(0.02) + [0.03, 0, 0]), 0.03, atol=1e-6)
    wide, narrow = score_cloud(grid(0.02) + [0.03, 0, 0], wall, seen, (0.05, 0.02))
    assert (wide.f_score, narrow.f_score) == (1.0, 0.0)


def test_half_a_cloud_recalls_half_the_wall() -> None:
    wall = square(2.0, 1.0)
    seen = seen_wall(wall, camera_at_origin(), min_photos=1, num_samples=5000)
    half = grid(0.02)[grid(0.02)[:, 1] < 0.0]
    (score,) = score_cloud(half, wall, seen, (0.05,))
    assert score.precision == 1.0
    assert score.recall == pytest.approx(0.5 + 0.025, abs=0.02)  # a tolerance wider; 5000 samples


def test_the_f_score_is_the_harmonic_mean() -> None:
    assert CloudScore(0.05, 0.9, 0.6).f_score == pytest.approx(0.72)
    assert CloudScore(0.05, 0.0, 0.0).f_score == 0.0


def test_only_what_is_in_the_frame_and_not_hidden_is_seen() -> None:
    near, far = square(1.0, 0.25), square(2.0, 1.0)
    both = Mesh(np.concatenate([near.vertices, far.vertices]), np.concatenate([near.faces, far.faces + 4]))
    cameras = camera_at_origin(100.0)  # sees |y| / x < 0.5
    points = np.array([[1.0, 0.1, 0.1], [2.0, 0.1, 0.1], [2.0, 0.7, 0.7], [2.0, -0.7, 0.0], [-2.0, 0.0, 0.0]])
    seen = is_seen(SmoothScene(both), cameras.lens, np.zeros(3), cameras.cam_from_world[0], points)
    assert seen.tolist() == [True, False, True, True, False]
    assert seen_wall(both, cameras, min_photos=2, num_samples=100).shape == (0, 3)
    samples = seen_wall(both, cameras, min_photos=1, num_samples=40_000)
    # of 4.25 m2: all 0.25 of the near one, and of the far one 4 less the near one's shadow of 1
    assert len(samples) / 40_000 == pytest.approx(3.25 / 4.25, abs=0.01)


def test_a_moved_turned_and_scaled_model_has_no_pose_error(rng: np.random.Generator) -> None:
    turn = rotation_matrix(np.array([0.5, 0.5, -0.5, 0.5]))
    model = Sim3(0.3, turn, np.array([1.0, -2.0, 3.0]))
    centres = rng.normal(size=(6, 3))
    rotations = np.array([look(*angles) for angles in rng.uniform(-1, 1, (6, 3))])
    truth = TrueCameras(tuple("abcdef"), Lens(10, 10, 10.0), centres, rotations)
    chosen = [4, 0, 2, 5]
    score = score_poses(tuple("eacf"), model.apply(centres[chosen]), rotations[chosen] @ turn.T, truth)
    assert score.registered == 4
    np.testing.assert_allclose(score.centre_errors, 0.0, atol=1e-12)
    np.testing.assert_allclose(score.rotation_errors_deg, 0.0, atol=1e-5)
    assert score.world_from_estimate.scale == pytest.approx(1 / 0.3)


def test_a_camera_turned_by_two_degrees_is_off_by_two_degrees(rng: np.random.Generator) -> None:
    centres = rng.normal(size=(5, 3))
    rotations = np.array([look(0.1 * k, 0.0) for k in range(5)])
    truth = TrueCameras(tuple("abcde"), Lens(10, 10, 10.0), centres, rotations)
    off = rotations.copy()
    off[3] = look(0.3 + np.radians(2.0), 0.0)
    score = score_poses(tuple("abcde"), centres, off, truth)
    np.testing.assert_allclose(score.rotation_errors_deg, [0, 0, 0, 2, 0], atol=1e-5)


def test_a_camera_off_by_a_known_way_is_found_so() -> None:
    """Two cameras off by 1 cm in opposite directions across the line of the others: no similarity hides that."""
    centres = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [1.5, 2, 0], [1.5, -2, 0], [1.5, 0, 2]])
    rotations = np.tile(np.eye(3), (7, 1, 1))
    truth = TrueCameras(tuple("abcdefg"), Lens(10, 10, 10.0), centres, rotations)
    moved = centres.copy()
    moved[[0, 3], 2] += (
        0.01  # the ends up, the middle down: a bend, orthogonal to moves, turns and scale to first order
    )
    moved[[1, 2], 2] -= 0.01
    score = score_poses(truth.names, moved, rotations, truth)
    np.testing.assert_allclose(score.centre_errors, [0.01, 0.01, 0.01, 0.01, 0, 0, 0], atol=1e-4)


def test_the_truth_of_a_dive_reads_back(tmp_path: Path) -> None:
    cave: SyntheticCave = tube(1.5, 8.0)
    options = DiveOptions(
        camera=CameraOptions("fisheye", 80, 64), capture=CaptureOptions("forward", 6, unsteady_m=0.0, unsteady_deg=0.0)
    )
    photograph(cave, tmp_path, options)
    cameras, wall = read_true_cameras(tmp_path), read_wall(tmp_path)
    assert cameras.names[0] == "dive_1.jpg"
    assert cameras.lens.distortion == options_distortion(options)
    assert len(wall.faces) == len(cave.mesh.faces)
    seen = seen_wall(wall, cameras, num_samples=4000)
    # The second photo is taken at 1.84 m and sees nothing 90 degrees off its axis; of the end, two see everything.
    assert 1.84 < seen[:, 0].min() < 3.0
    assert seen[:, 0].max() > 7.9
    assert 0.55 < len(seen) / 4000 < 6.16 / 8.0


def options_distortion(options: DiveOptions) -> tuple[float, ...]:
    from aquanav_tools.photograph.options import DISTORTION

    return DISTORTION[options.camera.lens]


def test_a_walk_in_a_circle_that_climbs_misses_its_beginning_by_the_climb() -> None:
    """100 steps a turn, 6 beyond it: step 100 ends above the first place, by 100 steps' climb of 1 mm."""
    angles = 2.0 * np.pi * np.arange(107) / 100.0
    way = np.column_stack([np.cos(angles), np.sin(angles), 0.001 * np.arange(107)])
    step = np.hypot(2.0 * np.sin(np.pi / 100.0), 0.001)
    assert loop_gap(way) == pytest.approx(0.1 / (106 * step), rel=1e-9)
