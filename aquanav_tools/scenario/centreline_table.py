"""The centreline graph as the table `centreline_graph` of guide.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquanav_tools.cave.centreline.graph import Branch, CentrelineGraph, Chamber, Node
from aquanav_tools.types import Array


def graph_to_table(graph: CentrelineGraph) -> dict[str, Any]:
    """Return a graph as lists and numbers for JSON."""
    return {
        "nodes": [
            {"position": node.position.tolist(), "clearance": node.clearance, "kind": node.kind} for node in graph.nodes
        ],
        "branches": [
            {
                "start": branch.start,
                "end": branch.end,
                "points": branch.points.tolist(),
                "clearance": branch.clearance.tolist(),
            }
            for branch in graph.branches
        ],
        "chambers": [
            {"centre": chamber.centre.tolist(), "radius": chamber.radius, "branch": chamber.branch}
            for chamber in graph.chambers
        ],
    }


def graph_from_table(table: dict[str, Any]) -> CentrelineGraph:
    """Return the graph in a table that `graph_to_table` made.

    Raises:
        KeyError, TypeError, ValueError: the table is of another form; a value is missing, not finite or out of range.
    """
    nodes = tuple(
        Node(_floats(row["position"], (3,)), float(_floats(row["clearance"], ())), str(row["kind"]))
        for row in table["nodes"]
    )
    chambers = tuple(
        Chamber(_floats(row["centre"], (3,)), float(_floats(row["radius"], ())), int(row["branch"]))
        for row in table["chambers"]
    )
    return CentrelineGraph(nodes, tuple(_branch(row) for row in table["branches"]), chambers)


def _branch(row: dict[str, Any]) -> Branch:
    points = np.asarray(row["points"], dtype=np.float64)
    return Branch(
        int(row["start"]),
        int(row["end"]),
        _floats(points, (len(points), 3)),
        _floats(row["clearance"], (len(points),)),
    )


def _floats(value: object, shape: tuple[int, ...]) -> Array:
    array = np.array(value, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"expected shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError("a value is not finite")
    return array
