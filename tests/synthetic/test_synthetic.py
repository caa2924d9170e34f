from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.cave.cavity import prove_watertight
from aquanav_tools.synthetic.caves import CaveOptions, SyntheticCave, bend, demo_cave, tube
from aquanav_tools.synthetic.noise import fractal, noise


@pytest.fixture(scope="module")
def cave() -> SyntheticCave:
    return demo_cave(CaveOptions(voxel=0.1))


def volume(cave: SyntheticCave) -> float:
    return float(cave.truth.to_trimesh().volume)


def length(cave: SyntheticCave) -> float:
    return float(np.linalg.norm(np.diff(cave.centreline, axis=0), axis=1).sum())


def num_openings(cave: SyntheticCave) -> int:
    """Boundary loops by Euler's formula: a sphere with b holes has V - E + F = 2 - b."""
    return 2 - int(cave.mesh.to_trimesh().euler_number)


@pytest.mark.parametrize("options", [{}, {"seed": 1}, {"seed": 2}])
def test_demo_cave_is_a_closed_passage_with_two_openings(options: dict[str, int]) -> None:
    cave = demo_cave(CaveOptions(voxel=0.1, **options))
    prove_watertight(cave.truth)
    assert cave.truth.to_trimesh().euler_number == 2
    assert num_openings(cave) == 2


def test_demo_cave_has_the_promised_size(cave: SyntheticCave) -> None:
    # From opening to opening, and no more than a third longer for its windings.
    assert 9.0 <= length(cave) < 12.0
    mean_radius = np.sqrt(volume(cave) / length(cave) / np.pi)
    assert 1.2 < mean_radius < 2.0


def test_centreline_of_demo_cave_stays_in_the_water(cave: SyntheticCave) -> None:
    inner = cave.centreline[1:-1]
    assert cave.truth.to_trimesh().contains(inner).all()


def test_same_seed_gives_the_same_cave_and_another_seed_another_one(cave: SyntheticCave) -> None:
    again = demo_cave(CaveOptions(voxel=0.1))
    other = demo_cave(CaveOptions(voxel=0.1, seed=5))
    assert np.array_equal(again.truth.vertices, cave.truth.vertices)
    assert abs(volume(other) - volume(cave)) > 0.1


def test_walls_of_the_demo_cave_are_rough(cave: SyntheticCave) -> None:
    normals = cave.mesh.to_trimesh()
    turns = normals.face_adjacency_angles
    assert np.degrees(np.median(turns)) > 2.0  # a smooth tube of this radius and voxel turns by less


@pytest.mark.parametrize(
    ("cave", "expected_volume", "expected_length"),
    [
        (tube(2.0, 20.0), np.pi * 4.0 * 20.0, 20.0),
        (bend(1.5, 6.0, np.pi / 2), np.pi * 2.25 * 6.0 * np.pi / 2, 6.0 * np.pi / 2),
    ],
)
def test_smooth_caves_have_their_closed_form_volume_and_length(
    cave: SyntheticCave, expected_volume: float, expected_length: float
) -> None:
    prove_watertight(cave.truth)
    # A regular polygon of 64 sides has 0.16 % less area than its circle.
    assert volume(cave) == pytest.approx(expected_volume, rel=2.5e-3)
    assert length(cave) == pytest.approx(expected_length, rel=1e-3)
    assert num_openings(cave) == 2


def test_noise_is_bounded_continuous_and_changes_with_the_seed(rng: np.random.Generator) -> None:
    points = rng.uniform(-50, 50, (500, 3))
    values = np.array([noise(x, y, z, 1) for x, y, z in points])
    nearby = np.array([noise(x + 1e-6, y, z, 1) for x, y, z in points])
    other = np.array([noise(x, y, z, 2) for x, y, z in points])
    assert np.abs(values).max() <= 1.0
    assert np.abs(nearby - values).max() < 1e-5  # the quintic step rises by at most 1.875 per unit, times 2
    assert abs(np.corrcoef(values, other)[0, 1]) < 0.2


def test_octaves_finer_than_asked_for_are_left_out() -> None:
    assert fractal(0.3, 0.4, 0.5, 4.0, 3, 0.5, 4.0, 0) == 0.0
    coarse = fractal(0.3, 0.4, 0.5, 4.0, 1, 0.5, 1e9, 0)
    assert fractal(0.3, 0.4, 0.5, 4.0, 5, 0.5, 8.0, 0) == pytest.approx(coarse)


@pytest.mark.parametrize("wrong", [{"length": 0.0}, {"voxel": 0.0}, {"voxel": 1.0}, {"winding": -1.0}])
def test_impossible_caves_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        CaveOptions(**wrong)  # type: ignore[arg-type]
