"""Decoding USD (text, binary or USDZ) in another process: every mesh and cloud of points that is shown, placed.

Source: OpenUSD, UsdGeom: `metersPerUnit` is 0.01 and `upAxis` Y where a stage does not say.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.scan.announced import check_count
from aquanav_tools.cave.scan.models import model_tables
from aquanav_tools.cave.scan.surface_file import unreadable
from aquanav_tools.errors import InputError
from aquanav_tools.types import Array, IntArray, Mesh, PointCloud

INTERNAL_NAME = re.compile(r"pxrInternal_\w+::")
MAX_REASON = 300


def prepare() -> None:
    """Load what `decode` needs."""
    from pxr import Gf, Usd, UsdGeom, UsdShade  # noqa: F401


def decode(path: Path) -> Iterator[Any]:
    """Yield the `model_tables` of a USD file; of meshes if it has any, else of its points.

    Raises:
        InputError: it has neither.
        ResourceError: it has too many points.
    """
    from pxr import Tf

    try:
        yield from _decoded(path)
    except Tf.ErrorException as cause:
        raise unreadable(path, _reason(cause)) from cause
    except ValueError as cause:
        raise unreadable(path, str(cause)) from cause


def _decoded(path: Path) -> Iterator[Any]:
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    places = UsdGeom.XformCache()
    meshes: list[Mesh] = []
    clouds: list[PointCloud] = []
    num_points = 0
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
        if not (prim.IsA(UsdGeom.Mesh) or prim.IsA(UsdGeom.Points)) or not _is_shown(UsdGeom.Imageable(prim)):
            continue
        points = np.array(UsdGeom.PointBased(prim).GetPointsAttr().Get() or (), dtype=np.float64).reshape(-1, 3)
        num_points += len(points)
        check_count(path, num_points)
        matrix = np.array(places.GetLocalToWorldTransform(prim))  # for row vectors
        placed = points @ matrix[:3, :3] + matrix[3, :3]
        if prim.IsA(UsdGeom.Points):
            clouds.append(PointCloud(placed, None, _display_colours(prim, len(points), None)))
        else:
            meshes.append(_mesh(prim, placed, is_mirrored=float(np.linalg.det(matrix[:3, :3])) < 0.0))
    surface = _all_meshes(meshes) if meshes else _all_points(clouds)
    if surface is None:
        raise InputError(
            f"{path} has no mesh and no points that are shown: it is a scene of other things, or of parts in other "
            "files. Export the scan itself."
        )
    axis = str(UsdGeom.GetStageUpAxis(stage)).lower()
    yield from model_tables(surface, float(UsdGeom.GetStageMetersPerUnit(stage)), axis)


def _reason(error: Any) -> str:
    """Return the first of the reasons in an error of OpenUSD, whose str() fails at times."""
    try:
        told = " ".join(error.args[0].commentary.split())
    except (IndexError, UnicodeDecodeError):  # it quotes the file's own bytes
        return "its library names no reason that is text"
    return INTERNAL_NAME.sub("", told)[:MAX_REASON].rstrip(".")


def _is_shown(prim: Any) -> bool:
    from pxr import UsdGeom

    return (
        prim.ComputeVisibility() != UsdGeom.Tokens.invisible
        and prim.ComputePurpose() not in (UsdGeom.Tokens.guide, UsdGeom.Tokens.proxy)
    )  # fmt: skip


def _mesh(prim: Any, points: Array, *, is_mirrored: bool) -> Mesh:
    """Return the triangles of a mesh, fans of its polygons.

    Raises:
        ValueError: its polygons name points that are not there.
    """
    from pxr import UsdGeom

    mesh = UsdGeom.Mesh(prim)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or (), dtype=np.int64)
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get() or (), dtype=np.int64)
    if (counts < 0).any() or counts.sum() != len(corners):
        raise ValueError(f"{prim.GetPath()} announces polygons with {counts.sum():,} corners and has {len(corners):,}")
    if len(corners) and not (corners.min() >= 0 and corners.max() < len(points)):
        raise ValueError(f"{prim.GetPath()} has corners that are none of its {len(points):,} points")
    holes = np.array(mesh.GetHoleIndicesAttr().Get() or (), dtype=np.int64)
    colours = _display_colours(prim, len(points), (counts, corners))
    faces = _fans(counts, corners, holes)
    if (mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded) != is_mirrored:
        faces = faces[:, ::-1]
    return Mesh(points, faces, colours)


def _fans(counts: IntArray, corners: IntArray, holes: IntArray) -> IntArray:
    """Return (F, 3) triangles of polygons with so many corners each; those named as holes are left out."""
    counts = counts.copy()
    begins = np.cumsum(counts) - counts
    counts[holes[(holes >= 0) & (holes < len(counts))]] = 0
    num = np.maximum(counts - 2, 0)
    begin = np.repeat(begins, num)
    nth = np.arange(num.sum()) - np.repeat(np.cumsum(num) - num, num)
    return np.stack([corners[begin], corners[begin + nth + 1], corners[begin + nth + 2]], axis=1)


def _display_colours(
    prim: Any, num_points: int, polygons: tuple[IntArray, IntArray] | None
) -> npt.NDArray[np.uint8] | None:
    """Return the RGB of each point as the attribute displayColor gives it; None without, or where it does not fit."""
    from pxr import UsdGeom

    primvar = UsdGeom.Gprim(prim).GetDisplayColorPrimvar()
    values = np.array((primvar.ComputeFlattened() if primvar else None) or (), dtype=np.float64).reshape(-1, 3)
    if not len(values) or not num_points or not np.isfinite(values).all():
        return None
    rgb = np.clip(np.rint(255.0 * values), 0, 255).astype(np.uint8)
    if len(rgb) == 1:
        return np.tile(rgb, (num_points, 1))
    kind = primvar.GetInterpolation()
    if kind in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying) and len(rgb) == num_points:
        return rgb
    if polygons is None:
        return None
    counts, corners = polygons
    if kind == UsdGeom.Tokens.uniform and len(rgb) == len(counts):
        rgb = np.repeat(rgb, counts, axis=0)
    if kind not in (UsdGeom.Tokens.uniform, UsdGeom.Tokens.faceVarying) or len(rgb) != len(corners):
        return None
    result = np.zeros((num_points, 3), dtype=np.uint8)
    result[corners] = rgb
    return result


def _all_meshes(meshes: list[Mesh]) -> Mesh | None:
    begins = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = np.concatenate([mesh.faces + begin for mesh, begin in zip(meshes, begins[:-1], strict=True)])
    if not len(faces):
        return None
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]), faces, _all_colours([mesh.colours for mesh in meshes])
    )


def _all_points(clouds: list[PointCloud]) -> PointCloud | None:
    if not sum(len(cloud.points) for cloud in clouds):
        return None
    return PointCloud(
        np.concatenate([cloud.points for cloud in clouds]), None, _all_colours([cloud.colours for cloud in clouds])
    )


def _all_colours(colours: list[npt.NDArray[np.uint8] | None]) -> npt.NDArray[np.uint8] | None:
    """Return the colours of all parts; None unless each has some."""
    known = [each for each in colours if each is not None]
    return np.concatenate(known) if known and len(known) == len(colours) else None
