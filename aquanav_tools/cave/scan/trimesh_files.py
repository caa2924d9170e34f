"""What trimesh makes of a file: triangles or points, with colours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.scan.announced import check_count
from aquanav_tools.cave.scan.surface_file import unit_vectors
from aquanav_tools.errors import AquanavError, InputError
from aquanav_tools.types import Array, Mesh, PointCloud


def load(path: Path) -> Any:
    """Return what trimesh makes of a file: a scene, a mesh or a cloud.

    Raises:
        InputError: it is damaged.
        ResourceError: it places its meshes so often that they have too many points together.
    """
    import trimesh

    try:
        loaded: Any = trimesh.load(path, process=False)
        if isinstance(loaded, trimesh.Scene):
            copies = [loaded.geometry[loaded.graph[node][1]] for node in loaded.graph.nodes_geometry]
            check_count(path, sum(len(each.vertices) for each in copies))
        return loaded
    except AquanavError:
        raise
    except Exception as cause:  # whatever a damaged file makes one of the many parsers raise
        raise _damaged(path, cause) from cause


def surface_of(path: Path, loaded: Any) -> Mesh | PointCloud:
    """Return the triangles or points in what `load` returned, those of a scene all together; errors likewise."""
    import trimesh

    try:
        if isinstance(loaded, trimesh.Scene):
            loaded = loaded.to_mesh()
        vertices = np.array(loaded.vertices, dtype=np.float64)
        faces = np.array(getattr(loaded, "faces", ()), dtype=np.int64)
        colours = _vertex_colours(loaded)
    except Exception as cause:  # likewise, from a texture for one
        raise _damaged(path, cause) from cause
    if len(faces):
        return Mesh(vertices, faces, colours)
    return PointCloud(vertices, _ply_normals(loaded), colours)


def _damaged(path: Path, cause: Exception) -> InputError:
    reason = " ".join(f"{cause}".split()) or type(cause).__name__
    return InputError(
        f"{path} cannot be read as '{path.suffix.lower()}': {reason.rstrip('.')}. The file is damaged or of another "
        "format. Copy or export it again."
    )


def _vertex_colours(loaded: Any) -> npt.NDArray[np.uint8] | None:
    """Return the RGB of every vertex, sampled from the texture where there is one; None where nothing is defined."""
    visual: Any = getattr(loaded, "visual", None)
    if getattr(visual, "kind", None) == "texture":
        visual = visual.to_color()
    if getattr(visual, "kind", None) in ("vertex", "face"):
        colours = np.asarray(visual.vertex_colors, dtype=np.uint8)
    elif getattr(loaded, "colors", None) is not None and visual is None:
        colours = np.asarray(loaded.colors, dtype=np.uint8)
    else:
        return None
    return colours[:, :3].copy() if colours.shape == (len(loaded.vertices), 4) else None


def _ply_normals(cloud: object) -> Array | None:
    """Return the normals of a PLY point cloud, which trimesh keeps only in its raw data."""
    raw = getattr(cloud, "metadata", {}).get("_ply_raw", {}).get("vertex", {}).get("data")
    names = getattr(getattr(raw, "dtype", None), "names", None) or tuple(raw or ())
    if not {"nx", "ny", "nz"} <= set(names):
        return None
    return unit_vectors(
        np.stack([np.asarray(raw[axis], dtype=np.float64).ravel() for axis in ("nx", "ny", "nz")], axis=1)
    )
