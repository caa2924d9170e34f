"""Close a scan with a plain alternative: run by cavity.py in an interpreter that has these libraries.

    python eval/benchmarks/cavity_peers.py METHOD scan.npz closed.npz

Some of them are under GPL or AGPL. They are measured against and never imported by the project.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # for open3d's loader; peers' interpreters need none of it

POISSON_DEPTH = 10
"""50 m / 2^10: cells of 5 cm."""
ALPHA_METRES, OFFSET_METRES = 0.15, 0.015
"""The ball that may not enter a hole, and the distance kept from the scan."""
HOLE_EDGES = 2000
"""PyMeshLab closes holes with at most this many edges; the torn ends have some hundreds."""
WATERTIGHT_RESOLUTION = 100_000
"""Leaves of point-cloud-utils' octree. Its default of 20,000 is for single objects."""


def poisson(vertices, faces):
    """Return open3d's screened Poisson surface of the scan's vertices, untrimmed. The project has open3d itself."""
    from aquanav_tools.libraries import load_open3d

    open3d = load_open3d()
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(faces.astype(np.int32))
    )
    mesh.compute_vertex_normals()
    cloud = open3d.geometry.PointCloud(mesh.vertices)
    cloud.normals = mesh.vertex_normals
    closed, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=POISSON_DEPTH)
    return np.asarray(closed.vertices), np.asarray(closed.triangles)


def meshfix(vertices, faces):
    """Return what pymeshfix repairs."""
    import pymeshfix

    fixer = pymeshfix.MeshFix(vertices, faces.astype(np.int32))
    fixer.repair()
    return np.asarray(fixer.points), np.asarray(fixer.faces)


def alpha_wrap(vertices, faces):
    """Return CGAL's alpha wrap, by PyMeshLab."""
    import pymeshlab

    meshes = _meshlab(vertices, faces)
    alpha, offset = pymeshlab.PureValue(ALPHA_METRES), pymeshlab.PureValue(OFFSET_METRES)
    meshes.generate_alpha_wrap(alpha=alpha, offset=offset)
    return _of_meshlab(meshes)


def close_holes(vertices, faces):
    """Return the scan with its holes closed by PyMeshLab."""
    meshes = _meshlab(vertices, faces)
    meshes.meshing_repair_non_manifold_edges()
    meshes.meshing_repair_non_manifold_vertices()
    meshes.meshing_close_holes(maxholesize=HOLE_EDGES)
    return _of_meshlab(meshes)


def watertight(vertices, faces):
    """Return point-cloud-utils' watertight surface."""
    import point_cloud_utils

    return point_cloud_utils.make_mesh_watertight(vertices, faces, resolution=WATERTIGHT_RESOLUTION)


METHODS = {
    "open3d-poisson": (poisson, "aquanav_tools.libraries"),
    "pymeshfix": (meshfix, "pymeshfix"),
    "pymeshlab-alpha-wrap": (alpha_wrap, "pymeshlab"),
    "pymeshlab-close-holes": (close_holes, "pymeshlab"),
    "point-cloud-utils-watertight": (watertight, "point_cloud_utils"),
}


def _meshlab(vertices, faces):
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32)))
    return meshes


def _of_meshlab(meshes):
    mesh = meshes.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix()


def main() -> None:
    name, scan_path, closed_path = sys.argv[1:]
    close, library = METHODS[name]
    try:
        __import__(library)
    except ImportError as cause:
        sys.exit(f"{library} cannot be imported by {sys.executable}: {cause}")
    with np.load(scan_path) as scan:
        vertices, faces = scan["vertices"], scan["faces"]
    began = time.perf_counter()
    vertices, faces = close(vertices, faces)
    seconds = time.perf_counter() - began
    np.savez(closed_path, vertices=np.asarray(vertices, dtype=np.float64), faces=np.asarray(faces), seconds=seconds)


if __name__ == "__main__":
    main()
