"""Handles: where the water goes around rock, or rock around water, and how large each such place is."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numba
import numpy as np

from aquanav_tools.geometry.mesh.half_edges import HalfEdges, cut_and_cap, following, half_edges, preceding
from aquanav_tools.types import Array, IntArray, Mesh

NUM_ROOTS = 24
"""Random places at which short loops are sought ..."""
MAX_FREE_ROOTS = 64
"""... beside ends of the edges that no spanning tree has, at least one of which lies on each handle."""
MAX_AT_ONCE = 48
"""Loops that one round cuts: well below the bits by which they are told apart."""
LONGER = 1.5
"""A round cuts loops up to so many times as long as its shortest: longer ones may yet be shortened by its cuts."""
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

    Again and again short loops that do not divide the surface, not even together, are found, and the surface is cut
    along them and capped, which removes as many handles, until none is left. Whether loops divide is read off closed
    1-forms modulo 2 with random periods, 64 of them in the bits of one number: their sums along a loop vanish where it
    bounds a piece of surface, and hardly ever elsewhere; along several loops, where these bound one together. A loop is
    the shortest through some vertex, tightened by starting again from its own vertices; it follows edges, so it is up
    to about 15 % longer than the tightest curve.

    Args:
        mesh: closed, outward normals.
        seed: picks the places where loops are sought.

    Raises:
        MeshError: the mesh is not closed.
    """
    rng = np.random.default_rng(seed)
    surface = half_edges(mesh)
    loops = []
    while found := _short_loops(surface, rng):
        for loop in found:
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


def _short_loops(surface: HalfEdges, rng: np.random.Generator) -> list[IntArray]:
    """Return the half-edges of short loops without common vertices that do not divide the surface, not even together.

    There are none on a sphere.
    """
    order, free, parents = _tree_and_cotree(*surface[:3])
    if not len(free):
        return []
    forms = _closed_forms(surface.twin, order, parents, free, rng.integers(-(2**63), 2**63, len(free)))
    ends = free if len(free) <= MAX_FREE_ROOTS else rng.choice(free, MAX_FREE_ROOTS, replace=False)
    roots = np.concatenate([surface.tail[ends], rng.integers(0, len(surface.first), NUM_ROOTS)])
    shortest, found = np.inf, []
    for root in roots:
        loop, length = _tight_loop(surface, forms, root, LONGER * shortest)
        if len(loop):
            shortest = min(shortest, length)
            found.append((length, loop))
    found.sort(key=lambda one: one[0])
    return _apart(surface, forms, [loop for length, loop in found if length <= LONGER * shortest])


def _apart(surface: HalfEdges, forms: IntArray, loops: list[IntArray]) -> list[IntArray]:
    """Return the first of some loops, and of the others those that share no vertex and divide nothing with these."""
    is_used = np.zeros(len(surface.first), dtype=np.bool_)
    chosen: list[IntArray] = []
    basis: list[int] = []
    for loop in loops:
        vertices = surface.tail[loop]
        rest = int(np.bitwise_xor.reduce(forms[loop])) & (2**64 - 1)
        for one in basis:  # each has a highest bit of its own
            rest = min(rest, rest ^ one)
        if rest and not is_used[vertices].any() and len(chosen) < MAX_AT_ONCE:
            is_used[vertices] = True
            chosen.append(loop)
            basis.append(rest)
            basis.sort(reverse=True)
    return chosen


def _tight_loop(surface: HalfEdges, forms: IntArray, root: int, bound: float) -> tuple[IntArray, float]:
    """Return a loop that does not divide the surface, near the shortest through a vertex, and its length.

    It has no half-edges where there is none shorter than a bound.
    """
    best, length = _improve(surface, forms, np.zeros(0, dtype=np.int64), bound, root)
    before = np.inf
    while len(best) and length < SHORTER * before:
        before = length
        for other in surface.tail[best[:: max(1, len(best) // NUM_REROOTS)]]:
            best, length = _improve(surface, forms, best, length, other)
    return best, length


def _improve(surface: HalfEdges, forms: IntArray, best: IntArray, length: float, root: int) -> tuple[IntArray, float]:
    """Return the better of a loop and the shortest one through a vertex, and its length."""
    loop = _loop_through(surface, forms, root, length)
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
def _closed_forms(twin, order, parents, free, values):  # type: ignore[no-untyped-def]
    """Return bits per half-edge that add up to zero, modulo 2, around every face, with given ones on the free edges."""
    forms = np.zeros(len(twin), np.int64)
    for i in range(len(free)):
        forms[free[i]] = forms[twin[free[i]]] = values[i]
    for i in range(len(order) - 1, -1, -1):
        edge = parents[order[i]]
        if edge >= 0:
            forms[edge] = forms[twin[edge]] = forms[following(edge)] ^ forms[preceding(edge)]
    return forms


@numba.njit(cache=True)
def _loop_through(surface, forms, root, bound):  # type: ignore[no-untyped-def]
    """Return the half-edges of the shortest loop through a vertex along which the forms do not vanish, stem removed.

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
                if sums[vertex] ^ forms[edge] != sums[head] and total + distance[head] < bound:
                    bound, closing = total + distance[head], edge
            elif total < distance[head]:
                distance[head], entered[head], sums[head] = total, edge, sums[vertex] ^ forms[edge]
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
