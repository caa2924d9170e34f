"""Damaging known caves the way scanners, phones and mesh editors do, so that closing can be held against the truth.

Every function takes a scan with its truth and returns another one; they chain, and a seed decides every draw:

    scan = punch_holes(intact(demo_cave()), number=20, radius=0.2, seed=1)
    scan = add_noise(scan, sigma=0.01, seed=2)
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np

from aquanav_tools.cave.scan.plausibility import METRES_PER_UNIT
from aquanav_tools.cave.scan.surface import clean_mesh
from aquanav_tools.libraries import load_open3d
from aquanav_tools.synthetic.caves import SyntheticCave
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh, PointCloud

END_RADII = 2.0
"""Holes keep this many of their radii away from open ends, so that the expected number of portals stays known."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What a build has to find again in a damaged scan."""

    solid: Mesh | None
    """Closed, normals out of the water, m; None for a real cave of which nobody knows it."""
    paths: tuple[Array, ...]
    """(C, 3) lines that can be dived from one end of a passage to the other, m; empty where none is known."""
    num_portals: int
    """Open ends of the passage."""
    genus: int | None
    """Pillars and loops of the passage, where known."""


@dataclass(frozen=True, eq=False)
class DamagedScan:
    """A scan and what it was before."""

    surface: Mesh | PointCloud
    """In `unit`, moved by `offset`."""
    truth: Truth
    unit: str = "m"
    """Length unit of the surface's coordinates."""
    offset: Array = dataclasses.field(default_factory=lambda: np.zeros(3))
    """(3,) by how much the surface was moved away from the truth, m."""

    @property
    def mesh(self) -> Mesh:
        """The surface of a scan that is still a mesh."""
        if not isinstance(self.surface, Mesh):
            raise ValueError("This scan is a point cloud already; damage the mesh before sampling it.")
        return self.surface


def intact(cave: SyntheticCave) -> DamagedScan:
    """Return a synthetic passage, open at both ends, undamaged."""
    genus = int(1 - cave.truth.to_trimesh().euler_number // 2)
    return DamagedScan(cave.mesh, Truth(cave.truth, (cave.centreline,), num_portals=2, genus=genus))


def punch_holes(scan: DamagedScan, number: int, radius: float, seed: int) -> DamagedScan:
    """Return the scan without the faces within `radius` (m) of `number` places on its wall."""
    mesh, rng = scan.mesh, np.random.default_rng(seed)
    middles = mesh.triangles.mean(axis=1)
    from_ends = _distance_to(middles, mesh.vertices[_border(mesh)])
    centres = _draw_faces(mesh, from_ends > END_RADII * radius, number, rng)
    return _with_faces(scan, mesh.faces[_distance_to(middles, middles[centres]) > radius])


def tear_ends(scan: DamagedScan, length: float, seed: int) -> DamagedScan:
    """Return the scan with each open end torn off raggedly, between nothing and `length` (m) deep."""
    mesh, rng = clean_mesh(scan.mesh), np.random.default_rng(seed)
    middles = mesh.triangles.mean(axis=1)
    is_kept = np.ones(len(middles), dtype=bool)
    for rim in _largest_rims(mesh, scan.truth.num_portals):
        depth = _distance_to(middles, mesh.vertices[rim])
        offsets = middles - mesh.vertices[rim].mean(axis=0)
        normal = np.linalg.svd(mesh.vertices[rim] - mesh.vertices[rim].mean(axis=0), full_matrices=False)[2][2]
        side = np.cross(normal, [0.3, 0.5, 0.8])
        angle = np.arctan2(offsets @ np.cross(normal, side), offsets @ side)
        phases = rng.uniform(0.0, 2.0 * np.pi, 3)
        waves = sum(np.sin(k * angle + phase) for k, phase in zip((1, 2, 5), phases, strict=True))
        is_kept &= depth > length * (0.5 + waves / 6.0)
    return _with_faces(scan, mesh.faces[is_kept], mesh.vertices)


def add_noise(scan: DamagedScan, sigma: float, seed: int, *, along_normals: bool = False) -> DamagedScan:
    """Return the scan with each vertex or point moved by a normal draw of `sigma` (m), anyhow or along its normal."""
    rng = np.random.default_rng(seed)
    if isinstance(scan.surface, PointCloud):
        points = scan.surface.points + rng.normal(0.0, sigma, scan.surface.points.shape)
        return dataclasses.replace(scan, surface=dataclasses.replace(scan.surface, points=points))
    mesh = scan.mesh
    if along_normals:
        shift = rng.normal(0.0, sigma, len(mesh.vertices))[:, None] * vertex_normals(mesh)
    else:
        shift = rng.normal(0.0, sigma, mesh.vertices.shape)
    return _with_vertices(scan, mesh.vertices + shift)


def add_spikes(scan: DamagedScan, share: float, length: float, seed: int) -> DamagedScan:
    """Return the scan with a share of its vertices thrown up to `length` (m) off; a cloud gets more points there."""
    rng = np.random.default_rng(seed)
    if isinstance(scan.surface, PointCloud):
        cloud = scan.surface
        chosen = rng.choice(len(cloud.points), round(share * len(cloud.points)), replace=False)
        stray = cloud.points[chosen] + _directions(len(chosen), rng) * rng.uniform(0.0, length, (len(chosen), 1))
        normals = None if cloud.normals is None else np.concatenate([cloud.normals, _directions(len(chosen), rng)])
        return dataclasses.replace(scan, surface=PointCloud(np.concatenate([cloud.points, stray]), normals))
    vertices = scan.mesh.vertices.copy()
    chosen = rng.choice(len(vertices), round(share * len(vertices)), replace=False)
    vertices[chosen] += _directions(len(chosen), rng) * rng.uniform(0.0, length, (len(chosen), 1))
    return _with_vertices(scan, vertices)


def duplicate_shell(scan: DamagedScan, offset: float, share: float, seed: int) -> DamagedScan:
    """Return the scan with a second copy of the first `share` along its longest axis, shifted by `offset` (m).

    So registration errors look: the same wall twice, a few centimetres apart.
    """
    mesh, rng = scan.mesh, np.random.default_rng(seed)
    copied = mesh.faces[_along(mesh) <= share]
    shift = offset * _directions(1, rng)
    return _joined(scan, mesh, Mesh(mesh.vertices + shift, copied))


def solidify(scan: DamagedScan, thickness: float) -> DamagedScan:
    """Return the rock around the water as a closed shell: the wall, a second surface outside it, and rims at the ends.

    Args:
        scan: an undamaged passage; its normals point out of the water.
        thickness: of the shell, m.
    """
    mesh = clean_mesh(scan.mesh)
    outer = Mesh(mesh.vertices + thickness * vertex_normals(mesh), mesh.faces)
    num = len(mesh.vertices)
    a, b = border_edges(mesh).T
    rims = [np.stack([a, b, b + num], axis=1), np.stack([a, b + num, a + num], axis=1)]
    faces = np.concatenate([mesh.faces[:, ::-1], outer.faces + num, *rims])
    return _with_faces(scan, faces, np.concatenate([mesh.vertices, outer.vertices]))


def flip_faces(scan: DamagedScan, share: float, seed: int) -> DamagedScan:
    """Return the scan with a random share of its faces wound the other way round."""
    faces = scan.mesh.faces.copy()
    chosen = np.random.default_rng(seed).random(len(faces)) < share
    faces[chosen] = faces[chosen, ::-1]
    return _with_faces(scan, faces)


def unweld(scan: DamagedScan, seed: int, jitter: float = 0.0) -> DamagedScan:
    """Return a triangle soup: shuffled faces that share no vertices, each corner moved by up to `jitter` (m)."""
    rng = np.random.default_rng(seed)
    corners = rng.permutation(scan.mesh.triangles).reshape(-1, 3)
    corners = corners + jitter * _directions(len(corners), rng) * rng.random((len(corners), 1))
    return _with_faces(scan, np.arange(len(corners)).reshape(-1, 3), corners)


def add_debris(scan: DamagedScan, number: int, size: float, seed: int) -> DamagedScan:
    """Return the scan with `number` small closed boxes (edge `size`, m), in turn floating in the water and outside."""
    mesh, rng = scan.mesh, np.random.default_rng(seed)
    normals, faces = vertex_normals(mesh), rng.integers(0, len(mesh.faces), number)
    roots = mesh.faces[faces, 0]
    side = np.where(np.arange(number) % 2 == 0, -1.0, 1.0)[:, None]
    centres = mesh.vertices[roots] + 2.0 * size * side * normals[roots]
    return _joined(scan, mesh, *(_box(centre, size, rng) for centre in centres))


def add_fins(scan: DamagedScan, number: int, size: float, seed: int) -> DamagedScan:
    """Return the scan with extra triangles that stand on inner edges, which so have three faces; `size` in m."""
    mesh, rng = scan.mesh, np.random.default_rng(seed)
    chosen = mesh.faces[rng.choice(len(mesh.faces), number, replace=False)]
    tips = mesh.vertices[chosen[:, :2]].mean(axis=1) + size * _directions(number, rng)
    fins = np.column_stack([chosen[:, :2], len(mesh.vertices) + np.arange(number)])
    return _with_faces(scan, np.concatenate([mesh.faces, fins]), np.concatenate([mesh.vertices, tips]))


def repeat_faces(scan: DamagedScan, share: float, seed: int) -> DamagedScan:
    """Return the scan with a share of its faces twice, half of those wound backwards, and as many without an area."""
    mesh, rng = scan.mesh, np.random.default_rng(seed)
    chosen = mesh.faces[rng.random(len(mesh.faces)) < share]
    again = np.where(rng.random((len(chosen), 1)) < 0.5, chosen, chosen[:, ::-1])
    return _with_faces(scan, np.concatenate([mesh.faces, again, chosen[:, [0, 1, 1]]]))


def fold_wall(scan: DamagedScan, number: int, radius: float, seed: int) -> DamagedScan:
    """Return the scan with patches of `radius` (m) mirrored in place, so that the wall crosses itself."""
    mesh, rng = scan.mesh, np.random.default_rng(seed)
    vertices, middles = mesh.vertices.copy(), mesh.triangles.mean(axis=1)
    from_ends = _distance_to(middles, mesh.vertices[_border(mesh)])
    for centre in middles[_draw_faces(mesh, from_ends > END_RADII * radius, number, rng)]:
        is_near = np.linalg.norm(mesh.vertices - centre, axis=1) < radius
        vertices[is_near] = centre - 0.5 * (mesh.vertices[is_near] - centre)
    return _with_vertices(scan, vertices)


def split_parts(scan: DamagedScan, parts: int, shift: float, seed: int, *, flip: bool = False) -> DamagedScan:
    """Return the scan cut into parts along its longest axis, each shifted by `shift` (m) in a direction of its own.

    Args:
        scan: a mesh.
        parts: how many.
        shift: m.
        seed: of the directions.
        flip: wind every other part the other way round, as when scans of two devices are joined.
    """
    mesh, rng = scan.mesh, np.random.default_rng(seed)
    part_of = np.minimum((_along(mesh) * parts).astype(int), parts - 1)
    pieces = []
    for part, direction in enumerate(_directions(parts, rng)):
        faces = mesh.faces[part_of == part]
        pieces.append(Mesh(mesh.vertices + shift * direction, faces[:, ::-1] if flip and part % 2 else faces))
    return _joined(scan, *pieces)


def decimate(scan: DamagedScan, keep: float, share: float = 1.0) -> DamagedScan:
    """Return the scan with the first `share` along its longest axis reduced to `keep` of its faces.

    With a share below one, the seam between coarse and fine stays open, as between two exports.
    """
    mesh = clean_mesh(scan.mesh)
    is_coarse = _along(mesh) <= share
    open3d = load_open3d("Decimating a scan")
    coarse = clean_mesh(Mesh(mesh.vertices, mesh.faces[is_coarse]))
    before = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(coarse.vertices), open3d.utility.Vector3iVector(coarse.faces.astype(np.int32))
    )
    after = before.simplify_quadric_decimation(round(keep * len(coarse.faces)))
    reduced = Mesh(np.asarray(after.vertices).copy(), np.asarray(after.triangles).astype(np.int64))
    return _joined(scan, reduced, Mesh(mesh.vertices, mesh.faces[~is_coarse]))


def convert_unit(scan: DamagedScan, unit: str) -> DamagedScan:
    """Return the scan with its coordinates in another unit."""
    factor = METRES_PER_UNIT[scan.unit] / METRES_PER_UNIT[unit]
    return dataclasses.replace(_with_positions(scan, _positions(scan) * factor), unit=unit)


def move_away(scan: DamagedScan, offset: tuple[float, float, float]) -> DamagedScan:
    """Return the scan moved by `offset` (m), as in a national grid; the truth stays where it is."""
    moved = _with_positions(scan, _positions(scan) + np.array(offset) / METRES_PER_UNIT[scan.unit])
    return dataclasses.replace(moved, offset=scan.offset + np.array(offset))


Normals = Literal["none", "true", "inverted", "mixed"]


def sample_cloud(
    scan: DamagedScan, spacing: float, normals: Normals, seed: int, *, fall_off: float | None = None
) -> DamagedScan:
    """Return a point cloud of the scan, evenly random or denser towards one end.

    Args:
        scan: a mesh.
        spacing: mean distance of the points where they are densest, m.
        normals: towards the water ("true"), out of it ("inverted"), each either way ("mixed"), or "none".
        seed: of every draw.
        fall_off: density falls to half after this way from the lowest end of the longest axis, m.
    """
    mesh, rng = scan.mesh, np.random.default_rng(seed)
    corners = mesh.triangles
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(crosses, axis=1)
    if fall_off is not None:
        length = float(np.ptp(mesh.vertices, axis=0).max())
        areas = areas * 0.5 ** (_along(mesh) * length / fall_off)
    chosen = rng.choice(len(areas), round(areas.sum() / spacing**2), p=areas / areas.sum())
    points = np.einsum("nk,nkx->nx", rng.dirichlet(np.ones(3), len(chosen)), corners[chosen])
    inward = -crosses[chosen] / np.linalg.norm(crosses[chosen], axis=1, keepdims=True)
    if normals == "none":
        return dataclasses.replace(scan, surface=PointCloud(points))
    signs = {
        "true": np.ones(len(points)),
        "inverted": -np.ones(len(points)),
        "mixed": rng.choice([-1.0, 1.0], len(points)),
    }
    return dataclasses.replace(scan, surface=PointCloud(points, inward * signs[normals][:, None]))


def vertex_normals(mesh: Mesh) -> Array:
    """Return the (V, 3) unit normals of the vertices, weighted by the area of their faces."""
    corners = mesh.triangles
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], crosses)
    unit: Array = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return unit


def _positions(scan: DamagedScan) -> Array:
    return scan.surface.vertices if isinstance(scan.surface, Mesh) else scan.surface.points


def _with_positions(scan: DamagedScan, positions: Array) -> DamagedScan:
    if isinstance(scan.surface, Mesh):
        return _with_vertices(scan, positions)
    return dataclasses.replace(scan, surface=dataclasses.replace(scan.surface, points=positions))


def _with_vertices(scan: DamagedScan, vertices: Array) -> DamagedScan:
    return dataclasses.replace(scan, surface=Mesh(vertices, scan.mesh.faces))


def _with_faces(scan: DamagedScan, faces: IntArray, vertices: Array | None = None) -> DamagedScan:
    """Return the scan with other faces, and without vertices that none of them uses."""
    vertices = scan.mesh.vertices if vertices is None else vertices
    used, inverse = np.unique(faces, return_inverse=True)
    return dataclasses.replace(scan, surface=Mesh(vertices[used], inverse.reshape(-1, 3).astype(np.int64)))


def _joined(scan: DamagedScan, *meshes: Mesh) -> DamagedScan:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    return _with_faces(scan, faces, np.concatenate([mesh.vertices for mesh in meshes]))


def _along(mesh: Mesh) -> Array:
    """Return the (F,) place of each face along the longest axis of the mesh, from 0 to 1."""
    extent = np.ptp(mesh.vertices, axis=0)
    axis = int(extent.argmax())
    place: Array = (mesh.triangles.mean(axis=1)[:, axis] - mesh.vertices[:, axis].min()) / extent[axis]
    return place


def border_edges(mesh: Mesh) -> IntArray:
    """Return the (E, 2) edges with a single face, directed as in that face."""
    directed = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    _, inverse, counts = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    border: IntArray = directed[counts[inverse.ravel()] == 1]
    return border


def _border(mesh: Mesh) -> IntArray:
    border: IntArray = np.unique(border_edges(mesh))
    return border


def _largest_rims(mesh: Mesh, number: int) -> list[IntArray]:
    """Return the vertices of the connected borders with the largest extent."""
    import trimesh

    rims = [np.asarray(rim) for rim in trimesh.graph.connected_components(border_edges(mesh), min_len=3)]
    return sorted(rims, key=lambda rim: -float(np.linalg.norm(np.ptp(mesh.vertices[rim], axis=0))))[:number]


def _draw_faces(mesh: Mesh, allowed: BoolArray, number: int, rng: np.random.Generator) -> IntArray:
    corners = mesh.triangles
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) * allowed
    drawn: IntArray = rng.choice(len(areas), number, replace=False, p=areas / areas.sum())
    return drawn


def _distance_to(points: Array, targets: Array) -> Array:
    """Return the (N,) distance to the nearest target; infinite where there is none."""
    from scipy.spatial import cKDTree

    if not len(targets):
        return np.full(len(points), np.inf)
    distance: Array = cKDTree(targets).query(points)[0]
    return distance


def _directions(number: int, rng: np.random.Generator) -> Array:
    vectors = rng.normal(size=(number, 3))
    unit: Array = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit


def _box(centre: Array, size: float, rng: np.random.Generator) -> Mesh:
    """Return a closed box of slightly random proportions."""
    import trimesh

    box = trimesh.creation.box(size * rng.uniform(0.6, 1.0, 3))
    return Mesh(np.array(box.vertices) + centre, np.array(box.faces, dtype=np.int64))
