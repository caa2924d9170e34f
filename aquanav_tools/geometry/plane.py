"""Axes of planes across a passage."""

from __future__ import annotations

import numpy as np

from aquanav_tools.types import Array


def plane_axes(normal: Array) -> Array:
    """Return the (2, 3) axes of a plane: first horizontal, second as upright as the plane allows."""
    horizontal = np.cross([0.0, 0.0, 1.0], normal)
    if np.linalg.norm(horizontal) < 1e-6:
        horizontal = np.array([1.0, 0.0, 0.0])
    horizontal = horizontal / np.linalg.norm(horizontal)
    return np.stack([horizontal, np.cross(normal, horizontal)])
