"""Views of caves for pictures: cut open, seen through the near wall; or from outside, as a block of rock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image

from aquanav_tools.envs.pictures.lamp_light import vertex_normals
from aquanav_tools.envs.pictures.triangles import Eye, see
from aquanav_tools.report.relief import plan_and_section
from aquanav_tools.report.scene_model import PORTAL_COLOUR, ROUTE, by_height
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Array, IntArray, Mesh

SAMPLES = 3
"""Per pixel along each side."""
PAPER = (11, 31, 42)
TAN = 0.30
"""Half the width of a picture at 1 m."""
ROOM = 1.1
"""Of a picture over what is in it."""
Pixels = npt.NDArray[np.uint8]


class View(NamedTuple):
    """From where, and how large, px."""

    eye: Eye
    width: int
    height: int


def view_of(vertices: Array, centreline: Array, width: int, height: int | None = None) -> View:
    """Return a view of a cave's long side from above, as near as all of it fits; as high as it needs where not said."""
    _, section = plan_and_section(centreline)
    back = section.towards + np.array([0.0, 0.0, 0.9])
    back /= np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(-back, right), -back])
    flat = vertices @ axes.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    wide, high_by, deep = high - low
    if height is None:
        height = round(width * 1.25 * high_by / wide) // 2 * 2
    distance = 0.5 * ROOM * max(wide, high_by * width / height) / TAN + 0.5 * deep
    middle = 0.5 * (low + high) @ axes
    focal = 0.5 * width * SAMPLES / TAN
    eye = Eye(width * SAMPLES, height * SAMPLES, focal, middle + distance * back, axes, 10.0 * distance)
    return View(eye, width, height)


def cut_open(cave: Scenario, view: View) -> Image.Image:
    """Return a cave seen through its near wall, pale where it is high and blue where it is low, with its route."""
    mesh = cave.cavity.mesh
    colours = by_height(mesh.vertices).astype(float)
    inside = mesh.faces[:, ::-1]  # only wall that faces the viewer from within is seen
    shades = _lit(mesh, view.eye, colours)[inside].mean(axis=1)
    shades[cave.cavity.labels != 0] = PORTAL_COLOUR
    picture = _painted(view.eye, mesh.vertices, inside, shades)
    goal = cave.guide.panels[-1].polygon
    _draw(picture, view.eye, cave.guide.centreline, ROUTE)
    _draw(picture, view.eye, np.vstack([goal, goal[:1]]), PORTAL_COLOUR)
    return _reduced(picture, view)


def from_outside(
    mesh: Mesh, view: View, colours: Array, lines: Sequence[Array] = (), *, is_cut: bool = False
) -> Image.Image:
    """Return a mesh as seen from outside: both sides of its faces, or, cut, those alone that face the viewer.

    Args:
        mesh: m.
        view: of it.
        colours: (F, 3) of its faces, 0 to 255.
        lines: (N, 3) each, drawn over it, m.
        is_cut: whether faces that look away are left out.
    """
    light = _lit(mesh, view.eye, np.ones((len(mesh.vertices), 3)))
    shades = np.clip(light[mesh.faces].mean(axis=1) * colours, 0.0, 255.0)
    faces = mesh.faces if is_cut else np.concatenate([mesh.faces, mesh.faces[:, ::-1]])
    picture = _painted(view.eye, mesh.vertices, faces, shades if is_cut else np.concatenate([shades, shades]))
    for line in lines:
        _draw(picture, view.eye, line, ROUTE)
    return _reduced(picture, view)


def _draw(picture: Pixels, eye: Eye, line: Array, colour: tuple[int, int, int]) -> None:
    points = np.round(8.0 * eye.project(line)).astype(np.int32)
    cv2.polylines(picture, [points], False, colour, 3 * SAMPLES, cv2.LINE_AA, 3)


def _lit(mesh: Mesh, eye: Eye, colours: Array) -> Array:
    """Return colours of vertices, brighter where they face the viewer or the sky."""
    normals = vertex_normals(mesh)
    towards = eye.centre - mesh.vertices
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    facing = np.abs(np.einsum("ij,ij->i", normals, towards))
    light = 0.45 + 0.65 * facing + 0.25 * np.clip(-normals[:, 2], 0.0, 1.0)
    return np.clip(colours * light[:, None], 0.0, 255.0)


def _painted(eye: Eye, vertices: Array, faces: IntArray, shades: Array) -> Pixels:
    seen, _, origins = see(eye, vertices, faces)
    return np.where((seen >= 0)[..., None], shades[origins[seen]], PAPER).astype(np.uint8)


def _reduced(picture: Pixels, view: View) -> Image.Image:
    return Image.fromarray(picture).resize((view.width, view.height), Image.Resampling.BOX)
