"""Meshes as Wavefront OBJ, z up, metres, with their colours in a picture that all of them share.

Simulators agree on no colours per vertex, but all take a texture: its pixels are all colours of five bits per channel,
and each face takes the one of its own. So a face has one colour, to 4 of 255.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from aquanav_tools.types import Array, IntArray, Mesh

PALETTE, MATERIALS = "palette.png", "palette.mtl"
BITS = 5
"""Per channel."""
WIDTH, HEIGHT = 256, 128
"""2^(3 BITS) pixels."""


def write_palette(folder: Path) -> None:
    """Write the picture of all colours and the material that names it."""
    from PIL import Image

    numbers = np.arange(WIDTH * HEIGHT)
    levels = np.stack([numbers >> 2 * BITS, numbers >> BITS, numbers], axis=1) & (2**BITS - 1)
    pixels = np.round(levels * (255.0 / (2**BITS - 1))).astype(np.uint8).reshape(HEIGHT, WIDTH, 3)
    Image.fromarray(pixels).save(folder / PALETTE)
    (folder / MATERIALS).write_text(f"newmtl palette\nKa 1 1 1\nKd 1 1 1\nmap_Kd {PALETTE}\n", encoding="ascii")


def face_colours(mesh: Mesh) -> npt.NDArray[np.uint8]:
    """Return the (F, 3) sRGB of the faces of a mesh with colours: the mean of each one's corners."""
    assert mesh.colours is not None, "only meshes that are shown have their colours written"
    means = mesh.colours[mesh.faces].astype(np.float64).mean(axis=1)
    return np.round(means).astype(np.uint8)


def write_obj(mesh: Mesh, path: Path) -> None:
    """Write a mesh; one with colours refers to the palette beside it."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in mesh.vertices]
    corners = mesh.faces + 1
    if mesh.colours is None:
        lines += [f"f {a} {b} {c}\n" for a, b, c in corners]
    else:
        used, places = np.unique(_palette_numbers(face_colours(mesh)), return_inverse=True)
        lines = [f"mtllib {MATERIALS}\n", *lines, *(f"vt {u:.9g} {v:.9g}\n" for u, v in _pixels(used))]
        lines.append("usemtl palette\n")
        lines += [f"f {a}/{t} {b}/{t} {c}/{t}\n" for (a, b, c), t in zip(corners, places.ravel() + 1, strict=True)]
    path.write_text("".join(lines), encoding="ascii")


def _palette_numbers(colours: npt.NDArray[np.uint8]) -> IntArray:
    levels = np.round(colours * ((2**BITS - 1) / 255.0)).astype(np.int64)
    return (levels[:, 0] << 2 * BITS) + (levels[:, 1] << BITS) + levels[:, 2]


def _pixels(numbers: IntArray) -> Array:
    """Return (N, 2) texture coordinates of the middles of pixels; v runs upwards from the picture's last row."""
    return np.stack([(numbers % WIDTH + 0.5) / WIDTH, 1.0 - (numbers // WIDTH + 0.5) / HEIGHT], axis=1)
