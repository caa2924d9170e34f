"""Handles: where the water goes around rock, or rock around water, and how large each such place is."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numba
import numpy as np

from aquanav_tools.cave.mesh.half_edges import HalfEdges, cut_and_cap, following, half_edges, preceding
from aquanav_tools.types import Array, IntArray, Mesh

NUM_ROOTS = 24
"""Random places tried beside the first when a handle's tightest loop is sought."""
NUM_REROOTS = 4
"""Places along a loop from which a shorter one is sought."""
SHORTER = 0.995
"""A loop is tight when re-rooting makes it no shorter than this share."""
FAN_DEPTHS = np.array([0.25, 0.5, 0.75])
"""Where, between a loop's centre and the loop, it is asked whether a disc over the loop lies in water."""


@dataclass(frozen=True, eq=False)
class Handle:
    """A pillar, an arch, a window or a ring of passages: whatever makes the surface unlike a sphere."""

    points: Array
    """(K, 3) the loop around its thin place, along edges of the surface, m. Closed: the last joins the first."""
    length: float
    """Length of the loop, m."""
    is_pillar: bool
    """True if the loop goes around rock (one can swim around it); False if around water (one could swim through)."""

    @property
    def centre(self) -> Array:
        """(3,) mean of the loop, m."""
        return self.points.mean(axis=0)

    @property
    def diameter(self) -> float:
        """Diameter of the circle as long as the loop, m: how thick the pillar or how wide the window is."""
        return self.length / np.pi


def genus(mesh: Mesh) -> int:
    """Return the number of handles of a closed mesh, all its components together.

    Raises:
        MeshError: the mesh is not closed.
    """
    return len(_tree_and_cotree(*half_edges(mesh)[:3])[1]) // 2


def find_handles(mesh: Mesh, seed: int = 0) -> tuple[Handle, ...]:
    """Return the handles of a closed mesh, as many as its genus, thinnest first.

    Again and again a short loop that does not divide the surface is found, and the surface is cut along it and capped,
    which removes that handle, until none is left. Whether a loop divides is read off a closed 1-form with random
    periods: its sum along a loop vanishes where the loop bounds a piece of surface, and hardly ever elsewhere. A
    loop is the shortest through some vertex, tightened by starting again from its own vertices and from random ones;
    it follows edges, so it is up to about 15 % longer than the tightest curve.

    Args:
        mesh: closed, outward normals.
        seed: picks the places where loops are sought.

    Raises:
        MeshError: the mesh is not closed.
    """
    rng = np.random.default_rng(seed)
    surface = half_edges(mesh)
    loops = []
    while (loop := _tight_loop(surface, rng)) is not None:
        loops.append((surface.points[surface.tail[loop]], float(surface.length[loop].sum())))
        surface = cut_and_cap(surface, loop)
    is_pillar = _go_around_rock(mesh, [points for points, _ in loops])
    handles = [Handle(*loop, pillar) for loop, pillar in zip(loops, is_pillar, strict=True)]
    return tuple(sorted(handles, key=lambda handle: handle.length))


def _go_around_rock(mesh: Mesh, loops: list[Array]) -> list[bool]:
    """Return for each (K, 3) loop whether most of the cone from it to its centre lies in rock."""
    import igl

    if not loops:
        return []
    fans = [(points.mean(axis=0) + FAN_DEPTHS[:, None, None] * (points - points.mean(axis=0))) for points in loops]
    places = np.concatenate([fan.reshape(-1, 3) for fan in fans])
    is_rock = np.asarray(igl.fast_winding_number(mesh.vertices, mesh.faces, places)) < 0.5
    ends = np.cumsum([len(FAN_DEPTHS) * len(points) for points in loops])[:-1]
    return [bool(part.mean() > 0.5) for part in np.split(is_rock, ends)]


def _tight_loop(surface: HalfEdges, rng: np.random.Generator) -> IntArray | None:
    """Return the half-edges of a short loop that does not divide the surface, or None on a sphere."""
    order, free, parents = _tree_and_cotree(*surface[:3])
    if not len(free):
        return None
    form = _closed_form(surface.twin, order, parents, free, rng.integers(-(2**62), 2**62, len(free)))
    roots = np.concatenate([surface.tail[free[:1]], rng.integers(0, len(surface.first), NUM_ROOTS)])
    best = np.zeros(0, dtype=np.int64)
    length = np.inf
    for root in roots:
        best, length = _improve(surface, form, best, length, root)
    while True:
        before = length
        for root in surface.tail[best[:: max(1, len(best) // NUM_REROOTS)]]:
            best, length = _improve(surface, form, best, length, root)
        if length >= SHORTER * before:
            return best


def _improve(surface: HalfEdges, form: IntArray, best: IntArray, length: float, root: int) -> tuple[IntArray, float]:
    """Return the better of a loop and the shortest one through a vertex, and its length."""
    loop = _loop_through(surface, form, root, length)
    loop_length = float(surface.length[loop].sum())
    return (loop, loop_length) if len(loop) and loop_length < length else (best, length)


@numba.njit(cache=True)
def _tree_and_cotree(tail, twin, first):  # type: ignore[no-untyped-def]
    """Return a spanning tree of the faces that crosses no edge of a spanning tree of the vertices.

    Returns:
        (F,) faces, parents before children; (2 g,) one half-edge of each edge in neither tree; (F,) half-edge of each
        face that leads to its parent, or -1.
    """
    in_tree = np.zeros(len(tail), np.bool_)
    reached = np.zeros(len(first), np.bool_)
    queue = np.empty(len(first), np.int64)
    count = 0
    for root in range(len(first)):
        if reached[root]:
            continue
        reached[root] = True
        queue[0], done, count = root, 0, 1
        while done < count:
            start = edge = first[queue[done]]
            done += 1
            while True:
                head = tail[twin[edge]]
                if not reached[head]:
                    reached[head] = in_tree[edge] = in_tree[twin[edge]] = True
                    queue[count] = head
                    count += 1
                edge = twin[preceding(edge)]
                if edge == start:
                    break
    order, parents = _dual_tree(twin, in_tree)
    free = np.flatnonzero(~in_tree)
    return order, free[free < twin[free]], parents


@numba.njit(cache=True)
def _dual_tree(twin, is_used):  # type: ignore[no-untyped-def]
    """Return a spanning tree of the faces over unused edges, and mark its edges as used."""
    num_faces = len(twin) // 3
    order, parents = np.empty(num_faces, np.int64), np.full(num_faces, -2, np.int64)
    count = done = 0
    for root in range(num_faces):
        if parents[root] != -2:
            continue
        parents[root] = -1
        order[count] = root
        count += 1
        while done < count:
            face = order[done]
            done += 1
            for edge in range(3 * face, 3 * face + 3):
                other = twin[edge] // 3
                if not is_used[edge] and parents[other] == -2:
                    is_used[edge] = is_used[twin[edge]] = True
                    parents[other] = twin[edge]
                    order[count] = other
                    count += 1
    return order, parents


@numba.njit(cache=True)
def _closed_form(twin, order, parents, free, values):  # type: ignore[no-untyped-def]
    """Return integers per half-edge that sum to zero around every face, with given values on the free edges.

    Sums wrap around at 64 bits, which does no harm: they are compared with zero only.
    """
    form = np.zeros(len(twin), np.int64)
    for i in range(len(free)):
        form[free[i]], form[twin[free[i]]] = values[i], -values[i]
    for i in range(len(order) - 1, -1, -1):
        edge = parents[order[i]]
        if edge >= 0:
            form[edge] = -(form[following(edge)] + form[preceding(edge)])
            form[twin[edge]] = -form[edge]
    return form


@numba.njit(cache=True)
def _loop_through(surface, form, root, bound):  # type: ignore[no-untyped-def]
    """Return the half-edges of the shortest loop through a vertex along which the form does not vanish, stem removed.

    Empty if it would be longer than `bound`. The loop is two shortest paths and the edge between their ends (Erickson
    and Whittlesey 2005, "Greedy optimal homotopy and homology generators").
    """
    num = len(surface.first)
    distance, sums = np.full(num, np.inf), np.zeros(num, np.int64)
    entered, is_settled = np.full(num, -1, np.int64), np.zeros(num, np.bool_)
    distance[root] = 0.0
    closing = -1
    heap = [(0.0, np.int64(root))]
    while len(heap):
        reach, vertex = heapq.heappop(heap)
        if 2.0 * reach >= bound:
            break
        if is_settled[vertex]:
            continue
        is_settled[vertex] = True
        start = edge = surface.first[vertex]
        while True:
            head = surface.tail[surface.twin[edge]]
            total = reach + surface.length[edge]
            if is_settled[head]:
                if sums[vertex] + form[edge] != sums[head] and total + distance[head] < bound:
                    bound, closing = total + distance[head], edge
            elif total < distance[head]:
                distance[head], entered[head], sums[head] = total, edge, sums[vertex] + form[edge]
                heapq.heappush(heap, (total, head))
            edge = surface.twin[preceding(edge)]
            if edge == start:
                break
    if closing < 0:
        return np.zeros(0, np.int64)
    return _without_stem(surface, entered, closing)


@numba.njit(cache=True)
def _without_stem(surface, entered, closing):  # type: ignore[no-untyped-def]
    """Return the loop of the closing half-edge and the paths to its ends, less what both paths share."""
    there = _path(surface, entered, surface.tail[closing])
    back = _path(surface, entered, surface.tail[surface.twin[closing]])
    shared = 0
    while shared < min(len(there), len(back)) and there[shared] == back[shared]:
        shared += 1
    loop = np.empty(len(there) + len(back) - 2 * shared + 1, np.int64)
    outward = len(there) - shared
    loop[:outward] = there[shared:]
    loop[outward] = closing
    for i in range(len(back) - shared):
        loop[outward + 1 + i] = surface.twin[back[len(back) - 1 - i]]
    return loop


@numba.njit(cache=True)
def _path(surface, entered, vertex):  # type: ignore[no-untyped-def]
    """Return the half-edges from the root to a vertex."""
    steps = [np.int64(0) for _ in range(0)]
    while entered[vertex] >= 0:
        steps.append(entered[vertex])
        vertex = surface.tail[entered[vertex]]
    path = np.empty(len(steps), np.int64)
    for i in range(len(steps)):
        path[i] = steps[len(steps) - 1 - i]
    return path
