"""The centreline graph: how the passages of a cave hang together, and how roomy they are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aquanav_tools.cave.centreline.skeleton import DEAD_END, JUNCTION, KINDS
from aquanav_tools.cave.route.route import Route
from aquanav_tools.geometry.polyline import length_of
from aquanav_tools.geometry.volume.geodesic import WALL_AVERSION
from aquanav_tools.types import Array, IntArray


@dataclass(frozen=True, eq=False)
class Node:
    """Where branches end or meet."""

    position: Array
    """(3,) m."""
    clearance: float
    """Distance to the nearest wall, m."""
    kind: str
    """One of "portal", "dead end", "junction" and "loop point" (an arbitrary place on a ring without junctions)."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"kind = '{self.kind}' is none of {', '.join(KINDS)}.")


@dataclass(frozen=True, eq=False)
class Branch:
    """A stretch of passage between two nodes."""

    start: int
    """Number of the node it starts at."""
    end: int
    """Number of the node it ends at; a loop may end where it starts."""
    points: Array
    """(K, 3) evenly spaced from node to node, m."""
    clearance: Array
    """(K,) distance to the nearest wall, m. A portal is no wall: at it, this is the passage's half width."""

    @property
    def length(self) -> float:
        """Metres along it."""
        return length_of(self.points)


@dataclass(frozen=True, eq=False)
class Chamber:
    """A place much wider than every passage that leads out of it."""

    centre: Array
    """(3,) the roomiest point of the centreline in it, m."""
    radius: float
    """Clearance there, m."""
    branch: int
    """Number of the branch that the centre lies on; any of those that meet there when it is a node."""


@dataclass(frozen=True, eq=False)
class CentrelineGraph:
    """Nodes, the branches between them, and chambers along them."""

    nodes: tuple[Node, ...] = ()
    branches: tuple[Branch, ...] = ()
    chambers: tuple[Chamber, ...] = ()

    def __post_init__(self) -> None:
        ends = [end for branch in self.branches for end in (branch.start, branch.end)]
        if ends and not 0 <= min(ends) <= max(ends) < len(self.nodes):
            raise ValueError(f"Branches end at nodes {min(ends)} to {max(ends)}, there are {len(self.nodes)} nodes.")
        if any(not 0 <= chamber.branch < len(self.branches) for chamber in self.chambers):
            raise ValueError(f"A chamber is on a branch that does not exist; there are {len(self.branches)}.")

    @property
    def num_junctions(self) -> int:
        """Places where three or more branches meet."""
        return sum(node.kind == JUNCTION for node in self.nodes)

    @property
    def num_dead_ends(self) -> int:
        """Branches' ends that are not open."""
        return sum(node.kind == DEAD_END for node in self.nodes)

    @property
    def num_loops(self) -> int:
        """Independent ways around pillars: the graph's cycle rank."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        ends = np.array([(branch.start, branch.end) for branch in self.branches], dtype=np.int64).reshape(-1, 2)
        links = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(self.nodes), len(self.nodes)))
        num_parts = connected_components(links, directed=False)[0] if self.nodes else 0
        return len(self.branches) - len(self.nodes) + int(num_parts)

    @property
    def length(self) -> float:
        """Metres of all branches."""
        return sum(branch.length for branch in self.branches)

    @cached_property
    def line(self) -> Line:
        """All branches as one set of points, each node once."""
        return _join(self.nodes, self.branches)

    def path(self, start: Array, end: Array) -> Route | None:
        """Return the wall-averse way along the centreline between the places nearest to two (3,) points.

        A metre costs (largest clearance / clearance) ** WALL_AVERSION, as for a route through the water. Nearest is
        the place whose ball reaches closest to the point, so that no wall is between them where a ball covers it.
        Returns None where the graph does not join the two.
        """
        from scipy.sparse.csgraph import dijkstra

        line = self.line
        here, there = line.nearest(start), line.nearest(end)
        costs, before = dijkstra(line.costs, directed=False, indices=here, return_predecessors=True)
        if not np.isfinite(costs[there]):
            return None
        way = [there]
        while way[-1] != here:
            way.append(int(before[way[-1]]))
        return Route(line.points[way[::-1]], line.clearance[way[::-1]])


NO_NETWORK = CentrelineGraph()
"""The graph of a cave that nobody looked for passages in."""


@dataclass(frozen=True, eq=False)
class Line:
    """The points of a graph: first its nodes, then those inside branches."""

    points: Array
    """(P, 3) m."""
    clearance: Array
    """(P,) m."""
    steps: IntArray
    """(E, 2) neighbouring points."""
    branch: IntArray
    """(P,) number of a branch through the point."""

    @cached_property
    def lengths(self) -> Array:
        """(E,) of the steps, m."""
        return np.asarray(np.linalg.norm(np.diff(self.points[self.steps], axis=1)[:, 0], axis=1))

    @cached_property
    def costs(self):  # type: ignore[no-untyped-def]  # a sparse array
        """(P, P) wall-averse cost of each step."""
        from scipy.sparse import csr_array

        roomiest = float(self.clearance.max())
        narrow = np.maximum(self.clearance[self.steps].mean(axis=1), 1e-6 * roomiest)
        # Never 0: that would mean no step.
        costs = np.maximum(self.lengths, 1e-9) * (roomiest / narrow) ** WALL_AVERSION
        return csr_array((costs, (self.steps[:, 0], self.steps[:, 1])), shape=(len(self.points), len(self.points)))

    def nearest(self, point: Array) -> int:
        """Return the point whose ball reaches closest to a (3,) point."""
        return int(np.argmin(np.linalg.norm(self.points - point, axis=1) - self.clearance))


def _join(nodes: tuple[Node, ...], branches: tuple[Branch, ...]) -> Line:
    count = len(nodes)
    points, clearance, steps = [np.zeros((0, 3))], [np.array([node.clearance for node in nodes])], []
    if nodes:
        points = [np.array([node.position for node in nodes])]
    owner = [np.zeros(len(nodes), dtype=np.int64)]
    for number, branch in enumerate(branches):
        inner = np.arange(count, count + len(branch.points) - 2)
        run = np.concatenate([[branch.start], inner, [branch.end]])
        steps.append(np.stack([run[:-1], run[1:]], axis=1))
        points.append(branch.points[1:-1])
        clearance.append(branch.clearance[1:-1])
        owner.append(np.full(len(inner), number))
        owner[0][[branch.start, branch.end]] = number
        count += len(inner)
    joined = np.concatenate(steps) if steps else np.zeros((0, 2), dtype=np.int64)
    return Line(np.concatenate(points), np.concatenate(clearance), joined, np.concatenate(owner))
