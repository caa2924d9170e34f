"""The scenario's geometry files: cave.ply, collision.obj, field.npz, guide.json, starts.json."""

from __future__ import annotations

import io
import json
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import Cavity, Portal
from aquanav_tools.cave.centreline.graph import NO_NETWORK, CentrelineGraph
from aquanav_tools.cave.route.guide import Guide, Panel
from aquanav_tools.cave.route.starts import Start
from aquanav_tools.errors import ScenarioError
from aquanav_tools.geometry.volume.field import BRICK, DistanceField, field_from_bricks
from aquanav_tools.scenario.centreline_table import graph_from_table, graph_to_table
from aquanav_tools.text_files import NOT_A_TABLE, read_json, read_text
from aquanav_tools.types import Array, Mesh, Pose

MAX_ARRAY_BYTES = 1_000_000_000
"""Bound on each array of a distance field: 250 million samples, eight times what a build makes."""
UNIT_TOLERANCE = 1e-3
"""By which an orientation's quaternion may differ from length 1."""
MAX_HEADER_BYTES = 1_000
"""Bound on what an array's file holds beside it; NumPy writes 128."""


def write_cavity(cavity: Cavity, path: Path) -> None:
    """Write a binary PLY: float32 vertices, faces with the properties `label` and `observed` (uchar)."""
    solid = cavity.mesh.to_trimesh()
    solid.face_attributes["label"] = cavity.labels.astype(np.uint8)
    solid.face_attributes["observed"] = cavity.observed.astype(np.uint8)
    path.write_bytes(solid.export(file_type="ply", vertex_normal=False))


def read_cavity(path: Path, portals: tuple[Portal, ...]) -> Cavity:
    """Return the cavity in a PLY that `write_cavity` wrote."""
    import trimesh

    try:
        solid = trimesh.load(path, file_type="ply", process=False)
        faces = solid.metadata["_ply_raw"]["face"]["data"]
        labels, observed = faces["label"].astype(np.int64), faces["observed"].astype(bool)
    except Exception as cause:  # whatever a damaged file makes the parser raise
        raise ScenarioError(f"{path} is not a cavity with face labels: {cause!r}. Build the scenario again.") from cause
    mesh = Mesh(np.array(solid.vertices, dtype=np.float64), np.array(solid.faces, dtype=np.int64))
    _check_mesh(mesh, path)
    known = {0, *(portal.label for portal in portals)}
    if not set(np.unique(labels)) <= known:
        raise ScenarioError(f"{path} has face labels {np.unique(labels)}, the guide knows {known}. Build it again.")
    return Cavity(mesh, labels, observed, portals)


def write_collision(mesh: Mesh, path: Path) -> None:
    """Write a Wavefront OBJ with 9 significant digits, enough for float32."""
    vertices = "v %.9g %.9g %.9g\n" * len(mesh.vertices) % tuple(mesh.vertices.ravel().tolist())
    faces = "f %d %d %d\n" * len(mesh.faces) % tuple((mesh.faces + 1).ravel().tolist())
    path.write_text(vertices + faces, encoding="ascii")


def read_collision(path: Path) -> Mesh:
    """Return the mesh in an OBJ that `write_collision` wrote: lines `v x y z`, then `f a b c`, nothing else."""
    text = read_text(path, ScenarioError)
    try:
        first_face = text.index("f ")
        vertices = np.loadtxt(io.StringIO(text[:first_face].replace("v ", "")), ndmin=2)
        faces = np.loadtxt(io.StringIO(text[first_face:].replace("f ", "")), dtype=np.int64, ndmin=2) - 1
    except ValueError as cause:
        raise ScenarioError(f"{path} is not a triangle mesh: {cause}. Build the scenario again.") from cause
    mesh = Mesh(vertices, faces)
    _check_mesh(mesh, path)
    return mesh


def write_field(field: DistanceField, path: Path) -> None:
    """Write the arrays `origin`, `spacing`, `bricks` and `clearance` (the samples of each brick), compressed."""
    cores = field.samples[:, :BRICK, :BRICK, :BRICK]
    with path.open("wb") as stream:
        np.savez_compressed(stream, origin=field.origin, spacing=field.spacing, bricks=field.bricks, clearance=cores)


def read_field(path: Path) -> DistanceField:
    """Return the distance field in an NPZ that `write_field` wrote.

    Nothing in it is unpickled, and nothing is unpacked before its size is known.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            origin = read_member(archive, "origin", np.float64, (3,))
            spacing = float(read_member(archive, "spacing", np.float64, ()))
            bricks = read_member(archive, "bricks", np.int32, (-1, -1, -1))
            cores = read_member(archive, "clearance", np.float32, (-1, BRICK, BRICK, BRICK))
    except Exception as cause:  # whatever a damaged archive, or an array's header, makes the parsers raise
        raise ScenarioError(f"{path} is not a distance field: {cause!r}. Build the scenario again.") from cause
    if not bricks.size or not len(cores) or not spacing > 0:
        raise ScenarioError(
            f"{path} has bricks {bricks.shape}, samples {cores.shape} and spacing {spacing}. Build the scenario again."
        )
    if bricks.min() < 0 or bricks.max() >= len(cores):
        raise ScenarioError(
            f"{path} names bricks {bricks.min()} to {bricks.max()}, but holds {len(cores)}. Build the scenario again."
        )
    if not (np.isfinite(origin).all() and np.isfinite(spacing) and np.isfinite(cores).all()):
        raise ScenarioError(f"{path} has values that are not finite. Build the scenario again.")
    return field_from_bricks(origin, spacing, bricks, cores)


def read_member(archive: zipfile.ZipFile, name: str, dtype: type[np.generic], shape: tuple[int, ...]) -> Any:
    """Return one array of an NPZ, -1 standing for any length, after checking what its header promises.

    Raises:
        ValueError: it is too large, or of another type or shape.
    """
    member = archive.getinfo(f"{name}.npy")
    with archive.open(member) as stream:
        if np.lib.format.read_magic(stream) != (1, 0):
            raise ValueError(f"{name} is not an array of NumPy's format 1.0")
        have, fortran_order, stored = np.lib.format.read_array_header_1_0(stream)
        num_bytes = math.prod(have) * stored.itemsize
        if num_bytes > MAX_ARRAY_BYTES or member.file_size > MAX_ARRAY_BYTES + MAX_HEADER_BYTES:
            raise ValueError(f"{name} takes {max(num_bytes, member.file_size)} bytes, more than {MAX_ARRAY_BYTES}")
        fits = len(have) == len(shape) and all(want in (-1, n) for want, n in zip(shape, have, strict=True))
        if stored != dtype or fortran_order or not fits:
            raise ValueError(f"{name} is of type {stored} and shape {have}")
        content = stream.read(num_bytes + 1)
    if len(content) != num_bytes:
        raise ValueError(f"{name} should hold {num_bytes} bytes and holds {len(content)}")
    return np.frombuffer(content, dtype=dtype).reshape(have).copy()


def write_guide(guide: Guide, portals: tuple[Portal, ...], path: Path, network: CentrelineGraph = NO_NETWORK) -> None:
    """Write the centreline, panels, portals and centreline graph as JSON."""
    panels = [
        {
            "centre": panel.centre.tolist(),
            "normal": panel.normal.tolist(),
            "polygon": panel.polygon.tolist(),
            "arc_length": panel.arc_length,
            "clearance": panel.clearance,
        }
        for panel in guide.panels
    ]
    lids = [
        {"label": lid.label, "centre": lid.centre.tolist(), "normal": lid.normal.tolist(), "area": lid.area}
        for lid in portals
    ]
    table = {"centreline": guide.centreline.tolist(), "panels": panels, "portals": lids}
    _write_json({**table, "centreline_graph": graph_to_table(network)}, path)


def read_guide(path: Path) -> tuple[Guide, tuple[Portal, ...]]:
    """Return the guide and the portals in a JSON that `write_guide` wrote."""
    table = _read_json(path)
    try:
        panels = tuple(
            Panel(
                _array(panel["centre"], (3,)),
                _array(panel["normal"], (3,)),
                _array(panel["polygon"], (-1, 3)),
                float(panel["arc_length"]),
                float(panel["clearance"]),
            )
            for panel in table["panels"]
        )
        portals = tuple(
            Portal(int(lid["label"]), _array(lid["centre"], (3,)), _array(lid["normal"], (3,)), float(lid["area"]))
            for lid in table["portals"]
        )
        return Guide(_array(table["centreline"], (-1, 3)), panels), portals
    except NOT_A_TABLE as cause:
        raise ScenarioError(f"{path} is not a guide: {cause!r}. Build the scenario again.") from cause


def read_network(path: Path) -> CentrelineGraph:
    """Return the centreline graph in a JSON that `write_guide` wrote; folders of earlier versions have none."""
    table = _read_json(path).get("centreline_graph")
    try:
        return graph_from_table(table) if table is not None else NO_NETWORK
    except NOT_A_TABLE as cause:
        raise ScenarioError(f"{path} has no valid centreline graph: {cause!r}. Build the scenario again.") from cause


def write_starts(starts: tuple[Start, ...], path: Path) -> None:
    """Write the start poses as JSON."""
    rows = [
        {
            "position": start.pose.position.tolist(),
            "orientation": start.pose.orientation.tolist(),
            "clearance": start.clearance,
            "geodesic_to_goal": start.geodesic_to_goal,
            "difficulty": start.difficulty,
        }
        for start in starts
    ]
    _write_json({"starts": rows}, path)


def read_starts(path: Path) -> tuple[Start, ...]:
    """Return the start poses in a JSON that `write_starts` wrote; at least one."""
    try:
        starts = tuple(
            Start(
                Pose(_array(row["position"], (3,)), _quaternion(row["orientation"])),
                float(row["clearance"]),
                float(row["geodesic_to_goal"]),
                float(row["difficulty"]),
            )
            for row in _read_json(path)["starts"]
        )
    except NOT_A_TABLE as cause:
        raise ScenarioError(f"{path} has no valid start poses: {cause!r}. Build the scenario again.") from cause
    if not starts:
        raise ScenarioError(f"{path} lists no start pose. Build the scenario again.")
    return starts


def _write_json(table: dict[str, Any], path: Path) -> None:
    path.write_text(json.dumps(table, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _read_json(path: Path) -> dict[str, Any]:
    table = read_json(path, ScenarioError)
    if not isinstance(table, dict):
        raise ScenarioError(f"{path} must hold a table. Build the scenario again.")
    return table


def _array(value: object, shape: tuple[int, ...]) -> Array:
    array = np.array(value, dtype=np.float64)
    if array.ndim != len(shape) or any(want not in (-1, have) for want, have in zip(shape, array.shape, strict=True)):
        raise ValueError(f"expected shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError("a value is not finite")
    return array


def _quaternion(value: object) -> Array:
    quaternion = _array(value, (4,))
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise ValueError(f"an orientation has length {length:g}, not 1")
    return quaternion


def _check_mesh(mesh: Mesh, path: Path) -> None:
    in_range = mesh.faces.size and mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)
    if mesh.vertices.shape[1:] != (3,) or mesh.faces.shape[1:] != (3,) or not in_range:
        raise ScenarioError(
            f"{path} has vertices {mesh.vertices.shape} and faces {mesh.faces.shape} that do not fit. Build it again."
        )
    if not np.isfinite(mesh.vertices).all():
        raise ScenarioError(f"{path} has vertices that are not finite. Build the scenario again.")
