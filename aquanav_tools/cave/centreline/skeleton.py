"""From the samples that thinning leaves to nodes and branches."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aquanav_tools.cave.centreline.lattice import Lattice
from aquanav_tools.geometry.polyline import length_of
from aquanav_tools.types import Array, BoolArray, IntArray

PORTAL = "portal"
DEAD_END = "dead end"
JUNCTION = "junction"
LOOP_POINT = "loop point"
KINDS = (PORTAL, DEAD_END, JUNCTION, LOOP_POINT)


@dataclass(frozen=True, eq=False)
class Link:
    """A branch while it is being made."""

    start: int
    """Number of a node."""
    end: int
    points: Array
    """(K, 3) from node to node, m."""

    @property
    def length(self) -> float:
        """Metres along it."""
        return length_of(self.points)


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Nodes and what links them, while they are being made."""

    positions: Array
    """(V, 3) of the nodes, m."""
    kinds: tuple[str, ...]
    """(V,) of KINDS."""
    links: tuple[Link, ...]


def trace(lattice: Lattice, is_left: BoolArray, portals: IntArray) -> Skeleton:
    """Return the nodes and links of a thinned lattice; neighbouring samples of a junction are one node.

    Args:
        lattice: the water.
        is_left: (N,) which samples thinning left.
        portals: samples at the portals; each is a node, the first nodes in this order.
    """
    samples = np.flatnonzero(is_left)
    near = {int(s): [int(n) for n in lattice.neighbours[s] if n >= 0 and is_left[n]] for s in samples}
    groups = _group(near, [int(p) for p in portals])
    node_of = {sample: node for node, group in enumerate(groups) for sample in group}
    kinds = [PORTAL] * len(portals) + [
        {0: DEAD_END, 1: DEAD_END, 2: LOOP_POINT}.get(len(near[group[0]]), JUNCTION) for group in groups[len(portals) :]
    ]
    points = lattice.points
    positions = np.array([points[group].mean(axis=0) for group in groups])
    links = []
    for chain in _chains(near, node_of):
        start, end = node_of[chain[0]], node_of[chain[-1]]
        links.append(Link(start, end, np.vstack([positions[start], points[chain[1:-1]], positions[end]])))
    return Skeleton(positions, tuple(kinds), tuple(links))


def merge_junctions(skeleton: Skeleton, clearance: Array) -> Skeleton:
    """Return the skeleton with junctions in each other's ball made one, at the roomier place.

    Only a link between two different junctions vanishes, so that every loop stays.

    Args:
        skeleton: nodes and links.
        clearance: (V,) at the nodes, m.
    """
    short = [
        link
        for link in skeleton.links
        if link.start != link.end
        and skeleton.kinds[link.start] == skeleton.kinds[link.end] == JUNCTION
        and link.length <= max(clearance[link.start], clearance[link.end])
    ]
    if not short:
        return skeleton
    link = min(short, key=lambda one: one.length)
    kept, gone = sorted((link.start, link.end), key=lambda node: -clearance[node])
    others = [_moved(one, gone, kept, skeleton.positions[kept]) for one in skeleton.links if one is not link]
    merged = Skeleton(
        np.delete(skeleton.positions, gone, axis=0),
        tuple(kind for node, kind in enumerate(skeleton.kinds) if node != gone),
        tuple(replace(one, start=one.start - (one.start > gone), end=one.end - (one.end > gone)) for one in others),
    )
    return merge_junctions(merged, np.delete(clearance, gone))


def _moved(link: Link, gone: int, kept: int, position: Array) -> Link:
    start, end, points = link.start, link.end, link.points
    if start == gone:
        start, points = kept, np.vstack([position, points])
    if end == gone:
        end, points = kept, np.vstack([points, position])
    return Link(start, end, points)


def _group(near: dict[int, list[int]], portals: list[int]) -> list[list[int]]:
    """Return the samples of each node: portals, then groups of junction samples, ends, and a sample per bare ring."""
    groups = [[portal] for portal in portals]
    taken = set(portals)
    for sample, others in near.items():
        if sample not in taken and len(others) != 2:
            groups.append(_flood(near, sample, taken) if len(others) > 2 else [sample])
            taken.update(groups[-1])
    seen: set[int] = set()
    for group in groups:
        seen.update(_component(near, group[0]) if group[0] not in seen else ())
    for sample in near:
        if sample not in seen:
            groups.append([sample])
            seen.update(_component(near, sample))
    return groups


def _flood(near: dict[int, list[int]], sample: int, taken: set[int]) -> list[int]:
    """Return the junction samples that hang together with one."""
    found = [sample]
    for here in found:
        found += [n for n in near[here] if n not in found and n not in taken and len(near[n]) > 2]
    return found


def _component(near: dict[int, list[int]], sample: int) -> set[int]:
    found, todo = {sample}, [sample]
    while todo:
        fresh = [n for n in near[todo.pop()] if n not in found]
        found.update(fresh)
        todo += fresh
    return found


def _chains(near: dict[int, list[int]], node_of: dict[int, int]) -> list[list[int]]:
    """Return the runs of samples from node to node, each once."""
    chains = []
    walked: set[int] = set()
    for start in node_of:
        for step in near[start]:
            if step in node_of:
                if node_of[start] < node_of[step]:
                    chains.append([start, step])
                continue
            if step in walked:
                continue
            chain = [start, step]
            while chain[-1] not in node_of:
                ahead = [n for n in near[chain[-1]] if n != chain[-2]]
                chain.append(ahead[0])
            walked.update(chain[1:-1])
            # One sample between two of a group only rounds a corner of it.
            if len(chain) > 3 or node_of[chain[0]] != node_of[chain[-1]]:
                chains.append(chain)
    return chains
