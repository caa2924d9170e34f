from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.cave.closing.close import close_surface
from aquanav_tools.cave.closing.evidence import Evidence, contradictions
from aquanav_tools.cave.scan.surface import surface_from_mesh
from aquanav_tools.errors import MeshError
from aquanav_tools.types import Mesh
from tests.cave.open_caves import straight, tube_volume

VOXEL = 0.1


def two_tubes(gap: float) -> Mesh:
    tube = straight()
    length = np.ptp(tube.vertices[:, 0])
    other = tube.vertices + [length + gap, 0.0, 0.0]
    return Mesh(np.vstack([tube.vertices, other]), np.vstack([tube.faces, tube.faces + len(other)]))


def close(mesh: Mesh, evidence: Evidence):
    surface = surface_from_mesh(mesh, VOXEL).mesh
    return close_surface(surface, VOXEL, keep_triangles=True, min_portal=0.8, evidence=evidence)


def test_points_and_legs_in_rock_are_found() -> None:
    closed = close(straight(), Evidence())
    inside = np.array([[5.0, 0.0, 0.0], [5.0, 3.0, 0.0], [5.0, 1.05, 0.0]])
    legs = np.array([[[1.0, 0, 0], [9.0, 0, 0]], [[1.0, 0, 0], [1.0, 4.0, 0]]])
    found = contradictions(closed.mesh, Evidence(inside, legs), VOXEL)
    # The third point lies half a voxel behind the wall, where stations are marked.
    assert found.points.tolist() == [1]
    assert found.legs.tolist() == [1]


def test_two_separate_caves_are_refused_unless_a_point_names_one() -> None:
    apart = two_tubes(3.0)
    with pytest.raises(MeshError, match=r"two separate caves: .* choose one with --inside") as refusal:
        close(apart, Evidence())
    assert len(refusal.value.places) == 2
    second = close(apart, Evidence(np.array([[18.0, 0.0, 0.0]])))
    assert second.mesh.vertices[:, 0].min() > 11.0
    assert second.mesh.to_trimesh().volume == pytest.approx(tube_volume(10.0), rel=0.02)


def test_a_leg_through_a_stretch_that_was_not_scanned_keeps_it_open() -> None:
    legs = np.array([[[5.0, 0.0, 0.0], [16.0, 0.0, 0.0]]])
    evidence = Evidence(legs=legs)
    closed = close(two_tubes(1.0), evidence)
    assert contradictions(closed.mesh, evidence, VOXEL).count == 0
    assert np.ptp(closed.mesh.vertices[:, 0]) == pytest.approx(21.0, abs=4 * VOXEL)


def test_water_that_the_scan_contradicts_is_an_error() -> None:
    with pytest.raises(MeshError, match="known to be water end up in rock"):
        close(straight(), Evidence(np.array([[5.0, 5.0, 0.0]])))
