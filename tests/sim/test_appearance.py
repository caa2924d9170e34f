from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.sim.appearance import boat_mesh, vehicle_mesh
from aquanav_tools.sim.boat import load_boat
from aquanav_tools.sim.vehicle import known_vehicles, load_vehicle, parse_vehicle, vehicle_path
from aquanav_tools.types import Mesh

OWN = vehicle_path("bluerov2-heavy").read_text().replace('name = "bluerov2-heavy"', 'name = "mine"')


def shapes() -> dict[str, Mesh]:
    return {name: vehicle_mesh(load_vehicle(name)) for name in known_vehicles()} | {
        "otter": boat_mesh(load_boat("otter"))
    }


@pytest.mark.parametrize("name", [*known_vehicles(), "otter"])
def test_a_shape_is_of_solid_triangles_with_colours(name: str) -> None:
    mesh = shapes()[name]
    assert mesh.colours is not None and mesh.colours.shape == mesh.vertices.shape
    assert (mesh.areas > 0.0).all()
    assert mesh.volume > 0.0  # normals outwards
    assert len(mesh.faces) < 3000  # every recording carries it


@pytest.mark.parametrize(
    ("name", "size"), [("bluerov2", (0.457, 0.338, 0.254)), ("bluerov2-heavy", (0.457, 0.575, 0.254))]
)
def test_a_bluerov2_is_as_large_as_its_data_sheet_says(name: str, size: tuple[float, ...]) -> None:
    spans = np.ptp(vehicle_mesh(load_vehicle(name)).vertices, axis=0)
    np.testing.assert_allclose(spans, size, atol=0.01)  # its capsule rounds the width; a nozzle's rim sticks out


def test_thrusters_are_drawn_where_the_file_has_them() -> None:
    heavy = load_vehicle("bluerov2-heavy")
    vertices = vehicle_mesh(heavy).vertices
    for place in heavy.thrusters.positions:  # type: ignore[attr-defined]
        assert (np.linalg.norm(vertices - place, axis=1) < 0.06).sum() >= 64, place


def test_a_vehicle_of_ones_own_looks_like_its_capsule_with_its_thrusters() -> None:
    own = parse_vehicle(OWN, "mine.toml")
    vertices = vehicle_mesh(own).vertices
    assert np.ptp(vertices[:, 0]) == pytest.approx(own.capsule.length, abs=0.02)
    assert np.ptp(vertices[:, 1]) == pytest.approx(2.0 * own.capsule.radius, abs=0.02)


def test_a_boats_hulls_are_drawn_exactly() -> None:
    otter = load_boat("otter")
    vertices = boat_mesh(otter).vertices
    for hull in otter.hulls:
        for z in (hull.position[2] - 0.5 * hull.height, hull.position[2] + 0.5 * hull.height):
            for corner in hull.outline:
                assert np.linalg.norm(vertices - [*corner, z], axis=1).min() < 1e-9


def test_the_originals_boat_fills_its_capsule_from_above() -> None:
    boat = load_vehicle("boat")
    spans = np.ptp(vehicle_mesh(boat).vertices, axis=0)
    np.testing.assert_allclose(spans[:2], [boat.capsule.length, 2.0 * boat.capsule.radius], rtol=0.01)
