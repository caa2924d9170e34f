"""Small scans in many formats, written by the libraries' own writers, or by hand from a format's specification."""

from __future__ import annotations

import io
import struct
import zipfile
from pathlib import Path

import numpy as np
import trimesh

BOX = (2.0, 3.0, 4.0)
"""Edges of the box that models hold, in metres along world x, y and z; its middle is at CENTRE."""
CENTRE = np.array([5.0, -1.0, 2.0])
RED = (200, 30, 10)

Array = np.ndarray


def box() -> tuple[Array, Array]:
    """Return the (8, 3) corners, m, and (12, 3) triangles of a box, wound outwards."""
    solid = trimesh.creation.box(BOX)
    return np.array(solid.vertices) + CENTRE, np.array(solid.faces)


def y_up(points: Array) -> Array:
    """Return points of a world with z up in axes with y up, turned by a cyclic permutation of the axes."""
    return points[:, [1, 2, 0]]


def write_dae(path: Path, unit: float = 0.01, up: str = "Y_UP") -> None:
    """Write the box by hand, after the COLLADA 1.4.1 specification."""
    points, faces = box()
    placed = (y_up(points) if up == "Y_UP" else points) / unit
    numbers = " ".join(f"{value:.9g}" for value in placed.ravel())
    path.write_text(f"""<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2026-01-01T00:00:00Z</created><modified>2026-01-01T00:00:00Z</modified>
<unit name="own" meter="{unit}"/><up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="box"><mesh>
<source id="p"><float_array id="pa" count="24">{numbers}</float_array>
<technique_common><accessor source="#pa" count="8" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/>
<p>{" ".join(map(str, faces.ravel()))}</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#box"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
""")


MODEL = "3D/3dmodel.model"
RELATIONS = """<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship
Target="/3D/3dmodel.model" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>"""
METRES = {None: 0.001, "millimeter": 0.001, "inch": 0.0254, "foot": 0.3048, "meter": 1.0, "micron": 1e-6}
"""By the unit, after the 3MF Core Specification."""


def write_3mf(path: Path, unit: str | None = "millimeter") -> None:
    """Write the box by hand, moved into its place by the transformation of its item."""
    points, faces = box()
    scale = 1.0 / METRES[unit]
    vertices = "".join('<vertex x="{:.9g}" y="{:.9g}" z="{:.9g}"/>'.format(*p) for p in scale * (points - CENTRE))
    triangles = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*face) for face in faces)
    moved = " ".join(f"{value:.9g}" for value in scale * CENTRE)
    text = f"""<?xml version="1.0" encoding="UTF-8"?>
<model {f'unit="{unit}" ' if unit else ""}xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
<resources><object id="1" type="model"><mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>
</object></resources><build><item objectid="1" transform="1 0 0 0 1 0 0 0 1 {moved}"/></build></model>"""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("_rels/.rels"), RELATIONS, zipfile.ZIP_DEFLATED)
        archive.writestr(zipfile.ZipInfo(MODEL), text, zipfile.ZIP_DEFLATED)


def write_usd(path: Path, metres_per_unit: float | None = 0.01, up: str | None = "Y") -> None:
    """Write the box as quads with OpenUSD, under a parent that moves it, with a colour."""
    from pxr import Sdf, Usd, UsdGeom, UsdUtils

    scale = 1.0 / (metres_per_unit or 0.01)
    turned = y_up if (up or "Y") == "Y" else np.array
    layer = path.with_suffix(".usdc") if path.suffix == ".usdz" else path
    stage = Usd.Stage.CreateNew(str(layer))
    if metres_per_unit:
        UsdGeom.SetStageMetersPerUnit(stage, metres_per_unit)
    if up:
        UsdGeom.SetStageUpAxis(stage, up)
    root = UsdGeom.Xform.Define(stage, "/scan")
    root.AddTranslateOp().Set(tuple(scale * turned(CENTRE[None])[0]))
    mesh = UsdGeom.Mesh.Define(stage, "/scan/wall")
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * BOX
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    mesh.CreatePointsAttr((scale * turned(corners)).astype(np.float32))
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr(np.ravel(quads).tolist())
    mesh.CreateDisplayColorAttr([tuple(value / 255.0 for value in RED)])
    stage.GetRootLayer().Save()
    if path.suffix == ".usdz":
        UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(layer)), str(path))
        layer.unlink()


STATIONS = np.array([[3.0, 0.2, 0.5], [7.0, -0.2, 0.5]])
"""Of two scans in a tube along x, m."""
TUBE = (10.0, 1.5)
"""Its length and radius; it begins at x = 0, and its axis is y = z = 0. Its ends are scanned, too."""


def tube_points(num: int) -> Array:
    """Return (num, 3) points on the wall and the ends of a closed tube, spread by area."""
    rng = np.random.default_rng(3)
    length, radius = TUBE
    is_wall = rng.random(num) < length / (length + radius)
    angle = rng.uniform(0.0, 2.0 * np.pi, num)
    across = np.where(is_wall, radius, radius * np.sqrt(rng.random(num)))
    x = np.where(is_wall, length * rng.random(num), length * rng.integers(0, 2, num))
    return np.stack([x, across * np.cos(angle), across * np.sin(angle)], axis=1)


def scans(num: int) -> list[tuple[Array, Array, Array]]:
    """Return for each station its points in its own frame, and the frame: (3, 3) world_from_scanner and the station."""
    points = tube_points(num)
    nearest = np.linalg.norm(points[:, None] - STATIONS, axis=2).argmin(axis=1)
    turns = (np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.eye(3))  # 90 degrees about z, and none
    return [
        ((points[nearest == n] - station) @ turn, turn, station)
        for n, (turn, station) in enumerate(zip(turns, STATIONS, strict=True))
    ]


def write_e57(path: Path, num: int = 400, *, has_poses: bool = True) -> None:
    """Write the tube's two scans with pye57, with a colour."""
    import pye57

    path.unlink(missing_ok=True)
    quaternions = (np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]), np.array([1.0, 0.0, 0.0, 0.0]))
    file = pye57.E57(str(path), mode="w")
    for (points, turn, station), quaternion in zip(scans(num), quaternions, strict=True):
        xyz = points if has_poses else points @ turn.T + station
        columns = {f"cartesian{axis}": xyz[:, n] for n, axis in enumerate("XYZ")}
        colours = {f"color{name}": np.full(len(xyz), value, np.uint8) for name, value in zip(NAMES, RED, strict=True)}
        pose = {"rotation": quaternion, "translation": station} if has_poses else {}
        file.write_scan_raw({**columns, **colours}, **pose)
    file.close()


NAMES = ("Red", "Green", "Blue")


def write_ptx(path: Path, num: int = 200) -> None:
    """Write the tube's two scans by hand, each with a direction without return."""
    parts = []
    for points, turn, station in scans(num):
        rows = "".join(f"{x:.6f} {y:.6f} {z:.6f} 0.5 {RED[0]} {RED[1]} {RED[2]}\n" for x, y, z in points)
        place = "{:.6f} {:.6f} {:.6f}\n".format(*station)
        axes = "".join("{:.6f} {:.6f} {:.6f}\n".format(*axis) for axis in turn.T)
        matrix = "".join("{:.6f} {:.6f} {:.6f} 0\n".format(*row) for row in turn.T)
        head = f"{len(points) + 1}\n1\n{place}{axes}{matrix}{place[:-1]} 1\n"
        parts.append(f"{head}{rows}0 0 0 0.5 0 0 0\n")
    path.write_text("".join(parts))


def write_pts(path: Path, num: int = 200) -> None:
    """Write the tube by hand in two blocks, each behind its count."""
    rows = ["{:.6f} {:.6f} {:.6f} -1200 {} {} {}\n".format(*point, *RED) for point in tube_points(num)]
    half = num // 3
    path.write_text(f"{half}\n{''.join(rows[:half])}{num - half}\n{''.join(rows[half:])}")


PCD = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS x y z rgb normal_x normal_y normal_z label
SIZE 4 4 4 4 4 4 4 2
TYPE F F F U F F F U
COUNT 1 1 1 1 1 1 1 2
WIDTH {num}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {num}
DATA {encoding}
"""
RECORD = np.dtype([*((name, "<f4") for name in "xyz"), ("rgb", "<u4"), ("n", "<f4", 3), ("label", "<u2", 2)])


def pcd_table(num: int) -> Array:
    """Return the tube's points as a PCD holds them, their normals towards its axis."""
    points = tube_points(num)
    table = np.zeros(num, RECORD)
    for n, name in enumerate("xyz"):
        table[name] = points[:, n]
    table["rgb"] = (RED[0] << 16) | (RED[1] << 8) | RED[2]
    table["n"] = -points * [0.0, 1.0, 1.0] / np.linalg.norm(points[:, 1:], axis=1, keepdims=True)
    return table


def write_pcd(path: Path, encoding: str = "binary", num: int = 60) -> None:
    """Write the tube by hand; `binary_compressed` as LZF allows, without repeats."""
    table = pcd_table(num)
    head = PCD.format(num=num, encoding=encoding).encode()
    if encoding == "ascii":
        rows = (" ".join(map(str, [*row.tolist()[:4], *row["n"], *row["label"]])) + "\n" for row in table)
        path.write_bytes(head + "".join(rows).encode())
    elif encoding == "binary":
        path.write_bytes(head + table.tobytes())
    else:
        content = b"".join(np.ascontiguousarray(table[name]).tobytes() for name in RECORD.names)
        packed = literal_lzf(content)
        path.write_bytes(head + struct.pack("<II", len(packed), len(content)) + packed)


def literal_lzf(content: bytes) -> bytes:
    """Return bytes packed with LZF as runs that stand for themselves."""
    stream = io.BytesIO()
    for begin in range(0, len(content), 32):
        part = content[begin : begin + 32]
        stream.write(bytes([len(part) - 1]) + part)
    return stream.getvalue()
