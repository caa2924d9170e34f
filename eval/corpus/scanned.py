"""The original benchmark's caves and real scans, as they are and damaged further."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from aquanav_tools.cave.scan.surface import clean_mesh
from aquanav_tools.synthetic import damage
from aquanav_tools.synthetic.damage import DamagedScan, Truth, border_edges
from aquanav_tools.types import Array, Mesh
from eval.corpus.cases import Case

MIN_END = 0.9
"""A rim of this extent is the open end of a passage; those of the scans measure over 2 m or under 0.2 m."""
GRID_SAMPLES = 400_000
"""Of the grid on which a path through a scanned cave is sought."""


def original_cases(data_dir: Path) -> list[Case]:
    """Return the caves of the original benchmark: as placed, closed by its authors, and in raw coordinates."""
    meshes = data_dir / "saferlauv" / "meshes"
    scenes = ("easy", "medium", "eval1")
    opened = [Case(f"original-{key}", "original", partial(_original, data_dir, key)) for key in scenes]
    closed = [Case(f"original-{key}-closed", "original", partial(_closed, data_dir, key)) for key in scenes]
    others = [*meshes.glob("easy_?_cave.obj"), *meshes.glob("native/Cave_*.obj")]
    rest = [Case(f"original-{path.stem}", "original", partial(capped_scan, path)) for path in sorted(others)]
    return [*opened, *closed, *rest] if meshes.is_dir() else []


def scan_cases(data_dir: Path) -> list[Case]:
    """Return the real scans. Of Han-sur-Lesse the truth is its main piece with a fan over each of its three holes."""
    han, finnish = data_dir / "scan_han_sur_lesse" / "cave.stl", data_dir / "scan_finnish_cave1" / "cave1.stl"
    if not han.is_file() or not finnish.is_file():
        return []
    damages = {
        "": lambda scan: scan,
        "-cloud": lambda scan: damage.sample_cloud(scan, 0.05, "none", 1),
        "-cloud-normals": lambda scan: damage.sample_cloud(scan, 0.05, "true", 2),
        "-noise-2cm": lambda scan: damage.add_noise(scan, 0.02, 3),
        "-decimated-20": lambda scan: damage.decimate(scan, 0.2),
        "-holes-20x20cm": lambda scan: damage.punch_holes(scan, 20, 0.2, 4),
    }
    cases = []
    for name, make in (("han", partial(capped_scan, han)), ("finnish", partial(_without_truth, finnish))):
        for suffix, step in damages.items():
            step_by_step = partial(_then, make, step)
            cases.append(Case(name + suffix, "scan", step_by_step, keeps_handles=False, is_quick=suffix == ""))
    return cases


def _then(make: Callable[[], DamagedScan], step: Callable[[DamagedScan], DamagedScan]) -> DamagedScan:
    return step(make())


def capped_scan(path: Path) -> DamagedScan:
    """Return an open scan; the truth is its main piece with a fan to the middle of every hole, normals outwards."""
    import trimesh

    mesh = read_mesh(path)
    main = max(mesh.to_trimesh().split(only_watertight=False, repair=False), key=lambda piece: len(piece.faces))
    open_mesh = Mesh(np.array(main.vertices), np.array(main.faces, dtype=np.int64))
    edges = border_edges(open_mesh)
    rims = [np.asarray(rim) for rim in trimesh.graph.connected_components(edges, min_len=3)]
    middles = [open_mesh.vertices[rim].mean(axis=0) for rim in rims]
    fans = []
    for place, rim in enumerate(rims):
        a, b = edges[np.isin(edges[:, 0], rim)].T
        fans.append(np.stack([b, a, np.full(len(a), len(open_mesh.vertices) + place)], axis=1))
    solid = Mesh(np.concatenate([open_mesh.vertices, middles]), np.concatenate([open_mesh.faces, *fans]))
    extents = [float(np.linalg.norm(np.ptp(open_mesh.vertices[rim], axis=0))) for rim in rims]
    ends = [middle for middle, extent in zip(middles, extents, strict=True) if extent > MIN_END]
    solid, mesh = _outward(solid, solid), _outward(solid, mesh)
    paths = (path_inside(solid, ends[0], ends[1]),) if len(ends) >= 2 else ()
    genus = int(1 - solid.to_trimesh().euler_number // 2)
    return DamagedScan(mesh, Truth(solid, paths, num_portals=len(ends), genus=genus))


def path_inside(solid: Mesh, start: Array, goal: Array) -> Array:
    """Return a (C, 3) path through the water that keeps to its middle, by Dijkstra's search on a grid of clearance."""
    from skimage.graph import route_through_array

    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    step = float(np.cbrt(np.prod(high - low) / GRID_SAMPLES))
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    clearance = -signed_distance(solid, grid.reshape(-1, 3)).reshape(grid.shape[:3])
    cost = np.where(clearance > 0.0, 1.0 / np.maximum(clearance, 0.1 * step) ** 2, -1.0)
    water = np.argwhere(clearance > 0.0)
    ends = [water[np.argmin(np.linalg.norm(low + step * water - end, axis=1))] for end in (start, goal)]
    cells, _ = route_through_array(cost, *ends)
    path: Array = low + step * np.array(cells)
    return path


def signed_distance(solid: Mesh, points: Array) -> Array:
    """Return the (N,) distances to a closed mesh, negative inside, by open3d's ray casting."""
    from aquanav_tools.libraries import load_open3d

    open3d = load_open3d()
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(solid.vertices.astype(np.float32), solid.faces.astype(np.uint32))
    distance: Array = scene.compute_signed_distance(points.astype(np.float32)).numpy().astype(np.float64)
    return distance


def read_mesh(path: Path) -> Mesh:
    """Return a mesh file, welded."""
    import trimesh

    loaded = trimesh.load(path, process=False, force="mesh")
    return clean_mesh(Mesh(np.array(loaded.vertices, dtype=np.float64), np.array(loaded.faces, dtype=np.int64)))


def _original(data_dir: Path, key: str) -> DamagedScan:
    folder = data_dir / "saferlauv"
    mesh, closed = (
        read_mesh(folder / "meshes" / f"{key}_cave.obj"),
        read_mesh(folder / "meshes" / f"{key}_cave_closed.ply"),
    )
    scene = json.loads((folder / "scenes" / f"{key}.json").read_text(encoding="utf-8"))
    path = np.array(scene["centreline"]["points"])
    truth = Truth(_outward(closed, closed), (path,), num_portals=2, genus=0)
    return DamagedScan(_outward(closed, mesh), truth)


def _closed(data_dir: Path, key: str) -> DamagedScan:
    scan = _original(data_dir, key)
    solid = scan.truth.solid
    assert solid is not None
    return DamagedScan(solid, Truth(solid, scan.truth.paths, num_portals=0, genus=0))


def _without_truth(path: Path) -> DamagedScan:
    """Return a scan too damaged to be capped by hand; one end of it is open."""
    return DamagedScan(read_mesh(path), Truth(None, (), num_portals=1, genus=None))


def _outward(closed: Mesh, mesh: Mesh) -> Mesh:
    """Return a mesh turned inside out if the closed mesh it belongs to has a negative volume."""
    return mesh if closed.volume > 0.0 else Mesh(mesh.vertices, mesh.faces[:, ::-1])
