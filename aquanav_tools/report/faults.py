"""A picture of what is wrong with a surface: numbered markers on views from several sides, and where they are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.report.camera import SUPERSAMPLING, Camera, Scene, Shot, shrink
from aquanav_tools.report.figures import BAD, INK, MUTED, draw_scale_bar, new_figure, save_figure
from aquanav_tools.report.labels import Labels
from aquanav_tools.types import Array, Mesh

DPI = 130
WIDTH_IN = 11.0
MARGIN_IN = 0.55
HEAD_IN = 0.3
CAPTION_IN = 0.6
FOOT_IN = 0.9
MAX_VIEW_IN = 5.0
LINE_IN = 0.19
MAX_LISTED = 20
"""More faults than this are drawn without a number: nobody repairs them one by one."""
MAX_GRAINS = 60_000
GRAIN = 0.0015
"""Half the size of a cloud's grains, shares of the cloud's diagonal."""
SURFACE = np.array([0.72, 0.78, 0.80])
CAPTIONS = (
    "From above: x to the right, y up",
    "Looking north: x to the right, z up",
    "Looking west: y to the right, z up",
)


def draw_faults(mesh: Mesh, points: Array, labels: Sequence[str], path: Path) -> None:
    """Write a PNG of a surface from above and from two sides, with a numbered red marker at every fault.

    Faults show through the surface, since a hole on the far side matters as much. The first MAX_LISTED are listed below
    with their coordinates.

    Args:
        mesh: the surface, open or closed.
        points: (N, 3) where the faults are, m, the gravest first.
        labels: N short descriptions, such as "hole, 0.42 m wide".
        path: of the PNG.

    Raises:
        ValueError: there are not as many labels as points.
    """
    if len(points) != len(labels):
        raise ValueError(f"{len(points)} faults have {len(labels)} labels.")
    scene, cameras = Scene(mesh), _cameras(mesh)
    room = WIDTH_IN - 2 * MARGIN_IN
    scale = min(room / (2 * max(c.reach for c in cameras)), MAX_VIEW_IN / max(2 * c.reach / c.aspect for c in cameras))
    sizes = [(scale * 2 * camera.reach, scale * 2 * camera.reach / camera.aspect) for camera in cameras]
    listed = min(len(points), MAX_LISTED) + (len(points) > MAX_LISTED)
    page = HEAD_IN + sum(size[1] + CAPTION_IN for size in sizes) + LINE_IN * listed + FOOT_IN
    figure = new_figure(WIDTH_IN, page)
    title = f"{len(points)} places" if len(points) != 1 else "1 place"
    figure.text(MARGIN_IN / WIDTH_IN, 1 - 0.2 / page, title, color=INK, fontsize=13, fontweight="bold", va="top")
    bottom = page - HEAD_IN
    for camera, size, caption in zip(cameras, sizes, CAPTIONS, strict=True):
        bottom -= size[1] + CAPTION_IN
        axes = figure.add_axes((0.5 - 0.5 * size[0] / WIDTH_IN, bottom / page, size[0] / WIDTH_IN, size[1] / page))
        _draw_view(figure, axes, scene, camera, size[0], points)
        _style_axes(axes, caption, size)
    _write_list(figure, points, labels, bottom - 0.35, page)
    draw_scale_bar(figure, scale, MARGIN_IN, 0.16)
    save_figure(figure, path, DPI)


def grains(points: Array) -> Mesh:
    """Return a small tetrahedron for each of (N, 3) points, or of MAX_GRAINS of them, so that a cloud can be drawn."""
    chosen = points[np.linspace(0, len(points) - 1, min(len(points), MAX_GRAINS)).astype(np.int64)]
    size = GRAIN * float(np.linalg.norm(np.percentile(points, 98, axis=0) - np.percentile(points, 2, axis=0)))
    corners = chosen[:, None] + size * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    first = 4 * np.arange(len(chosen))[:, None, None]
    faces = first + np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    return Mesh(corners.reshape(-1, 3), faces.reshape(-1, 3))


def _cameras(mesh: Mesh) -> tuple[Camera, ...]:
    """Return parallel cameras that look down, north and west, so that coordinates can be read off."""
    east, north, up = np.eye(3)
    cameras = []
    for right, above in ((east, north), (east, up), (north, up)):
        axes = np.stack([right, above, np.cross(right, above)])
        flat = mesh.vertices @ axes.T
        low, high = flat.min(axis=0), flat.max(axis=0)
        size = np.maximum(1.04 * (high - low), 0.02 * np.ptp(mesh.vertices, axis=0).max())
        middle = 0.5 * (low + high) + [0.0, 0.0, size[2]]
        cameras.append(Camera(middle @ axes, right, above, float(0.5 * size[0]), float(size[0] / size[1]), True))
    return tuple(cameras)


def _draw_view(figure: Any, axes: Any, scene: Scene, camera: Camera, width_in: float, points: Array) -> None:
    shot = scene.look(camera, round(SUPERSAMPLING * DPI * width_in))
    middle, half_height = (camera.position @ camera.right, camera.position @ camera.up), camera.reach / camera.aspect
    extent = (middle[0] - camera.reach, middle[0] + camera.reach, middle[1] - half_height, middle[1] + half_height)
    axes.imshow(shrink(_shade(scene, shot, camera)), extent=extent, interpolation="antialiased", aspect="auto")
    if not len(points):
        return
    flat = points @ np.stack([camera.right, camera.up], axis=1)
    axes.scatter(*flat.T, s=34, marker="o", facecolor=BAD, edgecolors="white", linewidths=0.8, zorder=5, clip_on=False)
    names = Labels(figure, axes)
    names.keep_free(flat, 3.0)
    for number, place in enumerate(flat[:MAX_LISTED], start=1):
        names.add(place, str(number), color=BAD, fontweight="bold", fontsize=10)


def _style_axes(axes: Any, caption: str, size_in: tuple[float, float]) -> None:
    axes.set_title(caption, loc="left", color=MUTED, fontsize=10, pad=4)
    axes.tick_params(colors=MUTED, labelsize=8, length=3)
    axes.locator_params(axis="x", nbins=max(2, int(2 * size_in[0])))
    axes.locator_params(axis="y", nbins=max(2, int(2 * size_in[1])))
    for spine in axes.spines.values():
        spine.set_color("#dbe4e8")


def _shade(scene: Scene, shot: Shot, camera: Camera) -> Array:
    """Return the (H, W, 3) colours: pale, so that the markers stand out, lit from the upper left."""
    sun = 0.6 * (camera.up - 0.6 * camera.right) - camera.ahead
    light = 0.5 + 0.55 * np.clip(scene.normals_towards(camera) @ (sun / np.linalg.norm(sun)), 0.0, 1.0)
    return np.where(shot.is_hit[..., None], np.minimum(SURFACE * light[:, None], 1.0)[shot.faces], 1.0)


def _write_list(figure: Any, points: Array, labels: Sequence[str], top_in: float, page: float) -> None:
    lines = [
        f"{number:>3}   ({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f}) m   {label}"
        for number, (point, label) in enumerate(zip(points[:MAX_LISTED], labels[:MAX_LISTED], strict=True), start=1)
    ]
    if len(points) > MAX_LISTED:
        lines.append(f"      and {len(points) - MAX_LISTED} more, drawn without a number")
    for row, line in enumerate(lines):
        height = (top_in - LINE_IN * row) / page
        figure.text(MARGIN_IN / WIDTH_IN, height, line, color=INK, fontsize=9.5, va="top")
