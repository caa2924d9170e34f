"""Numbers, turns and XML as the formats write them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, indent

import numpy as np

from aquanav_tools.types import Array, rotation_matrix


def row(values: float | Sequence[float] | Array) -> str:
    """Return numbers with nine digits, enough for float32, parted by spaces."""
    return " ".join(f"{value:.9g}" for value in np.atleast_1d(values))


def save_xml(root: Element, path: Path) -> None:
    """Write an XML file with a line per element."""
    indent(root)
    ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def rotation_to(direction: Array) -> Array:
    """Return the (4,) quaternion (w, x, y, z) of the shortest turn that takes z to a (3,) unit vector."""
    x, y, z = direction
    if z < -1.0 + 1e-12:
        return np.array([0.0, 1.0, 0.0, 0.0])  # half a turn about x; every axis across would do
    turn = np.array([1.0 + z, -y, x, 0.0])
    unit: Array = turn / np.linalg.norm(turn)
    return unit


def roll_pitch_yaw(quaternion: Array) -> Array:
    """Return (3,) angles about fixed x, y, z in this order, rad, of a quaternion (w, x, y, z): URDF's and SDF's rpy."""
    turn = rotation_matrix(quaternion)
    pitch = np.arcsin(np.clip(-turn[2, 0], -1.0, 1.0))
    if abs(turn[2, 0]) > 1.0 - 1e-12:  # straight up or down, where roll and yaw are one: all of it is yaw
        return np.array([0.0, pitch, np.arctan2(-turn[0, 1], turn[1, 1])])
    return np.array([np.arctan2(turn[2, 1], turn[2, 2]), pitch, np.arctan2(turn[1, 0], turn[0, 0])])


def pose6(position: Array, quaternion: Array) -> str:
    """Return a pose as SDF writes it: x y z roll pitch yaw."""
    return f"{row(position)} {row(roll_pitch_yaw(quaternion))}"
