"""The original benchmark's bays, read from the numbers of its public builds: rocks, walls, starts and goal.

The level of the original's water is made by a closed plugin and not known. A boat begins afloat, so that of its root at
the starts is taken for it. Rocks keep their triangles; the outline that ways and rays use is their section there.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.sea.outlines import outline_area
from aquanav_tools.sea.sea_map import Berth, Goal, Rock, SeaMap
from aquanav_tools.sea.shortest import shortest_path
from aquanav_tools.text_files import NOT_A_TABLE, read_json, read_text
from aquanav_tools.types import Array, Mesh

SUFFIX = "_rocks.obj"
"""Behind a scene's name: the file with its rocks, beside the scene's."""
FLOOR = "Floor"
"""Name of the box whose upper side is the sea bed."""
SAME_CORNER = 1e-6
"""Corners of a section nearer than this are one, m; sides of no length have no normal."""


def read_original_map(scene: Path, clearance: float) -> SeaMap:
    """Return a bay of the original from the file of its scene, with the rocks in the file NAME_rocks.obj beside it.

    Args:
        scene: JSON with `boxes`, `starts` and `goal`: z up, m.
        clearance: What the shortest ways keep from rocks, m.

    Raises:
        InputError: a file is missing or is no such scene, a rock is not closed, or no boat of that clearance can
            cross; the message says which.
    """
    table, triangles = read_json(scene), read_text(scene.with_name(scene.stem + SUFFIX))
    try:
        vertices, faces = _parse_triangles(triangles)
        starts = np.array([start["position"] for start in table["starts"]], dtype=np.float64)
        level = float(np.median(starts[:, 2]))
        walls = [_box_corners(box) for box in table["boxes"] if box["name"] != FLOOR]
        floor = _floor_of(table["boxes"])
        edge = np.concatenate([floor[:, :2].min(axis=0), floor[:, :2].max(axis=0)])
        goal = Goal(_outline_of_box(_box_corners(table["goal"])))
        headings = np.radians([float(start["yaw_deg"]) for start in table["starts"]])
        rocks = [_rock(Mesh(*part)) for part in _parts(vertices - [0.0, 0.0, level], faces)]
        rocks += [Rock(_outline_of_box(corners), float(corners[:, 2].max() - level)) for corners in walls]
        depth = level - float(floor[:, 2].max())
        berths = tuple(Berth(start[:2], float(heading)) for start, heading in zip(starts, headings, strict=True))
        sea = SeaMap(str(table["key"]), edge, depth, tuple(rocks), goal, berths, (), source=str(table["source"]))
    except NOT_A_TABLE as cause:
        raise InputError(
            f"{scene} with its rocks is no surface scene of the original: {type(cause).__name__} {cause}. Export both "
            "again."
        ) from cause
    return _with_ways(sea, clearance)


def _with_ways(sea: SeaMap, clearance: float) -> SeaMap:
    paths = []
    for number, berth in enumerate(sea.starts):
        path = shortest_path(sea.outlines, berth.position, sea.goal, clearance)
        if path is None:
            raise InputError(
                f"No way from start {number} of {sea.name} keeps {clearance:.2f} m from its rocks; the start itself "
                f"has {sea.clearance_at(berth.position):.2f} m. Ask for a smaller clearance."
            )
        paths.append(path)
    return SeaMap(sea.name, sea.edge, sea.depth, sea.rocks, sea.goal, sea.starts, tuple(paths), source=sea.source)


def _rock(solid: Mesh) -> Rock:
    """Return a rock with its section at still water for an outline; one all below has that of its whole."""
    top = float(solid.vertices[:, 2].max())
    return Rock(_section(solid, min(0.0, 0.5 * (top + float(solid.vertices[:, 2].min())))), top, solid)


def _section(solid: Mesh, height: float) -> Array:
    """Return the (C, 2) largest outline of a closed mesh at a height, counter-clockwise."""
    section = solid.to_trimesh().section(plane_origin=(0.0, 0.0, height), plane_normal=(0.0, 0.0, 1.0))
    loops = [] if section is None else [np.asarray(loop)[:-1, :2] for loop in section.discrete]
    if not loops:
        raise InputError(f"A rock has no section at {height:.2f} m: is its surface closed?")
    outline = max(loops, key=lambda loop: abs(outline_area(loop)))
    outline = outline[np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1) > SAME_CORNER]
    return outline if outline_area(outline) > 0.0 else outline[::-1].copy()


def _parts(vertices: Array, faces: Array) -> list[tuple[Array, Any]]:
    """Return the connected pieces of triangles, in the order of their first face."""
    import trimesh

    whole = trimesh.Trimesh(vertices, faces, process=False)
    whole.merge_vertices()
    pieces = whole.split(only_watertight=False)
    if not all(piece.is_watertight for piece in pieces):
        raise InputError("A rock of the original is not closed. Was its file changed?")
    return [(np.asarray(piece.vertices), np.asarray(piece.faces, dtype=np.int64)) for piece in pieces]


def _parse_triangles(text: str) -> tuple[Array, Any]:
    rows = [line.split() for line in text.splitlines()]
    vertices = np.array([row[1:4] for row in rows if row[:1] == ["v"]], dtype=np.float64)
    faces = [[int(corner.split("/")[0]) - 1 for corner in row[1:4]] for row in rows if row[:1] == ["f"]]
    return vertices, np.array(faces, dtype=np.int64)


def _floor_of(boxes: list[dict[str, Any]]) -> Array:
    """Return the (8, 3) corners of the sea bed's box."""
    floors = [box for box in boxes if box["name"] == FLOOR]
    if len(floors) != 1:
        raise ValueError(f"it has {len(floors)} boxes named {FLOOR}, and should have one")
    return _box_corners(floors[0])


def _box_corners(box: dict[str, Any]) -> Array:
    """Return the (8, 3) corners of a box given by centre, half extents, and axes as the columns of a matrix."""
    signs = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, -1).T
    corners: Array = np.array(box["center"]) + (signs * np.array(box["half_extents"])) @ np.array(box["axes_columns"]).T
    return corners


def _outline_of_box(corners: Array) -> Array:
    """Return the (4, 2) outline of an upright box."""
    from scipy.spatial import ConvexHull, QhullError

    flat = np.unique(np.round(corners[:, :2], 9), axis=0)
    try:
        outline: Array = flat[ConvexHull(flat).vertices]
    except QhullError as cause:
        raise ValueError("a box has no extent in x or y") from cause
    return outline
