"""Finding the centreline graph of a cave.

The water is thinned to a curve skeleton that joins the portals (`thinning`), dead ends that the skeleton's balls do not
reach into are added as further anchors (`dead_ends`), the samples that are left become nodes and links (`skeleton`),
and these are moved to the middle of their passages with exact distances to the wall (`centring`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.centreline.centring import Wall, centre, smooth
from aquanav_tools.cave.centreline.chambers import find_chambers
from aquanav_tools.cave.centreline.dead_ends import find_tips
from aquanav_tools.cave.centreline.graph import Branch, CentrelineGraph, Node
from aquanav_tools.cave.centreline.lattice import Lattice, sample_water
from aquanav_tools.cave.centreline.skeleton import DEAD_END, JUNCTION, PORTAL, Link, Skeleton, merge_junctions, trace
from aquanav_tools.cave.centreline.thinning import thin
from aquanav_tools.geometry.polyline import arc_lengths, resample
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.types import Array, BoolArray, IntArray

MAX_SAMPLES = 3_000_000
"""Samples of water that are thinned; 26 neighbours of each are 0.3 GB. 300 m of passage 3 m wide at 0.1 m are 2.1 M."""
NUM_ROUNDS = 2
"""How often a line is centred and smoothed: the first round straightens the steps of the samples out of its way."""
FAINT, PINNED = 1e-2, 1e4
"""Weights in a fit, against 1 of other points: inside a junction's ball, and of an end that must be passed through."""
BEND_REACH = 2.0
"""Length of branch beyond a junction's ball that tells where the branch comes from, in radii of that ball."""
MAX_JUNCTION_MOVE = 0.5
"""A junction moves at most this far from where thinning left it, in clearances."""


@dataclass(frozen=True)
class CentrelineOptions:
    """How the centreline graph is found."""

    max_samples: int = MAX_SAMPLES
    """Samples of water that are thinned; fewer miss narrow side passages and thin pillars."""

    def __post_init__(self) -> None:
        if self.max_samples < 1000:
            raise ValueError(f"max_samples = {self.max_samples} is too few for any passage; give at least 1000.")


def find_centreline(
    cavity: Cavity, field: DistanceField, options: CentrelineOptions = CentrelineOptions()
) -> CentrelineGraph:
    """Return the centreline graph of a cave.

    A branch ends at the centre of a portal or at the tip of a dead end, which lies one clearance from the end of the
    water straight ahead. There is one loop around each pillar that shows at the spacing of the samples; water with
    less clearance than 0.87 spacings counts as rock.

    Raises:
        MeshError: no water is wide enough for the field's spacing.
    """
    lattice = sample_water(field, options.max_samples)
    portals = np.array(
        [lattice.nearest(portal.centre - lattice.spacing * portal.normal) for portal in cavity.portals], dtype=np.int64
    )
    wall = Wall(cavity, field)
    skeleton = trace(lattice, _thin_with_tips(lattice, portals), portals)
    skeleton = merge_junctions(skeleton, wall.clearance(skeleton.positions))
    skeleton = _at_portals(skeleton, np.array([portal.centre for portal in cavity.portals]).reshape(-1, 3))
    return _finish(_centred(skeleton, wall, lattice.spacing), wall, lattice.spacing)


def _thin_with_tips(lattice: Lattice, portals: IntArray) -> BoolArray:
    """Return what thinning leaves around the portals and all tips of dead ends."""
    roots = _roomiest_without(lattice, portals)
    anchors = np.unique(np.append(portals, roots))
    while True:
        is_left = thin(lattice, anchors)
        tips = np.setdiff1d(find_tips(lattice, is_left), anchors)
        if len(tips) == 0:
            return is_left
        # A root is where the search starts in a part without portals; once there are tips, these hold its skeleton.
        is_done = np.isin(anchors, roots) & np.isin(lattice.part[anchors], lattice.part[tips])
        anchors, roots = np.append(anchors[~is_done], tips), np.setdiff1d(roots, anchors[is_done])


def _roomiest_without(lattice: Lattice, portals: IntArray) -> IntArray:
    """Return the roomiest sample of each part of the water that has no portal."""
    bare = np.setdiff1d(np.unique(lattice.part), lattice.part[portals])
    roomiest = [np.argmax(np.where(lattice.part == part, lattice.clearance, -1.0)) for part in bare]
    return np.array(roomiest, dtype=np.int64)


def _at_portals(skeleton: Skeleton, centres: Array) -> Skeleton:
    """Return the skeleton with its first nodes at the portals' centres."""
    positions = skeleton.positions.copy()
    positions[: len(centres)] = centres
    return _with_ends(replace(skeleton, positions=positions))


def _with_ends(skeleton: Skeleton) -> Skeleton:
    """Return the skeleton with every link's ends at its nodes."""
    links = []
    for link in skeleton.links:
        points = link.points.copy()
        points[[0, -1]] = skeleton.positions[[link.start, link.end]]
        links.append(replace(link, points=points))
    return replace(skeleton, links=tuple(links))


def _centred(skeleton: Skeleton, wall: Wall, step: float) -> Skeleton:
    """Return the skeleton with links in the middle of passages, junctions where links meet, tips at one clearance."""
    links = tuple(_centre_link(link, skeleton, wall, step) for link in skeleton.links)
    skeleton = replace(skeleton, links=links)
    positions = skeleton.positions.copy()
    for node, kind in enumerate(skeleton.kinds):
        if kind == JUNCTION:
            positions[node] = _meeting_point(skeleton, node, wall)
        elif kind == DEAD_END:
            positions[node] = _tip(skeleton, node, wall, step)
    skeleton = replace(skeleton, positions=positions)
    return replace(skeleton, links=tuple(_straight_in_balls(link, skeleton, wall, step) for link in skeleton.links))


def _centre_link(link: Link, skeleton: Skeleton, wall: Wall, step: float) -> Link:
    """Return a link in the middle of its passage; only the tip of a dead end moves of its ends."""
    kinds = skeleton.kinds[link.start], skeleton.kinds[link.end]
    points = resample(link.points, step)
    if len(points) < 3:
        return link
    points = _smooth_link(points, kinds, wall)
    for _ in range(NUM_ROUNDS):
        points = resample(_smooth_link(_with_fixed_ends(centre(points, wall), points, kinds), kinds, wall), step)
    return replace(link, points=points)


def _smooth_link(points: Array, kinds: tuple[str, str], wall: Wall) -> Array:
    """Return the points smoothed; what lies in a junction's ball is hardly heard, since no wall guides it there."""
    clearance = wall.clearance(points)
    weights = np.ones(len(points))
    for end, kind in zip((0, -1), kinds, strict=True):
        if kind == JUNCTION:
            weights[np.linalg.norm(points - points[end], axis=1) < clearance[end]] = FAINT
        elif kind != DEAD_END:
            weights[end] = PINNED
    return _with_fixed_ends(smooth(points, clearance, weights), points, kinds)


def _with_fixed_ends(moved: Array, points: Array, kinds: tuple[str, str]) -> Array:
    is_fixed = [kind != DEAD_END for kind in kinds]
    return np.vstack(
        [points[:1] if is_fixed[0] else moved[:1], moved[1:-1], points[-1:] if is_fixed[1] else moved[-1:]]
    )


def _ends_at(skeleton: Skeleton, node: int) -> list[Array]:
    """Return the points of every link that ends at a node, from the node on."""
    starts = [link.points for link in skeleton.links if link.start == node]
    return starts + [link.points[::-1] for link in skeleton.links if link.end == node]


def _meeting_point(skeleton: Skeleton, node: int, wall: Wall) -> Array:
    """Return where the links of a junction meet when each is carried on as it comes to the junction's ball.

    Inside that ball passages have no walls between them, so that the middle of one is not defined.
    """
    origin = skeleton.positions[node]
    radius = float(wall.clearance(origin[None])[0])
    point = origin
    for _ in range(3):
        across, pull = 0.1 * np.eye(3), 0.1 * origin
        for points in _ends_at(skeleton, node):
            nearest, direction = _carried_on(points, origin, radius, point)
            square = np.eye(3) - np.outer(direction, direction)
            across, pull = across + square, pull + square @ nearest
        point = np.linalg.solve(across, pull)
    move = point - origin
    return np.asarray(origin + move * min(1.0, MAX_JUNCTION_MOVE * radius / max(float(np.linalg.norm(move)), 1e-12)))


def _carried_on(points: Array, origin: Array, radius: float, target: Array) -> tuple[Array, Array]:
    """Return the point nearest to a target, and the direction there, on a parabola fitted to a link past the ball."""
    distances = np.linalg.norm(points - origin, axis=1)
    first = int(np.argmax(distances > radius)) if (distances > radius).any() else 0
    along = arc_lengths(points)
    used = (np.arange(len(points)) >= first) & (along <= along[first] + BEND_REACH * radius)
    degree = min(2, int(used.sum()) - 1)
    if degree < 1:
        return points[0], (points[-1] - points[0]) / max(float(np.linalg.norm(points[-1] - points[0])), 1e-12)
    curve = np.polynomial.polynomial.polyfit(along[used], points[used], degree)
    places = np.linspace(-radius, along[first], 100)
    path = np.polynomial.polynomial.polyval(places, curve).T
    n = int(np.clip(np.argmin(np.linalg.norm(path - target, axis=1)), 1, 98))
    direction = path[n + 1] - path[n - 1]
    return path[n], direction / max(float(np.linalg.norm(direction)), 1e-12)


def _tip(skeleton: Skeleton, node: int, wall: Wall, step: float) -> Array:
    """Return the first place within two steps of a link's end where the wall straight ahead is one clearance away."""
    points = _ends_at(skeleton, node)[0]
    tip, behind = points[0], points[min(len(points) - 1, 5)]
    ahead = (tip - behind) / max(float(np.linalg.norm(tip - behind)), 1e-12)
    radius = float(wall.clearance(tip[None])[0])
    start = tip - min(2.0 * step, float(np.linalg.norm(tip - behind))) * ahead
    to_wall = wall.ahead(start, ahead, 4.0 * (step + radius))
    shifts = np.linspace(0.0, 4.0 * step, 41)
    trials = start + shifts[:, None] * ahead
    touches = to_wall - shifts <= wall.clearance(trials) + 0.1 * step
    return np.asarray(trials[np.argmax(touches)] if touches.any() else tip)


def _straight_in_balls(link: Link, skeleton: Skeleton, wall: Wall, step: float) -> Link:
    """Return a link that runs straight inside the balls of the junctions at its ends, where nothing else guides it."""
    points = link.points
    for is_end in (False, True):
        node = link.end if is_end else link.start
        points = points[::-1] if is_end else points
        kind, position = skeleton.kinds[node], skeleton.positions[node]
        if kind == JUNCTION:
            radius = float(wall.clearance(position[None])[0])
            points = np.vstack([position, _beyond(points, position, radius)])
        elif kind == DEAD_END:
            points = np.vstack([position, _beyond(points, position, 2.0 * step)])
        points = points[::-1] if is_end else points
    return replace(link, points=resample(points, step))


def _beyond(points: Array, position: Array, radius: float) -> Array:
    """Return the points from where a line leaves a ball for good, its farthest point and last one at least."""
    distances = np.linalg.norm(points - position, axis=1)
    farthest = int(np.argmax(distances))
    return points[farthest if distances[farthest] <= radius else int(np.argmax(distances > radius)) :]


def _finish(skeleton: Skeleton, wall: Wall, step: float) -> CentrelineGraph:
    nodes = tuple(
        Node(position, float(clearance), kind)
        for position, clearance, kind in zip(
            skeleton.positions, wall.clearance(skeleton.positions), skeleton.kinds, strict=True
        )
    )
    branches = tuple(Branch(link.start, link.end, link.points, wall.clearance(link.points)) for link in skeleton.links)
    graph = CentrelineGraph(nodes, branches)
    portals = np.array([n for n, node in enumerate(nodes) if node.kind == PORTAL], dtype=np.int64)
    return replace(graph, chambers=find_chambers(graph.line, portals))
