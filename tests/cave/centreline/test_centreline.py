from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from aquanav_tools.cave.centreline.find import CentrelineOptions, find_centreline
from aquanav_tools.cave.centreline.graph import CentrelineGraph
from aquanav_tools.errors import MeshError, ScenarioError
from aquanav_tools.geometry.volume.distance import distance_field
from aquanav_tools.scenario.folder import read_scenario, write_scenario
from aquanav_tools.scenario.geometry import read_network, write_guide
from aquanav_tools.synthetic import networks as networks
from aquanav_tools.synthetic.networks import Network, Passage
from tests.caves import tube_scenario

SPACING = 0.2
"""Five samples to the radius of a passage."""
RELIEF = 0.15
X = np.array([1.0, 0.0, 0.0])
CAVES = {
    "straight": networks.straight(length=8.0),
    "curved": networks.curved(),
    "fork": networks.fork(length=6.0),
    "loop": networks.loop(length=3.0),
    "helix": networks.helix(turns=2.0),
    "chamber": networks.chamber(length=4.0),
    "combination": networks.combination(),
}


@cache
def centreline(network: Network, spacing: float = SPACING) -> CentrelineGraph:
    cavity = network.cavity()
    return find_centreline(cavity, distance_field(cavity.mesh, spacing))


def axis_points(network: Network) -> np.ndarray:
    """Points on the true axes, closer together than any tolerance here."""
    share = np.linspace(0.0, 1.0, 50)[:, None]
    pieces = [a + share * (b - a) for p in network.passages for a, b in zip(p.axis[:-1], p.axis[1:], strict=True)]
    return np.concatenate(pieces) @ np.array(network.rotation).T


def counts(graph: CentrelineGraph) -> tuple[int, int, int, int]:
    return graph.num_junctions, graph.num_loops, graph.num_dead_ends, len(graph.chambers)


def true_counts(network: Network) -> tuple[int, int, int, int]:
    return network.num_junctions, network.num_loops, network.num_dead_ends, len(network.chambers)


def check(network: Network, graph: CentrelineGraph, spacing: float) -> None:
    """All that the issue asks: counts, length within 1 %, clearance within half a spacing of the passage's radius."""
    assert counts(graph) == true_counts(network)
    truth = sum(passage.length for passage in network.passages)
    assert graph.length == pytest.approx(truth, rel=0.01)
    assert len(graph.branches) == len(network.passages)
    off_axis = cKDTree(axis_points(network)).query(graph.line.points)[0]
    assert off_axis.max() < 0.5 * spacing + network.roughness
    in_chamber = np.zeros(len(graph.line.points), dtype=bool)
    for centre, radius in network.chambers:
        in_chamber |= np.linalg.norm(graph.line.points - np.array(network.rotation) @ centre, axis=1) < radius
    clearance = graph.line.clearance[~in_chamber]
    # The relief brings the wall closer by up to its height, and takes the line off the axis into its bays.
    assert np.abs(clearance - network.passages[0].radius).max() < 0.5 * spacing + network.roughness


@pytest.mark.parametrize("name", CAVES)
def test_the_centreline_of_a_smooth_cave_is_its_axes(name: str) -> None:
    graph = centreline(CAVES[name])
    check(CAVES[name], graph, SPACING)
    # Where branches meet, the balls of the passages are one: a junction is known to 0.15 of a radius (seen: 0.14).
    slack = 0.15 * CAVES[name].passages[0].radius
    lengths, truth = sorted(b.length for b in graph.branches), sorted(p.length for p in CAVES[name].passages)
    assert lengths == pytest.approx(truth, rel=0.01, abs=slack if graph.num_junctions else None)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name not in ("fork", "loop", "combination"))) for name in CAVES],
)
def test_the_centreline_of_a_rough_cave_is_its_axes_but_for_the_relief(name: str) -> None:
    network = replace(CAVES[name], roughness=RELIEF, seed=3)
    check(network, centreline(network), SPACING)


@pytest.mark.parametrize(
    ("name", "spacing"), [pytest.param("fork", 0.12, marks=pytest.mark.slow), ("loop", 0.25), ("combination", 0.3)]
)
def test_other_spacings_find_the_same_cave(name: str, spacing: float) -> None:
    network = CAVES[name]
    check(network, centreline(network, spacing), spacing)


@pytest.mark.parametrize("name", ["fork", "helix", "combination"])
def test_the_graph_turns_with_the_cave(name: str, rng: np.random.Generator) -> None:
    rotation = Rotation.random(random_state=int(rng.integers(1 << 30)))
    network = CAVES[name].turned(rotation.as_matrix())
    check(network, centreline(network), SPACING)


def test_branches_end_at_the_portals_and_at_the_tip_of_the_dead_end() -> None:
    network = CAVES["combination"]
    graph = centreline(network)
    portals = [node.position for node in graph.nodes if node.kind == "portal"]
    assert np.allclose(portals, [centre for centre, _, _ in network.openings], atol=1e-9)
    tip = next(node for node in graph.nodes if node.kind == "dead end")
    # The passage ends in a ball around the end of its axis, which is one clearance from the end of the water.
    assert np.linalg.norm(tip.position - network.passages[-1].axis[-1]) < 0.5 * SPACING
    for branch in graph.branches:
        assert np.allclose(branch.points[[0, -1]], [graph.nodes[n].position for n in (branch.start, branch.end)])
        steps = np.linalg.norm(np.diff(branch.points, axis=0), axis=1)
        assert steps.max() < 1.02 * steps.min()  # chords of an evenly divided polyline, cut short at its corners


def test_a_chamber_is_the_sphere() -> None:
    chamber = centreline(CAVES["chamber"]).chambers[0]
    assert np.linalg.norm(chamber.centre) < SPACING
    assert chamber.radius == pytest.approx(2.5, abs=0.5 * SPACING + 0.01 * 2.5)  # half a step off, and a polyhedron


def test_a_cave_without_portals_is_a_line_between_its_two_ends() -> None:
    network = Network((Passage(CAVES["curved"].passages[0].axis, 1.0),), num_dead_ends=2)
    graph = centreline(network)
    check(network, graph, SPACING)


def test_a_ring_without_portals_is_one_loop() -> None:
    halves = [Passage(passage.axis, 1.0) for passage in CAVES["loop"].passages[1:3]]
    graph = centreline(Network(tuple(halves), num_loops=1))
    assert counts(graph) == (0, 1, 0, 0)
    assert [node.kind for node in graph.nodes] == ["loop point"]
    assert graph.length == pytest.approx(2.0 * np.pi * 3.0, rel=0.01)


def test_niches_shallower_than_the_passage_is_wide_are_no_dead_ends() -> None:
    aside = np.array([0.0, 1.0, 0.0])
    niche = Passage(np.linspace(4.0 * X, 4.0 * X + 1.5 * aside, 7), 0.4)  # ends in a ball: 0.9 m beyond the wall
    deep = Passage(np.linspace(4.0 * X, 4.0 * X + 4.5 * aside, 19), 0.4)
    main = CAVES["straight"].passages[0]
    assert counts(centreline(Network((main, niche)), 0.1)) == (0, 0, 0, 0)
    assert counts(centreline(Network((main, deep)), 0.1)) == (1, 0, 1, 0)


def test_a_path_takes_the_roomier_side_of_a_loop() -> None:
    first, left, right, last = CAVES["loop"].passages
    graph = centreline(Network((first, replace(left, radius=0.6), right, last)))
    path = graph.path(first.axis[0], last.axis[-1])
    assert path is not None
    assert path.length == pytest.approx(first.length + right.length + last.length, rel=0.02)
    assert path.points[:, 1].min() < -2.5
    assert np.allclose(path.points[[0, -1]], [first.axis[0], last.axis[-1]])


def test_parts_behind_a_solid_wall_have_no_path() -> None:
    near = Passage(np.linspace(0.0 * X, 6.0 * X, 25), 1.0, (True, False))
    far = Passage(near.axis + [0.0, 5.0, 0.0], 1.0, (True, False))
    graph = centreline(Network((near, far)))
    assert graph.num_loops == 0
    assert graph.path(near.axis[0], far.axis[0]) is None


def test_water_too_narrow_for_the_samples_is_refused_with_both_numbers() -> None:
    cavity = CAVES["straight"].cavity()
    field = distance_field(cavity.mesh, 0.3)
    with pytest.raises(MeshError, match=r"roomiest place has \d\.\d\d m of clearance, the samples are 0\.30 m apart"):
        find_centreline(replace(cavity), replace(field, samples=np.minimum(field.samples, np.float32(0.1))))
    with pytest.raises(ValueError, match="max_samples = 10"):
        CentrelineOptions(max_samples=10)


def test_a_scenario_keeps_its_network(tmp_path: Path) -> None:
    graph = centreline(CAVES["combination"])
    read = write_scenario(replace(tube_scenario(), network=graph), tmp_path / "tube").network
    assert [node.kind for node in read.nodes] == [node.kind for node in graph.nodes]
    assert np.array_equal(read.line.points, graph.line.points)
    assert np.array_equal(read.line.clearance, graph.line.clearance)
    assert [chamber.radius for chamber in read.chambers] == [chamber.radius for chamber in graph.chambers]
    assert counts(read) == counts(graph)


def test_a_scenario_without_a_network_has_an_empty_one(tmp_path: Path) -> None:
    write_scenario(tube_scenario(), tmp_path / "tube")
    network = read_scenario(tmp_path / "tube").network
    assert (network.nodes, network.num_loops, network.length) == ((), 0, 0)


@pytest.mark.parametrize(
    ("old", "new"),
    [('"kind": "portal"', '"kind": "door"'), ('"start": 0', '"start": 99'), ('"radius": ', '"radios": ')],
)
def test_a_damaged_network_is_refused(old: str, new: str, tmp_path: Path) -> None:
    scenario = tube_scenario()
    path = tmp_path / "guide.json"
    write_guide(scenario.guide, scenario.cavity.portals, path, centreline(CAVES["combination"]))
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ScenarioError, match="no valid centreline graph"):
        read_network(path)
