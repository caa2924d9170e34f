"""How a cave looks, in levels of detail: from the GLB files that a build left, or made from the cavity."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.report.viewer_model import LEVEL_SHARES, cave_part
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Array, Mesh

PICTURED = "cave.glb"
"""What a build leaves beside a scenario, with the colours of the scan."""
FEW_COLOURS = 3
"""Rock, wall that was not seen, portals: what a cave without colours of a scan has."""
NEAR = 0.01
"""By which the box around a pictured cave may differ from the scenario's, m: far more than float32 rounds."""
HEAD, CHUNK = 12, 8
"""Bytes before the first chunk of a GLB, and before the content of a chunk."""


def looks_of(scenario: Scenario) -> tuple[tuple[Mesh, ...], bool]:
    """Return the levels, the finest first, faces into the water; and whether they have colours of a scan.

    Raises:
        InputError: the GLB beside the scenario is damaged, or shows another cave.
    """
    path = scenario.folder / PICTURED if scenario.folder is not None else None
    if path is not None and path.is_file():
        coarser = sorted(path.parent.glob(f"{path.stem}-lod*{path.suffix}"))
        levels = tuple(read_pictured(one) for one in (path, *coarser))
        _check_box(levels[0], scenario.cavity.mesh, path)
    else:
        count = len(scenario.cavity.mesh.faces)
        levels = tuple(_made(scenario, max(round(share * count), 4)) for share in LEVEL_SHARES)
    assert levels[0].colours is not None
    return levels, len(np.unique(levels[0].colours, axis=0)) > FEW_COLOURS


def _made(scenario: Scenario, max_faces: int) -> Mesh:
    part = cave_part(scenario.cavity, scenario.collision, max_faces)
    assert part.faces is not None
    colours = np.round(part.colours).astype(np.uint8)
    return Mesh(part.points, np.ascontiguousarray(part.faces[:, ::-1].astype(np.int64)), colours)


def read_pictured(path: Path) -> Mesh:
    """Return the first mesh of a GLB that `viewer_model.write_glb` wrote, turned back to z up.

    Raises:
        InputError: it is damaged, or another program's.
    """
    content = path.read_bytes()
    try:
        (length,) = struct.unpack_from("<I", content, HEAD)
        table = json.loads(content[HEAD + CHUNK : HEAD + CHUNK + length])
        body = content[HEAD + CHUNK + length + CHUNK :]
        primitive = table["meshes"][0]["primitives"][0]
        points = _values(table, body, primitive["attributes"]["POSITION"], "<f4", 3)
        linear = _values(table, body, primitive["attributes"]["COLOR_0"], "<u2", 4)[:, :3] / 65535.0
        faces = _values(table, body, primitive["indices"], "<u4", 1).reshape(-1, 3).astype(np.int64)
        if faces.min() < 0 or faces.max() >= len(points) or len(linear) != len(points):
            raise ValueError(f"faces name vertex {faces.max()} of {len(points)}")
        if not np.isfinite(points).all():
            raise ValueError("a vertex has no finite place")
    except (LookupError, OverflowError, RecursionError, TypeError, ValueError, struct.error) as cause:
        raise InputError(
            f"{path} is not a GLB of a cave: {cause!r}. Build the scenario again, or delete it."
        ) from cause
    turned = np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)
    return Mesh(turned, np.ascontiguousarray(faces[:, ::-1]), np.round(255.0 * _srgb(linear)).astype(np.uint8))


def _values(table: dict, body: bytes, accessor: int, kind: str, width: int) -> Array:  # type: ignore[type-arg]
    entry = table["accessors"][accessor]
    offset = table["bufferViews"][entry["bufferView"]]["byteOffset"]
    found = np.frombuffer(body, kind, entry["count"] * width, offset)
    return found.reshape(-1, width).astype(np.float64)


def _srgb(linear: Array) -> Array:
    """Return linear light in [0, 1] as sRGB in [0, 1] (IEC 61966-2-1)."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def _check_box(shown: Mesh, cavity: Mesh, path: Path) -> None:
    apart = max(
        float(np.abs(pick(shown.vertices, axis=0) - pick(cavity.vertices, axis=0)).max()) for pick in (np.min, np.max)
    )
    if apart > NEAR:
        raise InputError(
            f"{path} shows another cave: its box is {apart:.2f} m off the scenario's. "
            "Delete it, or build the scenario again."
        )
