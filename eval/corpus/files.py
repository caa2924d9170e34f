"""Writing a case as the file a user would bring, and its truth beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.synthetic.damage import DamagedScan, Truth
from aquanav_tools.types import Array, Mesh, PointCloud


def write_case(scan: DamagedScan, folder: Path) -> Path:
    """Write scan.ply (binary, float64) and truth.npz; return the scan's path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "scan.ply"
    path.write_bytes(ply_bytes(scan.surface))
    truth = scan.truth
    arrays: dict[str, Any] = {f"path_{place}": line for place, line in enumerate(truth.paths)}
    if truth.solid is not None:
        arrays |= {"vertices": truth.solid.vertices, "faces": truth.solid.faces}
    genus = -1 if truth.genus is None else truth.genus
    np.savez(folder / "truth.npz", **arrays, offset=scan.offset, portals=truth.num_portals, genus=genus)
    return path


def read_truth(folder: Path) -> tuple[Truth, Array]:
    """Return what `write_case` wrote: the truth, and by how much the scan was moved away from it, m."""
    with np.load(folder / "truth.npz") as stored:
        solid = Mesh(stored["vertices"], stored["faces"]) if "vertices" in stored else None
        paths = tuple(stored[name] for name in sorted(stored) if name.startswith("path_"))
        genus = int(stored["genus"])
        truth = Truth(solid, paths, int(stored["portals"]), None if genus < 0 else genus)
        return truth, stored["offset"]


def ply_bytes(surface: Mesh | PointCloud) -> bytes:
    """Return a surface as binary PLY. Doubles: scans in national grids would lose their detail in floats."""
    if isinstance(surface, Mesh):
        table, faces = surface.vertices, surface.faces
    else:
        columns = [surface.points] if surface.normals is None else [surface.points, surface.normals]
        table, faces = np.concatenate(columns, axis=1), np.zeros((0, 3), dtype=np.int64)
    names = ("x", "y", "z", "nx", "ny", "nz")[: table.shape[1]]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    header += [f"property double {name}" for name in names]
    if isinstance(surface, Mesh):
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    rows = np.zeros(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    return "\n".join([*header, "end_header\n"]).encode() + table.astype("<f8").tobytes() + rows.tobytes()
