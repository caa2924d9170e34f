"""Adjusting a survey: positions of all stations by weighted least squares over loops and fixed points.

Positions are first found along a spanning tree; the normal equations then give corrections to them, so that coordinates
of millions of metres keep their tenths of millimetres and a survey without loops is not touched by rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.survey.fieldbook import FieldBook, Fix
from aquanav_tools.types import Array, BoolArray, IntArray

MIN_SD = 1e-4
"""Standard deviation below which a leg counts as exact, m; keeps the equations solvable where a file says zero."""
_MAX_NAMED = 8


@dataclass(frozen=True, eq=False)
class _Network:
    """Nodes (stations that were equated are one) and what ties them together; the last node is the datum, at zero."""

    node_of: IntArray
    """(S,) node of each station."""
    ends: IntArray
    """(E, 2) nodes."""
    vectors: Array
    """(E, 3) m."""
    weights: Array
    """(E, 3, 3) inverse covariances, 1/m^2."""
    is_exact: BoolArray
    """(E,) whether the tie is a fixed point without spread."""

    @property
    def datum(self) -> int:
        return int(self.node_of.max(initial=-1)) + 1


def adjust(book: FieldBook) -> Array:
    """Return the (S, 3) adjusted positions of a field book's stations, m.

    Where nothing is fixed, the first station is put at the origin, as Survex does, and the book gets a warning.

    Raises:
        InputError: some stations are tied to no fixed point.
    """
    if not book.names:
        raise InputError("The survey has no stations. Check that the file holds survey data and not only settings.")
    if not book.fixes:
        _fix_first(book)
    network = _build(book)
    start, order = _spanning_tree(network)
    _require_all_reached(book, network, order)
    return (start + _corrections(network, start))[network.node_of]


def _fix_first(book: FieldBook) -> None:
    first = book.measurements[0].start if book.measurements else 0
    book.fix(first, Fix(np.zeros(3), None, "no file"))
    book.warnings.append(
        f"The survey has no fixed point, so its station '{book.names[first]}' was put at (0, 0, 0). Fix one."
    )


def _build(book: FieldBook) -> _Network:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count = len(book.names)
    pairs = np.array(book.equates, dtype=np.int64).reshape(-1, 2)
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    num_nodes, node_of = connected_components(graph, directed=False)
    node_of = node_of.astype(np.int64)
    ends, vectors, spreads, is_exact = [], [], [], []
    for leg in book.measurements:
        if leg.covariance is not None and node_of[leg.start] != node_of[leg.end]:
            ends.append((node_of[leg.start], node_of[leg.end]))
            vectors.append(leg.vector)
            spreads.append(leg.covariance)
            is_exact.append(False)
    for station, fix in book.fixes.items():
        ends.append((num_nodes, node_of[station]))
        vectors.append(fix.position)
        spreads.append(np.zeros((3, 3)) if fix.covariance is None else fix.covariance)
        is_exact.append(fix.covariance is None)
    weights: Array = np.linalg.inv(np.array(spreads, dtype=np.float64) + MIN_SD**2 * np.eye(3)).astype(np.float64)
    return _Network(node_of, np.array(ends), np.array(vectors), weights, np.array(is_exact))


def _spanning_tree(network: _Network) -> tuple[Array, IntArray]:
    """Return the (N + 1, 3) positions along a tree of ties from the datum, and the nodes it reaches."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import breadth_first_order

    count = network.datum + 1
    tie_of: dict[tuple[int, int], tuple[int, float]] = {}
    for tie, (a, b) in enumerate(network.ends.tolist()):
        tie_of.setdefault((a, b), (tie, 1.0))
        tie_of.setdefault((b, a), (tie, -1.0))
    graph = coo_matrix((np.ones(len(network.ends)), network.ends.T), shape=(count, count))
    order, before = breadth_first_order(graph, network.datum, directed=False)
    positions = np.zeros((count, 3))
    for node in order[1:].tolist():
        tie, sign = tie_of[int(before[node]), node]
        positions[node] = positions[before[node]] + sign * network.vectors[tie]
    return positions, order


def _require_all_reached(book: FieldBook, network: _Network, order: IntArray) -> None:
    is_reached = np.zeros(network.datum + 1, dtype=bool)
    is_reached[order] = True
    lost = [name for name, node in zip(book.names, network.node_of, strict=True) if not is_reached[node]]
    if lost:
        named = ", ".join(f"'{name}'" for name in lost[:_MAX_NAMED]) + (", ..." if len(lost) > _MAX_NAMED else "")
        raise InputError(
            f"{len(lost)} of {len(book.names)} stations are tied to no fixed point: {named}. A name may be mistyped or "
            "an *equate missing. Tie them to the rest, or *fix one of them."
        )


def _corrections(network: _Network, start: Array) -> Array:
    """Return the (N + 1, 3) corrections that minimise the weighted squares of the misclosures."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import splu

    count = network.datum + 1
    is_known = np.zeros(count, dtype=bool)
    is_known[network.datum] = True
    is_known[network.ends[network.is_exact, 1]] = True
    a, b = network.ends[~network.is_exact].T
    weights = network.weights[~network.is_exact]
    misclosures = network.vectors[~network.is_exact] - (start[b] - start[a])
    pulls = np.einsum("eij,ej->ei", weights, misclosures)
    right = np.zeros((count, 3))
    np.add.at(right, b, pulls)
    np.add.at(right, a, -pulls)
    axes = np.arange(3)
    blocks = [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)]
    rows = np.concatenate([np.broadcast_to(3 * r[:, None, None] + axes[:, None], weights.shape) for r, _, _ in blocks])
    columns = np.concatenate([np.broadcast_to(3 * c[:, None, None] + axes, weights.shape) for _, c, _ in blocks])
    values = np.concatenate([sign * weights for _, _, sign in blocks])
    matrix = coo_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * count, 3 * count)).tocsc()
    free = np.flatnonzero(np.repeat(~is_known, 3))
    corrections = np.zeros(3 * count)
    if len(free):
        corrections[free] = splu(matrix[free][:, free]).solve(right.ravel()[free])
    return corrections.reshape(count, 3)
