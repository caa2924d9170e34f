"""Filling a hole so that the curvature of the wall around it goes on, as rock does, instead of with a flat lid."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve
from scipy.spatial import Delaunay

from aquanav_tools.errors import MeshError
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

INSET = 0.6
"""New vertices keep this far from the rim, in edge lengths, so that faces along it are well shaped."""
MAX_FLIPS = 100
"""Flips tried to recover one edge of the rim; a rim that needs more is refused."""
NUM_FAIRINGS = 4
"""The angles that weigh neighbours are those of the shape before; after four rounds a sphere's cap moves no more."""


def fill_hole(vertices: Array, faces: IntArray, loop: IntArray) -> tuple[Array, IntArray]:
    """Return new vertices and faces that close a hole and continue the wall's curvature.

    The hole is filled in the plane that fits its rim, with faces as large as the rim's edges are long. Then the new
    vertices are moved to where the surface bends least: they minimise the integral of the squared mean curvature
    vector over the new faces and the rim, while the rim and the wall beyond it stay (after Liepa 2003, "Filling holes
    in meshes").

    Args:
        vertices: (V, 3), m.
        faces: (F, 3), wound consistently.
        loop: (K,) the rim, in the winding of the lid that would close it (as `boundary_loops` returns it).

    Returns:
        (N, 3) new vertices, which follow the V old ones, and (M, 3) new faces of old and new vertices.

    Raises:
        MeshError: the rim folds over itself in its plane, or the wall there is degenerate; take a flat lid then.
    """
    rim = vertices[loop]
    centre = rim.mean(axis=0)
    axes = np.linalg.svd(rim - centre, full_matrices=False)[2]
    flat = (rim - centre) @ axes[:2].T
    inner = _lattice_within(flat, float(np.linalg.norm(rim - np.roll(rim, 1, axis=0), axis=1).mean()))
    triangles = _triangulate(np.concatenate([flat, inner]), len(loop))
    new_vertices = centre + inner @ axes[:2]
    new_faces = np.concatenate([loop, len(vertices) + np.arange(len(inner))])[triangles]
    if not len(inner):
        return new_vertices, new_faces
    return _fair(vertices, faces, loop, new_vertices, new_faces), new_faces


def _lattice_within(outline: Array, spacing: float) -> Array:
    """Return the (N, 2) points of a triangular lattice inside a polygon, not too near to it."""
    import shapely

    polygon = shapely.Polygon(outline)
    if not polygon.is_valid:
        raise MeshError(f"The rim of {len(outline)} edges folds over itself in its plane. Close it with a flat lid.")
    low, high = outline.min(axis=0), outline.max(axis=0)
    rows = np.arange(low[1], high[1], np.sqrt(0.75) * spacing)
    columns = np.arange(low[0], high[0] + spacing, spacing)
    x, y = np.meshgrid(columns, rows)
    x[1::2] -= 0.5 * spacing
    points = np.column_stack([x.ravel(), y.ravel()])
    kept: Array = points[shapely.contains_xy(polygon.buffer(-INSET * spacing), points)]
    return kept


def _triangulate(points: Array, num_rim: int) -> IntArray:
    """Return the (M, 3) triangles between a polygon, the first `num_rim` points, and points inside, wound like it."""
    import shapely

    polygon = shapely.Polygon(points[:num_rim])
    triangles = Delaunay(points).simplices.astype(np.int64)
    for a in range(num_rim):
        triangles = _with_edge(points, triangles, a, (a + 1) % num_rim)
    triangles = triangles[shapely.contains_xy(polygon, points[triangles].mean(axis=1))]
    is_left = _turn(*(points[triangles[:, corner]] for corner in range(3))) > 0.0
    triangles[is_left != polygon.exterior.is_ccw] = triangles[is_left != polygon.exterior.is_ccw][:, ::-1]
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    codes = edges[:, 0] * len(points) + edges[:, 1]
    open_codes = np.setdiff1d(codes, edges[:, 1] * len(points) + edges[:, 0])
    rim = np.arange(num_rim)
    if not np.array_equal(open_codes, np.sort(rim * len(points) + np.roll(rim, -1))):
        raise MeshError(f"The rim of {num_rim} edges is too uneven to be filled evenly. Close it with a flat lid.")
    return triangles


def _with_edge(points: Array, triangles: IntArray, a: int, b: int) -> IntArray:
    """Return a triangulation that has the edge from a to b, by flipping the edges that cross it."""
    for _ in range(MAX_FLIPS):
        edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
        is_apart = ~np.isin(edges, (a, b)).any(axis=1)
        crossing = np.unique(np.sort(edges[is_apart & _cross(points, edges, (a, b))], axis=1), axis=0)
        if not len(crossing):
            break
        for edge in crossing:
            sharing = np.flatnonzero(np.isin(triangles, edge).sum(axis=1) == 2)
            tips = np.setdiff1d(triangles[sharing], edge)
            if _cross(points, edge[None], (tips[0], tips[1]))[0]:  # the four corners are convex
                triangles[sharing] = [[*tips, edge[0]], [*tips, edge[1]]]
                break
    return triangles


def _cross(points: Array, edges: IntArray, other: tuple[int, int]) -> BoolArray:
    """Return whether edges pass through another one, in the plane."""
    c, d = points[edges[:, 0]], points[edges[:, 1]]
    a, b = points[list(other)]
    crossed: BoolArray = (_turn(a, b, c) * _turn(a, b, d) < 0.0) & (_turn(c, d, a) * _turn(c, d, b) < 0.0)
    return crossed


def _turn(a: Array, b: Array, c: Array) -> Array:
    """Return twice the signed area of triangles."""
    turn: Array = (b - a)[..., 0] * (c - a)[..., 1] - (b - a)[..., 1] * (c - a)[..., 0]
    return turn


def _fair(vertices: Array, faces: IntArray, loop: IntArray, new_vertices: Array, new_faces: IntArray) -> Array:
    """Return the new vertices moved to where the patch continues the wall's curvature."""
    beside = faces[np.isin(faces, loop).any(axis=1)]
    used, local = np.unique(np.concatenate([beside, new_faces]), return_inverse=True)
    positions = np.concatenate([vertices, new_vertices])[used]
    is_free = used >= len(vertices)
    is_bent = is_free | np.isin(used, loop)
    for _ in range(NUM_FAIRINGS):
        form = bending(Mesh(positions, local.reshape(-1, 3).astype(np.int64)), is_bent)
        pull = form[is_free][:, ~is_free] @ positions[~is_free]
        positions[is_free] = spsolve(form[is_free][:, is_free].tocsc(), -pull)
    if not np.isfinite(positions).all():
        raise MeshError(f"The wall around a rim of {len(loop)} edges has faces without area. Close it with a flat lid.")
    moved: Array = positions[is_free]
    return moved


def bending(mesh: Mesh, is_bent: BoolArray) -> sparse.csr_matrix:
    """Return the quadratic form of the squared mean curvature vector, integrated around some of the vertices."""
    import igl

    laplacian = igl.cotmatrix(mesh.vertices, mesh.faces).tocsr()[is_bent]
    areas = igl.massmatrix(mesh.vertices, mesh.faces, igl.MASSMATRIX_TYPE_BARYCENTRIC).diagonal()[is_bent]
    return (laplacian.T @ sparse.diags(1.0 / areas) @ laplacian).tocsr()
