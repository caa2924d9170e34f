"""Made-up caves: one body of water, open at both ends, with the forks that were asked for, the same for a seed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from aquanav_tools.cave.closing.reconstruct import ReconstructionOptions, close_surface
from aquanav_tools.synthetic.galleries import MIN_PILLAR, GalleryOptions, galleries, gallery_cave

SMALL = GalleryOptions(seed=5, length=16.0, radius=0.9, winding=0.8, rise=0.4, swings=1.0, voxel=0.2, narrow_radius=0.8)


def test_water_is_one_closed_body_with_two_flat_ends() -> None:
    cave = gallery_cave(SMALL)
    solid = cave.truth.to_trimesh()
    assert solid.is_watertight and solid.is_volume and solid.body_count == 1
    assert cave.truth.vertices[:, 0].min() == pytest.approx(0.0, abs=1e-4)
    assert cave.truth.vertices[:, 0].max() == pytest.approx(SMALL.length, abs=1e-4)
    middle_radius = np.sqrt(cave.truth.volume / (np.pi * SMALL.length))
    assert 0.75 * SMALL.radius < middle_radius < 1.15 * SMALL.radius  # the sediment takes a fifth of the section


def test_each_by_pass_makes_one_loop() -> None:
    cave = gallery_cave(dataclasses.replace(SMALL, loops=1, length=22.0))
    assert cave.truth.to_trimesh().euler_number == 0  # a body with one tunnel through it


def test_dead_ends_make_no_loop_but_more_water() -> None:
    plain, branched = gallery_cave(SMALL), gallery_cave(dataclasses.replace(SMALL, dead_ends=1))
    assert branched.truth.to_trimesh().euler_number == 2
    assert branched.truth.volume > plain.truth.volume + 1.0


def test_a_seed_gives_the_same_cave_and_another_seed_another() -> None:
    first, again, other = (gallery_cave(dataclasses.replace(SMALL, seed=seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.truth.vertices, again.truth.vertices)
    assert first.truth.vertices.shape != other.truth.vertices.shape


def test_galleries_have_the_radii_that_were_asked_for() -> None:
    options = GalleryOptions(seed=3, length=40.0, radius=1.4, chambers=1, narrows=1, narrow_radius=0.7, loops=1)
    main, by_pass = galleries(options)
    assert main.radii.min() == pytest.approx(0.7, rel=0.1)
    assert main.radii.max() == pytest.approx(options.chamber_radius, rel=0.1)
    middle = by_pass.axis[len(by_pass.axis) // 2]
    apart = np.linalg.norm(main.axis - middle, axis=1) - main.radii - by_pass.radii[0]
    assert apart.min() > 0.8 * MIN_PILLAR  # the by-pass bows out farthest in its middle, the gallery anywhere


def test_the_wall_alone_closes_again() -> None:
    cave = gallery_cave(SMALL)
    closed = close_surface(cave.mesh, ReconstructionOptions(0.2, 0.5))
    assert closed.mesh.volume == pytest.approx(cave.truth.volume, rel=0.01)


@pytest.mark.parametrize(
    ("change", "message"), [({"voxel": 0.5}, "voxel"), ({"loops": -1}, "loops"), ({"length": 0.0}, "length")]
)
def test_options_without_sense_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(SMALL, **change)
