from __future__ import annotations

import igl
import manifold3d
import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.cavity import WALL, Cavity, Portal, from_manifold, prove_watertight
from aquanav_tools.cave.closing.collision import CollisionMesh, collision_mesh
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.mesh.contact import Surface
from aquanav_tools.geometry.mesh.deviation import measure_deviation
from aquanav_tools.geometry.mesh.intersections import self_intersections
from aquanav_tools.synthetic.caves import tube
from aquanav_tools.types import Mesh

LENGTH = 6.0
BOUND = 0.02


def rough_tube() -> Cavity:
    """A passage of radius 1 with ripples of 4 cm, a portal at either end."""
    truth = tube(1.0, LENGTH, 72, 121).truth
    x, y, z = truth.vertices.T
    angle = np.arctan2(z, y)
    ripple = 1.0 + 0.04 * np.sin(7.0 * angle + 3.0 * x) * np.sin(2.0 * x)
    mesh = Mesh(np.stack([x, ripple * y, ripple * z], axis=1), truth.faces)
    labels = np.full(len(mesh.faces), WALL, dtype=np.int64)
    for label, end in ((1, 0.0), (2, LENGTH)):
        labels[np.all(np.abs(mesh.triangles[..., 0] - end) < 1e-9, axis=1)] = label
    ahead = np.array([1.0, 0.0, 0.0])
    portals = (Portal(1, np.zeros(3), -ahead, 3.1), Portal(2, LENGTH * ahead, ahead, 3.1))
    return Cavity(mesh, labels, labels == WALL, portals)


@pytest.fixture(scope="module")
def cavity() -> Cavity:
    return rough_tube()


@pytest.fixture(scope="module")
def collision(cavity: Cavity) -> CollisionMesh:
    return collision_mesh(cavity, BOUND)


def distance_to(mesh: Mesh, places: np.ndarray) -> np.ndarray:
    return np.sqrt(igl.point_mesh_squared_distance(places, mesh.vertices, mesh.faces)[0])


def test_it_has_far_fewer_triangles_and_is_still_a_proven_solid(cavity: Cavity, collision: CollisionMesh) -> None:
    assert collision.num_triangles_before == len(cavity.mesh.faces)
    assert len(collision.mesh.faces) < 0.4 * len(cavity.mesh.faces)
    assert collision.num_bytes == collision.mesh.vertices.astype("f4").nbytes + collision.mesh.faces.astype("u4").nbytes
    prove_watertight(collision.mesh)
    assert len(self_intersections(collision.mesh)) == 0


def test_neither_surface_strays_from_the_other_beyond_the_bound(
    cavity: Cavity, collision: CollisionMesh, rng: np.random.Generator
) -> None:
    seed = int(rng.integers(2**31))
    for mesh, target, stated in (
        (collision.mesh, cavity.mesh, max(collision.max_intrusion, collision.max_invention)),
        (cavity.mesh, collision.mesh, collision.max_loss),
    ):
        places, _ = trimesh.sample.sample_surface(mesh.to_trimesh(), 3000, seed=seed)
        distance = distance_to(target, places)
        # The error is measured every centimetre; half of that, along faces tilted by at most a tenth, is 0.5 mm.
        assert 0.3 * stated < distance.max() < stated + 0.0005
        assert stated <= BOUND


def test_intrusion_is_what_lies_in_the_water(
    cavity: Cavity, collision: CollisionMesh, rng: np.random.Generator
) -> None:
    places, _ = trimesh.sample.sample_surface(collision.mesh.to_trimesh(), 3000, seed=int(rng.integers(2**31)))
    is_inside = igl.winding_number(cavity.mesh.vertices, cavity.mesh.faces, places) > 0.5
    inside = np.where(is_inside, 1.0, -1.0) * distance_to(cavity.mesh, places)
    assert 0.3 * collision.max_intrusion < inside.max() < collision.max_intrusion + 0.0005
    assert 0.3 * collision.max_invention < -inside.min() < collision.max_invention + 0.0005


def test_portals_stay_flat(collision: CollisionMesh) -> None:
    x = collision.mesh.triangles[..., 0]
    corners = collision.mesh.triangles
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    for end in (0.0, LENGTH):
        # The rim may move by the bound, all along the perimeter.
        assert areas[np.all(x == end, axis=1)].sum() == pytest.approx(np.pi, abs=2 * np.pi * BOUND)


def test_coordinates_survive_32_bits(collision: CollisionMesh) -> None:
    assert np.array_equal(collision.mesh.vertices, collision.mesh.vertices.astype(np.float32))


def test_a_wall_much_thinner_than_the_bound_is_not_crossed() -> None:
    # A ball of water with a thin curved rock wall in it: each side
    # of the wall alone could move by ten times its thickness.
    def ball(radius: float) -> manifold3d.Manifold:
        return manifold3d.Manifold.sphere(radius, 96)

    wall = (ball(0.705) - ball(0.7)).translate([0.6, 0.0, 0.0]).trim_by_plane([0.0, 0.0, 1.0], -0.3)
    mesh = from_manifold(ball(1.0) - wall)
    labels = np.zeros(len(mesh.faces), dtype=np.int64)
    result = collision_mesh(Cavity(mesh, labels, labels == WALL, ()), 0.05)
    assert len(self_intersections(result.mesh)) == 0
    assert len(result.mesh.faces) < 0.8 * len(mesh.faces)
    assert result.max_loss <= 0.05


def test_a_cavity_that_crosses_itself_is_refused_with_the_place() -> None:
    torus = trimesh.creation.torus(1.0, 0.5, major_sections=24, minor_sections=12)
    vertices = np.array(torus.vertices)
    vertices[vertices[:, 0] > 0.9] -= [2.5, 0.0, 0.0]  # pulled through the other side
    labels = np.zeros(len(torus.faces), dtype=np.int64)
    mesh = Mesh(vertices, np.array(torus.faces, dtype=np.int64))
    with pytest.raises(MeshError, match=r"one near \[.*Repair the scan there"):
        collision_mesh(Cavity(mesh, labels, labels == WALL, ()), 0.001)


def test_deviation_of_a_sphere_from_a_larger_one_is_the_gap() -> None:
    inner, outer = (trimesh.creation.icosphere(4, radius) for radius in (1.0, 1.25))
    small, large = (Mesh(np.array(s.vertices), np.array(s.faces, dtype=np.int64)) for s in (inner, outer))
    deviation = measure_deviation(small, Surface(large), 20_000)
    # Facets of 5 degrees lie within 0.1 % of the radius of their sphere.
    assert deviation.distance == pytest.approx(0.25, abs=0.0015)
    assert set(deviation.faces) == set(range(len(small.faces)))
    assert len(deviation.faces_beyond(0.26)) == 0
    assert len(deviation.faces_beyond(0.24)) == len(small.faces)


def test_bullet_loads_it_as_a_hollow_mesh(collision: CollisionMesh) -> None:
    pybullet = pytest.importorskip("pybullet", reason="PyBullet is not installed")
    from aquanav_tools.sim.bullet import _load_cave

    client = pybullet.connect(pybullet.DIRECT)
    middle = np.array([LENGTH / 2, 0.0, 0.0])
    body = _load_cave(collision.mesh, middle, client)
    ray = pybullet.rayTest([0.0, 0.0, 0.0], [0.0, 0.0, 3.0], physicsClientId=client)[0]
    pybullet.disconnect(client)
    assert ray[0] == body
    assert 0.95 < 3.0 * ray[2] < 1.05  # from the middle the wall is as far as the ripples leave it
