"""A bay with rocks and reefs, seen from above: what a boat finds its way through.

World frame: metres, x and y level, z up from still water. A rock is an outline that stands upright from the sea bed to
its top; a reef is one whose top is below the water. Rocks of fixed maps may have triangles of their own, of which the
outline is the section at the water's level.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from aquanav_tools.errors import ScenarioError
from aquanav_tools.sea.outlines import clearance_at, outline_area, outlines_of
from aquanav_tools.text_files import NOT_A_TABLE, read_json
from aquanav_tools.types import Array, IntArray, Mesh

FORMAT = 1
MAX_BYTES = 100_000_000
"""Bound on a map's file: ten thousand times a usual one."""


@dataclass(frozen=True, eq=False)
class Rock:
    """What a boat must not touch."""

    outline: Array
    """(C, 2) corners of a simple polygon, counter-clockwise, m."""
    top: float
    """Height above still water, m; negative for a reef."""
    solid: Mesh | None = None
    """Its triangles, world, z from still water; None for an upright prism from the sea bed to its top."""

    def __post_init__(self) -> None:
        outline = np.asarray(self.outline, dtype=np.float64)
        if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) < 3 or not np.isfinite(outline).all():
            raise ValueError(f"A rock's outline is 3 or more corners of 2 finite numbers, got shape {outline.shape}.")
        if not outline_area(outline) > 0.0:
            raise ValueError(f"A rock's outline runs counter-clockwise; its area is {outline_area(outline):g} m^2.")
        object.__setattr__(self, "outline", outline)

    @property
    def is_reef(self) -> bool:
        """Whether it is all below still water."""
        return self.top < 0.0


@dataclass(frozen=True, eq=False)
class Goal:
    """Where the boat has to come: within a distance of a point, a line, or a convex polygon."""

    corners: Array
    """(G, 2), m; counter-clockwise if 3 or more."""
    tolerance: float = 0.0
    """m."""

    @property
    def centre(self) -> Array:
        """(2,) where the boat's compass and GPS point to, m."""
        centre: Array = self.corners.mean(axis=0)
        return centre


class Berth(NamedTuple):
    """Where a boat begins."""

    position: Array
    """(2,) m."""
    heading: float
    """From world x towards y, rad."""


class ShortestPath(NamedTuple):
    """The shortest way to the goal that keeps a clearance from every rock and from the bay's edge."""

    points: Array
    """(K, 2) from the start to the goal's edge; bends are drawn in pieces of 5 degrees at most."""
    length: float
    """With its bends as arcs, and without the last metres within the goal's tolerance, m."""
    clearance: float
    """What it keeps from rocks and edge, m."""


class Outlines(NamedTuple):
    """All rocks of a map for compiled functions."""

    corners: Array
    """(V, 2) of one outline after the other."""
    first: IntArray
    """(N + 1,) where each outline begins, and V."""
    discs: Array
    """(N, 3) middle and radius of a circle around each outline."""
    edge: Array
    """(4,) least x and y, most x and y of the bay."""


@dataclass(frozen=True, eq=False)
class SeaMap:
    """A bay, its rocks, where the boat may begin, and its goal."""

    name: str
    edge: Array
    """(4,) least x and y, most x and y of the bay, m."""
    depth: float
    """Of the sea bed below still water, m."""
    rocks: tuple[Rock, ...]
    goal: Goal
    starts: tuple[Berth, ...]
    paths: tuple[ShortestPath, ...]
    """The shortest way from each start."""
    source: str = field(default="", kw_only=True)
    """What made it, or where it comes from."""

    @cached_property
    def outlines(self) -> Outlines:
        """All rocks, for compiled functions."""
        return Outlines(*outlines_of([rock.outline for rock in self.rocks], self.edge))

    @property
    def density(self) -> float:
        """Share of the bay that rocks cover, where two overlap counted twice."""
        width, height = self.edge[2:] - self.edge[:2]
        return float(sum(outline_area(rock.outline) for rock in self.rocks) / (width * height))

    def clearance_at(self, position: Array) -> float:
        """Return the distance from a (2,) place to the nearest rock or edge, m; negative inside a rock or outside."""
        return float(clearance_at(*self.outlines, float(position[0]), float(position[1])))


def rock_solid(rock: Rock, depth: float) -> Mesh:
    """Return the closed triangles of a rock, normals outwards; those of a prism need a convex outline."""
    if rock.solid is not None:
        return rock.solid
    count = len(rock.outline)
    low, high = (np.column_stack([rock.outline, np.full(count, z)]) for z in (-depth, rock.top))
    here = np.arange(count)
    after = (here + 1) % count
    sides = [[here, after, after + count], [here, after + count, here + count]]
    fan = np.arange(1, count - 1)
    lids = [[np.zeros_like(fan), fan + 1, fan], [np.full_like(fan, count), fan + count, fan + count + 1]]
    faces = np.concatenate([np.stack(part, axis=1) for part in sides + lids])
    return Mesh(np.concatenate([low, high]), faces.astype(np.int64))


def write_map(sea: SeaMap, path: Path) -> None:
    """Write a map as JSON, without loss."""
    path.write_text(json.dumps(_table(sea), indent=1) + "\n", encoding="ascii")


def read_map(path: Path) -> SeaMap:
    """Return the map in a file that `write_map` wrote.

    Raises:
        ScenarioError: the file is missing, no such map, or of another format; the message says what is wrong.
    """
    table = read_json(path, ScenarioError, MAX_BYTES)
    try:
        if table["format"] != FORMAT:
            raise ScenarioError(f"{path} has the format {table['format']!r}, and this version reads {FORMAT}.")
        return _from_table(table)
    except NOT_A_TABLE as cause:
        raise ScenarioError(f"{path} is no sea map: {type(cause).__name__} {cause}. Write it again.") from cause


def _table(sea: SeaMap) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "name": sea.name,
        "source": sea.source,
        "edge": sea.edge.tolist(),
        "depth": sea.depth,
        "goal": {"corners": sea.goal.corners.tolist(), "tolerance": sea.goal.tolerance},
        "starts": [{"position": berth.position.tolist(), "heading": berth.heading} for berth in sea.starts],
        "ways": [
            {"points": path.points.tolist(), "length": path.length, "clearance": path.clearance} for path in sea.paths
        ],
        "rocks": [_rock_table(rock) for rock in sea.rocks],
    }


def _rock_table(rock: Rock) -> dict[str, Any]:
    table: dict[str, Any] = {"outline": rock.outline.tolist(), "top": rock.top}
    if rock.solid is not None:
        table["solid"] = {"vertices": rock.solid.vertices.tolist(), "faces": rock.solid.faces.tolist()}
    return table


def _from_table(table: dict[str, Any]) -> SeaMap:
    return SeaMap(
        name=str(table["name"]),
        edge=_array(table["edge"], (4,)),
        depth=float(table["depth"]),
        rocks=tuple(_rock(one) for one in table["rocks"]),
        goal=Goal(_array(table["goal"]["corners"], (-1, 2)), float(table["goal"]["tolerance"])),
        starts=tuple(Berth(_array(one["position"], (2,)), float(one["heading"])) for one in table["starts"]),
        paths=tuple(
            ShortestPath(_array(one["points"], (-1, 2)), float(one["length"]), float(one["clearance"]))
            for one in table["ways"]
        ),
        source=str(table["source"]),
    )


def _rock(table: dict[str, Any]) -> Rock:
    solid = table.get("solid")
    mesh = (
        Mesh(_array(solid["vertices"], (-1, 3)), np.array(solid["faces"], dtype=np.int64).reshape(-1, 3))
        if solid is not None
        else None
    )
    return Rock(_array(table["outline"], (-1, 2)), float(table["top"]), mesh)


def _array(values: Any, shape: tuple[int, ...]) -> Array:
    return np.array(values, dtype=np.float64).reshape(shape)
