"""Views of a cavity: from outside on both long sides, and from inside, lit by a lamp at the camera.

Those from inside look along the route, and at each open end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import WALL, Cavity, Portal
from aquanav_tools.geometry.plane import plane_axes
from aquanav_tools.geometry.polyline import arc_lengths, point_at
from aquanav_tools.report.camera import SUPERSAMPLING, Camera, Scene, Shot, is_visible, pixel_of, shrink
from aquanav_tools.report.cave_map import CaveMap
from aquanav_tools.report.figures import BAD, INK, MUTED, PAPER, PORTAL, draw_scale_bar, new_figure, save_figure
from aquanav_tools.report.labels import Labels
from aquanav_tools.report.relief import plan_and_section
from aquanav_tools.types import Array

DPI = 130
WIDTH_IN = 11.0
MARGIN_IN = 0.45
CAPTION_IN = 0.3
FOOT_IN = 0.65
MAX_OUTSIDE_IN = 4.2
ROCK = np.array([0.80, 0.75, 0.67])
FILLED = np.array([0.56, 0.46, 0.78])
"""Wall that the scan did not see: violet, like no rock."""
LID = np.array([0.984, 0.337, 0.027])
DEEP = np.array([0.03, 0.12, 0.18])
"""What the lamp does not reach."""
SUN = np.array([-0.35, 0.65, 0.70])
"""Direction to the light of outside views, in their frame: right, up, towards the viewer."""
TILT = np.radians(32.0)
"""Outside views look down, or up, at this angle."""
STATIONS = (0.04, 0.38, 0.72)
"""Where inside views stand, as shares of the route: at the entrance, before and behind the middle."""
LOOK_AHEAD = 0.06
"""An inside view looks at the place this share of the route ahead."""
MIN_LOOK_AHEAD = 1.5
"""... and at least this far, m: nearer, the direction would follow the route's smallest bends."""
FIELD_OF_VIEW = np.radians(90.0)
LAMP_REACH = 3.0
"""Distance at which the lamp is half as bright, in widths of the passage (roots of its mean section)."""
END_COLUMNS = 3
END_BACK = 1.2
"""A view of an open end stands this far before it, in roots of its area ..."""
END_ROOM = 0.7
"""... or this share of the way to the wall behind, where that is nearer."""
HAZE_STEP = 16
"""Every so many pixels tell from where to where the haze grows."""
HOOP_STEP = 0.01
"""Distance between the dots a panel's outline is drawn with, m."""


def draw_views(cave: CaveMap, panels: tuple[Array, ...], path: Path) -> None:
    """Write a PNG with two views from outside and three from inside.

    Rock that the scan saw, wall that was filled in and portals differ in colour; panels are drawn as white hoops.

    Args:
        cave: the cave, its route and the marked places.
        panels: (K, 3) outline of each panel, m.
        path: of the PNG.
    """
    scene = Scene(cave.cavity.mesh)
    outside, inside = _outside_cameras(cave), _inside_cameras(cave)
    room = WIDTH_IN - 2 * MARGIN_IN
    tall = min(room / outside[0].aspect, MAX_OUTSIDE_IN)
    small = (room - 2 * MARGIN_IN) / 3
    page = 2 * (tall + CAPTION_IN) + small / inside[0].aspect + CAPTION_IN + FOOT_IN + MARGIN_IN
    figure = new_figure(WIDTH_IN, page)
    bottom = page - 0.5 * MARGIN_IN
    for camera, caption in zip(outside, ("Outside, from above", "Outside, from the other side and below"), strict=True):
        bottom -= tall + CAPTION_IN
        size = (tall * camera.aspect, tall)
        axes = _add_picture(figure, (0.5 * (WIDTH_IN - size[0]), bottom), size, caption)
        _draw(figure, axes, cave, panels, scene, camera)
    bottom -= small / inside[0].aspect + CAPTION_IN
    for column, (camera, share) in enumerate(zip(inside, STATIONS, strict=True)):
        caption = f"Inside, {share * cave.length:.1f} m along the route, looking ahead"
        corner = (MARGIN_IN + column * (small + MARGIN_IN), bottom)
        axes = _add_picture(figure, corner, (small, small / camera.aspect), caption)
        _draw(figure, axes, cave, panels, scene, camera)
    draw_scale_bar(figure, 0.5 * tall * outside[0].aspect / outside[0].reach, MARGIN_IN, 0.2)
    _draw_key(figure, cave, page)
    save_figure(figure, path, DPI)


def draw_ends(cave: CaveMap, names: Sequence[str], path: Path) -> None:
    """Write a PNG with a view of each open end from inside.

    Args:
        cave: the cave; it has open ends.
        names: of the ends.
        path: of the PNG.
    """
    scene, portals = Scene(cave.cavity.mesh), cave.cavity.portals
    rows = math.ceil(len(portals) / END_COLUMNS)
    small = (WIDTH_IN - (END_COLUMNS + 1) * MARGIN_IN) / END_COLUMNS
    cameras = [_end_camera(portal, scene) for portal in portals]
    tall = small / cameras[0].aspect + CAPTION_IN
    page = rows * tall + FOOT_IN + MARGIN_IN
    figure = new_figure(WIDTH_IN, page)
    for n, (portal, name, camera) in enumerate(zip(portals, names, cameras, strict=True)):
        row, column = divmod(n, END_COLUMNS)
        corner = (MARGIN_IN + column * (small + MARGIN_IN), page - 0.5 * MARGIN_IN - (row + 1) * tall)
        caption = f"{name[0].upper()}{name[1:]}: portal {portal.label}, {portal.area:.1f} m²"
        axes = _add_picture(figure, corner, (small, small / camera.aspect), caption)
        _draw(figure, axes, cave, (), scene, camera)
    _draw_key(figure, cave, page)
    save_figure(figure, path, DPI)


def _end_camera(portal: Portal, scene: Scene) -> Camera:
    """Return a pinhole camera in the water that looks straight at an open end."""
    left, up = plane_axes(portal.normal)
    start = portal.centre - 1e-3 * portal.normal
    behind = scene.look(Camera(start, left, up, 1e-6, 1.0, is_parallel=False), 1).distance[0, 0]
    back = min(END_BACK * np.sqrt(portal.area), END_ROOM * behind)
    return Camera(start - back * portal.normal, -left, up, float(np.tan(0.5 * FIELD_OF_VIEW)), 4 / 3, is_parallel=False)


def _outside_cameras(cave: CaveMap) -> tuple[Camera, Camera]:
    """Return parallel cameras at both long sides of the cave, one above it and one below, on one scale."""
    _, section = plan_and_section(cave.centreline)
    vertices = cave.cavity.mesh.vertices
    cameras = []
    for side, tilt in ((1.0, TILT), (-1.0, -TILT)):
        right = side * section.right
        towards = np.cos(tilt) * side * section.towards + np.array([0.0, 0.0, np.sin(tilt)])
        up = np.cross(towards, right)
        flat = vertices @ np.stack([right, up, towards], axis=1)
        low, high = flat.min(axis=0), flat.max(axis=0)
        middle = 0.5 * (low + high) + [0.0, 0.0, high[2] - low[2] + 1.0]
        cameras.append((middle @ np.stack([right, up, towards]), right, up, 0.5 * (high - low)[:2]))
    half = 1.02 * np.max([extent for *_, extent in cameras], axis=0)
    first, second = (
        Camera(position, right, up, float(half[0]), float(half[0] / half[1]), is_parallel=True)
        for position, right, up, _ in cameras
    )
    return first, second


def _inside_cameras(cave: CaveMap) -> tuple[Camera, ...]:
    """Return pinhole cameras on the route that look along it."""
    lengths = arc_lengths(cave.centreline)
    ahead = max(LOOK_AHEAD * lengths[-1], MIN_LOOK_AHEAD)
    cameras = []
    for share in STATIONS:
        here = min(share * lengths[-1], max(lengths[-1] - ahead, 0.0))
        position, target = point_at(cave.centreline, lengths, np.array([here, min(here + ahead, lengths[-1])]))
        left, up = plane_axes((target - position) / np.linalg.norm(target - position))
        cameras.append(Camera(position, -left, up, float(np.tan(0.5 * FIELD_OF_VIEW)), 4 / 3, is_parallel=False))
    return tuple(cameras)


def _add_picture(figure: Any, corner_in: tuple[float, float], size_in: tuple[float, float], caption: str) -> Any:
    page = figure.get_size_inches()
    axes = figure.add_axes((*(np.array(corner_in) / page), *(np.array(size_in) / page)))
    axes.set_axis_off()
    axes.set_title(caption, loc="left", color=MUTED, fontsize=8.5 if size_in[0] < 4.0 else 10, pad=4)
    return axes


def _draw(figure: Any, axes: Any, cave: CaveMap, panels: tuple[Array, ...], scene: Scene, camera: Camera) -> None:
    """Draw what a camera sees, with hoops for the panels and the names of portals and marks that are in sight."""
    width_in = axes.get_position().width * WIDTH_IN
    shot = scene.look(camera, round(SUPERSAMPLING * DPI * width_in))
    surface = paint(cave.cavity)
    colours = _sunlit(scene, shot, camera, surface) if camera.is_parallel else _lamplit(shot, surface, cave)
    slack = 0.004 * float(np.ptp(cave.cavity.mesh.vertices, axis=0).max())
    for outline in panels:
        _draw_hoop(colours, shot, camera, outline, cave, slack)
    height, width = shot.faces.shape
    axes.imshow(shrink(colours), extent=(0, width, height, 0), interpolation="antialiased")
    labels = Labels(figure, axes)
    places = [(portal.centre, f"Portal {portal.label}", PORTAL, False) for portal in cave.cavity.portals]
    # A mark stands in the middle of the water, so from outside its own wall hides it: show it all the same.
    places += [(m.position, m.text, BAD if m.is_warning else INK, camera.is_parallel) for m in cave.marks]
    for position, text, colour, must in places:
        if must or is_visible(shot, camera, position[None], slack)[0]:
            (row, column), _ = (values[0] for values in pixel_of(shot, camera, position[None]))
            axes.scatter(column, row, marker="D", s=22, color=colour, edgecolors="white", linewidths=0.8, zorder=5)
            labels.add(np.array([column, row]), text, color=colour, fontweight="bold")


def paint(cavity: Cavity) -> Array:
    """Return the (F, 3) colour of each face: rock that was seen, wall that was filled in, portal."""
    colours = np.where(cavity.observed[:, None], ROCK, FILLED)
    painted: Array = np.where((cavity.labels == WALL)[:, None], colours, LID)
    return painted


def _sunlit(scene: Scene, shot: Shot, camera: Camera, surface: Array) -> Array:
    """Return the (H, W, 3) colours of a view from outside; what is farther away is a little paler."""
    towards = np.stack([camera.right, camera.up, -camera.ahead])
    light = 0.45 + 0.6 * np.clip(scene.normals_towards(camera) @ (SUN / np.linalg.norm(SUN) @ towards), 0.0, 1.0)
    near, far = np.percentile(shot.distance[shot.is_hit][::HAZE_STEP], (1.0, 99.0))
    haze = 0.25 * np.clip((shot.distance - near) / max(far - near, 1e-9), 0.0, 1.0)[..., None]
    lit = np.minimum(surface * light[:, None], 1.0)[shot.faces]
    return np.where(shot.is_hit[..., None], lit + haze * (1.0 - lit), 1.0)


def _lamplit(shot: Shot, surface: Array, cave: CaveMap) -> Array:
    """Return the (H, W, 3) colours of a view from inside: bright near the lamp and where the wall faces it."""
    light = (0.2 + 0.9 * shot.facing) * _lamp(shot.distance, cave)
    colours = DEEP + (surface[shot.faces] - DEEP) * light[..., None]
    return np.where(shot.is_hit[..., None], np.clip(colours, 0.0, 1.0), DEEP)


def _lamp(distance: Array, cave: CaveMap) -> Array:
    """Return the brightness of the lamp at a distance, 1 at the lamp."""
    reach = LAMP_REACH * float(np.sqrt(np.mean([section.area for section in cave.sections])))
    brightness: Array = 1.0 / (1.0 + (distance / reach) ** 2)
    return brightness


def _draw_hoop(colours: Array, shot: Shot, camera: Camera, outline: Array, cave: CaveMap, slack: float) -> None:
    """Paint the visible part of a panel's (K, 3) outline into the picture, in place; inside, it fades as the wall."""
    closed = np.vstack([outline, outline[:1]])
    lengths = arc_lengths(closed)
    dots = point_at(closed, lengths, np.linspace(0.0, lengths[-1], 2 + int(lengths[-1] / HOOP_STEP)))
    dots = dots[is_visible(shot, camera, dots, slack)]
    if not len(dots):
        return
    pixels, distance = pixel_of(shot, camera, dots)
    rows, columns = pixels.astype(int).T
    paint_share = 0.75 * (1.0 if camera.is_parallel else _lamp(distance, cave)[:, None])
    for down in range(SUPERSAMPLING):
        for across in range(SUPERSAMPLING):
            row = np.clip(rows + down, 0, len(colours) - 1)
            column = np.clip(columns + across, 0, colours.shape[1] - 1)
            colours[row, column] = (1.0 - paint_share) * colours[row, column] + paint_share


def _draw_key(figure: Any, cave: CaveMap, height: float) -> None:
    from matplotlib.lines import Line2D

    square: dict[str, Any] = {"marker": "s", "linestyle": "", "markersize": 9}
    entries = [
        Line2D([], [], color=tuple(ROCK), label=f"wall, {cave.seen}", **square),
        Line2D([], [], color=tuple(FILLED), label=f"wall, {cave.filled}", **square),
        Line2D([], [], color=tuple(LID), label="portal", **square),
        Line2D([], [], color="#b9c6cc", linewidth=1.2, label="panel"),
    ]
    for is_warning, colour, name in ((False, INK, "free width"), (True, BAD, "too narrow")):
        if any(mark.is_warning == is_warning for mark in cave.marks):
            entries.append(Line2D([], [], color=colour, marker="D", linestyle="", markersize=5, label=name))
    figure.legend(
        handles=entries, loc="lower right", bbox_to_anchor=(1.0 - MARGIN_IN / WIDTH_IN, 0.1 / height),
        ncols=len(entries), frameon=False, fontsize=9, labelcolor=INK, handletextpad=0.4, columnspacing=1.3,
        facecolor=PAPER,
    )  # fmt: skip
