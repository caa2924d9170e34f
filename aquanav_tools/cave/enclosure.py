"""Is it a cave? How much of the view from inside is wall that was really scanned."""

from __future__ import annotations

import numpy as np

from aquanav_tools.errors import MeshError
from aquanav_tools.types import Array, Mesh

MIN_ENCLOSURE = 0.6
"""A facade fills at most half of the view of any point before it; the middle of a passage sees 0.8 and more."""
NUM_DIRECTIONS = 256


def enclosure(surface: Mesh, viewpoints: Array) -> Array:
    """Return the (N,) shares of all directions in which the scanned surface is in view from (N, 3) points."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    TriangleMesh(scene, surface.triangles.astype(np.float32))
    directions = sphere_directions(NUM_DIRECTIONS)
    origins = np.repeat(viewpoints, len(directions), axis=0).astype(np.float32)
    hits = scene.run(origins, np.tile(directions, (len(viewpoints), 1)).astype(np.float32), query="OCCLUDED")
    shares: Array = (np.asarray(hits).reshape(len(viewpoints), -1) >= 0).mean(axis=1)
    return shares


def check_enclosure(surface: Mesh, viewpoints: Array, what: str) -> float:
    """Return the median enclosure at some viewpoints inside.

    Args:
        surface: the scan, without anything invented.
        viewpoints: (N, 3) places in the water, m.
        what: how the message calls them, for example "the cameras".

    Raises:
        MeshError: it is below MIN_ENCLOSURE: the scene is no cave.
    """
    share = float(np.median(enclosure(surface, viewpoints)))
    if share < MIN_ENCLOSURE:
        raise MeshError(
            f"This is no cave: from {what}, the scanned surface fills only {share:.0%} of the view all around, and a "
            f"passage needs {MIN_ENCLOSURE:.0%}. It is a facade, a floor or an object seen from outside. Scan the walls "
            "on all sides, or the passage whose inside is to be dived."
        )
    return share


def sphere_directions(count: int) -> Array:
    """Return (count, 3) unit vectors spread evenly over the sphere (Fibonacci lattice)."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * index
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
