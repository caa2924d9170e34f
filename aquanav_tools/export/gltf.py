"""glTF 2.0, binary (.glb): y up, metres, as its standard wants: (x, y, z) of our world becomes (x, z, -y)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aquanav_tools.export.scene import Scene
from aquanav_tools.report.glb import Part, glb, line
from aquanav_tools.types import Array, Mesh, rotation_matrix

ROUTE, GATE, START = (255, 183, 3), (251, 86, 7), (120, 220, 190)
ARROW = 0.5
"""Length of the line that shows where a start looks, m."""


def write_gltf(scene: Scene, folder: Path) -> tuple[str, ...]:
    """Write cave.glb and its coarser levels, collision.glb, places.glb (route, panels, starts) and vehicle.glb."""
    files = {_level_name(n): [_solid("cave", level)] for n, level in enumerate(scene.levels)}
    files["collision.glb"] = [_solid("collision", scene.collision)]
    ahead = [(pose.position, rotation_matrix(pose.orientation)[:, 0]) for pose in scene.starts]
    files["places.glb"] = [
        line("route", scene.guide.centreline, ROUTE),
        *(line(f"panel-{n}", _closed(gate.polygon), GATE) for n, gate in enumerate(scene.guide.panels)),
        *(line(f"portal-{lid.label}", np.stack([lid.centre, lid.centre + lid.normal]), GATE) for lid in scene.portals),
        *(line(f"start-{n}", np.stack([at, at + ARROW * way]), START) for n, (at, way) in enumerate(ahead)),
    ]
    files["vehicle.glb"] = [_solid("vehicle", scene.craft.look)]
    for name, parts in files.items():
        (folder / name).write_bytes(glb(parts))
    return tuple(files)


def _level_name(level: int) -> str:
    return f"cave-lod{level}.glb" if level else "cave.glb"


def _solid(name: str, mesh: Mesh) -> Part:
    normals = np.asarray(mesh.to_trimesh().vertex_normals)
    colours = np.full(mesh.vertices.shape, 128.0) if mesh.colours is None else mesh.colours.astype(np.float64)
    return Part(name, mesh.vertices, colours, mesh.faces, normals)


def _closed(points: Array) -> Array:
    return np.vstack([points, points[:1]])
