"""Corrections of sampled water, against shapes known in closed form."""

import numpy as np

from aquanav_tools.cave.closing.field_edits import NO_EDITS, FieldEdits, apply_edits

VOXEL = 0.1
COUNT = 48


def _distances(points: tuple[float, float, float]) -> np.ndarray:
    places = VOXEL * np.stack(np.meshgrid(*[np.arange(COUNT)] * 3, indexing="ij"), axis=-1)
    return np.linalg.norm(places - points, axis=-1)


def test_a_leg_through_rock_is_a_capsule_of_water_and_nothing_else_changes() -> None:
    rock = np.full((COUNT,) * 3, 2.0)
    start, end = np.array([1.0, 2.4, 2.4]), np.array([3.0, 2.4, 2.4])
    edits = FieldEdits(np.array([[start, end]]), np.array([0.15]), NO_EDITS.spurious, 0.0)
    places = VOXEL * np.stack(np.meshgrid(*[np.arange(COUNT)] * 3, indexing="ij"), axis=-1)
    across = np.hypot(places[..., 1] - 2.4, places[..., 2] - 2.4)
    beyond = np.maximum(np.maximum(1.0 - places[..., 0], places[..., 0] - 3.0), 0.0)
    expected = np.minimum((np.hypot(across, beyond) - 0.15) / VOXEL, 2.0)
    assert np.allclose(apply_edits(rock, rock, np.zeros(3), VOXEL, edits), expected, atol=1e-9)
    assert (rock == 2.0).all()


def test_each_leg_is_as_wide_as_its_own_radius() -> None:
    rock = np.full((COUNT,) * 3, 2.0)
    legs = np.array([[[1.0, 1.2, 2.4], [3.0, 1.2, 2.4]], [[1.0, 3.6, 2.4], [3.0, 3.6, 2.4]]])
    water = apply_edits(
        rock, rock, np.zeros(3), VOXEL, FieldEdits(legs, np.array([0.15, 0.45]), NO_EDITS.spurious, 0.0)
    )
    areas = [(water[20, half] < 0.0).sum() * VOXEL**2 for half in (slice(0, 24), slice(24, 48))]
    # Of samples, the circle of a radius holds its area to about its girth times a third of a sample.
    for area, radius in zip(areas, (0.15, 0.45), strict=True):
        assert abs(area - np.pi * radius**2) < 2.0 * np.pi * radius * VOXEL / 3.0


def test_a_pillar_alone_in_its_surroundings_drowns() -> None:
    pillar = np.clip(_distances((2.4, 2.4, 2.4)) / VOXEL - 0.9, None, 2.0)
    field = np.where(pillar < 0.0, 2.0, -2.0)
    edits = FieldEdits(NO_EDITS.legs, NO_EDITS.leg_radii, np.array([[2.4, 2.4, 2.4, 0.5, 0.0]]), 1.5 * VOXEL)
    assert (field > 0.0).any()
    assert (apply_edits(field, np.abs(field), np.zeros(3), VOXEL, edits) < 0.0).all()
