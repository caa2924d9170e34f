from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from aquanav_tools.cave.cavity import prove_watertight
from aquanav_tools.synthetic import networks as networks
from aquanav_tools.synthetic.networks import Network

CAVES = {
    "straight": networks.straight(),
    "curved": networks.curved(),
    "fork": networks.fork(),
    "loop": networks.loop(),
    "helix": networks.helix(),
    "chamber": networks.chamber(),
    "combination": networks.combination(),
}
POLYGON = 0.01
"""A regular polygon of 48 sides has 0.3 % less area than its circle; a sphere of such polygons 0.8 % less volume."""


@pytest.mark.parametrize("roughness", [0.0, 0.15])
@pytest.mark.parametrize("name", CAVES)
def test_a_network_is_closed_with_a_handle_per_loop_and_a_round_portal_per_opening(name: str, roughness: float) -> None:
    network = replace(CAVES[name], roughness=roughness)
    cavity = network.cavity()
    # Relief folds the wall over itself where passages meet, as scans do; it stays a closed 2-manifold.
    if roughness:
        assert cavity.mesh.to_trimesh().is_volume
    else:
        prove_watertight(cavity.mesh)
    assert cavity.mesh.to_trimesh().euler_number == 2 - 2 * network.num_loops
    radii = [radius for _, _, radius in network.openings]
    assert [portal.area for portal in cavity.portals] == pytest.approx(np.pi * np.square(radii), rel=POLYGON)
    assert network.scan().to_trimesh().euler_number == 2 - 2 * network.num_loops - len(radii)


@pytest.mark.parametrize("name", ["straight", "curved", "helix"])
def test_a_tube_has_the_volume_of_its_section_times_its_length(name: str) -> None:
    passage = CAVES[name].passages[0]
    assert CAVES[name].cavity().volume == pytest.approx(np.pi * passage.radius**2 * passage.length, rel=POLYGON)


def test_a_helix_has_the_length_of_a_helix() -> None:
    truth = 3.0 * np.hypot(2.0 * np.pi * 2.0, 3.0)
    # A chord of 0.25 m on a circle of 2 m is 0.07 % shorter than its arc.
    assert networks.helix(turn_radius=2.0, pitch=3.0, turns=3.0).passages[0].length == pytest.approx(truth, rel=1e-3)


def test_a_chamber_has_the_volume_of_a_sphere_and_two_cylinders_less_the_caps_in_it() -> None:
    radius, ball, length = 1.0, 2.5, 5.0
    height = ball - np.sqrt(ball**2 - radius**2)
    cap = np.pi * height**2 * (3 * ball - height) / 3
    truth = 4 / 3 * np.pi * ball**3 + 2 * (np.pi * radius**2 * (length + height) - cap)
    assert networks.chamber(radius, ball, length).cavity().volume == pytest.approx(truth, rel=POLYGON)


@pytest.mark.parametrize("name", ["fork", "loop", "combination"])
def test_a_branching_cave_has_the_volume_that_random_points_find(name: str, rng: np.random.Generator) -> None:
    network = CAVES[name]
    low, high = (side(network.cavity().mesh.vertices, axis=0) for side in (np.min, np.max))
    points = rng.uniform(low, high, (100_000, 3))
    share = is_inside(network, points).mean()
    box = float(np.prod(high - low))
    noise = 4 * np.sqrt(share * (1 - share) / len(points)) * box
    assert network.cavity().volume == pytest.approx(share * box, abs=noise + POLYGON * share * box)


def is_inside(network: Network, points: np.ndarray) -> np.ndarray:
    """Whether points are in a tube (not beyond a flat end) or a chamber, by their distances to the curves."""
    inside = np.zeros(len(points), dtype=bool)
    for passage in network.passages:
        share = np.linspace(0.0, 1.0, 10)[:, None]
        pieces = [a + share * (b - a) for a, b in zip(passage.axis[:-1], passage.axis[1:], strict=True)]
        inside |= cKDTree(np.concatenate(pieces)).query(points, distance_upper_bound=passage.radius)[0] < np.inf
    for centre, normal, radius in network.openings:
        inside &= ((points - centre) @ normal < 0) | (np.linalg.norm(points - centre, axis=1) > 1.5 * radius)
    for centre, radius in network.chambers:
        inside |= np.linalg.norm(points - centre, axis=1) < radius
    return inside


def test_roughness_moves_the_wall_and_not_the_openings() -> None:
    rough = replace(networks.straight(), roughness=0.2).cavity()
    to_wall = 1.0 - np.linalg.norm(rough.mesh.vertices[:, 1:], axis=1)
    middle = np.abs(rough.mesh.vertices[:, 0] - 6.0) < 4.0
    assert 0.05 < np.abs(to_wall[middle]).max() < 0.21
    assert [portal.centre[0] for portal in rough.portals] == [0.0, 12.0]


def test_the_same_seed_gives_the_same_walls() -> None:
    first, again, other = (replace(networks.fork(), roughness=0.2, seed=seed).cavity() for seed in (1, 1, 2))
    assert np.array_equal(first.mesh.vertices, again.mesh.vertices)
    assert abs(first.volume - other.volume) > 0.01
