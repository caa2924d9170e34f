"""cloud.ply: the fused cloud as other programs read it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aquanav_tools.types import PointCloud

_NORMALS = ("nx", "ny", "nz")
_COLOURS = ("red", "green", "blue")
_TYPES = {"<f8": "double", "<f4": "float", "|u1": "uchar", "<u2": "ushort"}


def write_cloud(cloud: PointCloud, path: Path) -> None:
    """Write a binary PLY: places, and where known normals, colours, `photos` that agree and their `spread` (m)."""
    columns: list[tuple[str, str, object]] = [(name, "<f8", cloud.points[:, k]) for k, name in enumerate("xyz")]
    if cloud.normals is not None:
        columns += [(name, "<f4", cloud.normals[:, k]) for k, name in enumerate(_NORMALS)]
    if cloud.colours is not None:
        columns += [(name, "|u1", cloud.colours[:, k]) for k, name in enumerate(_COLOURS)]
    if cloud.num_photos is not None:
        columns.append(("photos", "<u2", cloud.num_photos))
    if cloud.spread is not None:
        columns.append(("spread", "<f4", cloud.spread))
    table = np.empty(len(cloud.points), dtype=[(name, kind) for name, kind, _ in columns])
    for name, _, values in columns:
        table[name] = values
    properties = "".join(f"property {_TYPES[kind]} {name}\n" for name, kind, _ in columns)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(table)}\n{properties}end_header\n"
    path.write_bytes(header.encode("ascii") + table.tobytes())
