"""Is it a cave? How much of the view from inside is wall that was really scanned."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.scan.orientation import Caster, face_areas
from aquanav_tools.errors import MeshError
from aquanav_tools.types import Array, Mesh

MIN_ENCLOSURE = 0.6
"""A facade fills at most half of the view of any point before it; the middle of a passage sees 0.8 and more."""
NUM_DIRECTIONS = 256
MIN_CLOSED_SHARE = 0.99
"""A scan that was closed all around needs hardly any new face."""
MIN_TUNNEL_HITS = 0.8
"""From a tunnel's wall this share of the rays before it meets rock; the outside of a cave sees little of itself ..."""
MAX_TUNNEL_SHARE = 0.03
"""... on at most this share of its area. Measured: nine closed caves 0.0 %, blocks around a passage 10 to 20 %."""
NUM_TUNNEL_SAMPLES = 4_000
TUNNEL_OFFSET = 1e-3
"""Rays that look for a tunnel start this far from the wall, m."""
MAX_CONVEXITY = 0.85
"""A boulder fills more of its convex hull than this; a passage winds and fills a half or less."""


def enclosure(surface: Mesh, viewpoints: Array) -> Array:
    """Return the (N,) shares of all directions in which the scanned surface is in view from (N, 3) points."""
    distances = _cast(surface, viewpoints, sphere_directions(NUM_DIRECTIONS))
    shares: Array = np.isfinite(distances).mean(axis=1)
    return shares


def free_height(surface: Mesh, viewpoints: Array) -> float:
    """Return the median distance between floor and ceiling at (N, 3) points inside, in the surface's units.

    Raises:
        MeshError: floor and ceiling are both seen from none of them.
    """
    heights = _cast(surface, viewpoints, np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])).sum(axis=1)
    if not np.isfinite(heights).any():
        raise MeshError(
            f"None of the {len(viewpoints)} viewpoints has both floor and ceiling in the model, so the passage's "
            "height is unknown. Take photos of both, or give camera positions with --positions."
        )
    return float(np.median(heights[np.isfinite(heights)]))


def _cast(surface: Mesh, origins: Array, directions: Array) -> Array:
    """Return the (N, D) distances to the surface from each point in each unit direction, inf where nothing is hit."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    TriangleMesh(scene, surface.triangles.astype(np.float32))
    starts = np.repeat(origins, len(directions), axis=0).astype(np.float32)
    ways = np.tile(directions, (len(origins), 1)).astype(np.float32)
    distances = np.asarray(scene.run(starts, ways, query="DISTANCE"), dtype=np.float64)
    return np.where(distances < 1e30, distances, np.inf).reshape(len(origins), -1)


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
            f"passage needs {MIN_ENCLOSURE:.0%}. It is a facade, a floor or an object seen from outside. "
            "Scan the walls on all sides, or the passage whose inside is to be dived."
        )
    return share


def check_is_hollow(cavity: Cavity, scanned_share: float) -> None:
    """Check that a closed surface is a cave seen from inside, not a rock seen from outside.

    Args:
        cavity: the closed surface.
        scanned_share: share of its faces that the scan had already.

    Raises:
        MeshError: it has no open end, and a passage leads through it from outside, or it is nearly convex: nothing
            tells that there is a passage in it.
    """
    if cavity.portals or scanned_share < MIN_CLOSED_SHARE:
        return
    _check_has_no_tunnel(cavity.mesh)
    share = cavity.volume / float(cavity.mesh.to_trimesh().convex_hull.volume)
    if share > MAX_CONVEXITY:
        raise MeshError(
            f"This is a solid without an inside: the scan is closed all around and fills {share:.0%} of its convex "
            "hull, as a boulder does. No open end leads in. If it is a chamber scanned from within, name a point in "
            "its water with --inside X Y Z; cut an entrance with --cut."
        )


def _check_has_no_tunnel(mesh: Mesh) -> None:
    """Refuse a closed mesh whose outside forms a passage: a block of rock, its water taken for the outside.

    Raises:
        MeshError: with a place in the middle of the passage.
    """
    areas, normals = face_areas(mesh)
    every = np.cumsum(areas)
    chosen = np.searchsorted(every, every[-1] * (np.arange(NUM_TUNNEL_SAMPLES) + 0.5) / NUM_TUNNEL_SAMPLES)
    starts, axes = mesh.triangles[chosen].mean(axis=1) + TUNNEL_OFFSET * normals[chosen], normals[chosen]
    caster = Caster(mesh)
    distances, _ = caster.cast(starts, axes)
    share_hit = np.isfinite(distances).mean(axis=1)
    is_tunnel = (share_hit >= MIN_TUNNEL_HITS) & np.isfinite(distances[:, 0])
    share = float(is_tunnel.mean())
    if share <= MAX_TUNNEL_SHARE:
        return
    across = 0.5 * distances[is_tunnel, :1] * caster.directions(axes[is_tunnel])[:, 0]
    middles = starts[is_tunnel] + across
    place = middles[np.argmax(enclosure(mesh, middles))]
    raise MeshError(
        f"This is a block of rock with a passage in it, or a cave closed all around: {share:.0%} of the closed wall "
        "lines a hollow on its outer side, and nothing tells on which side the water is. Name a point in it: "
        f"--inside {place[0]:.2f} {place[1]:.2f} {place[2]:.2f} for that hollow, whose mouths become the open ends.",
        [(tuple(place.tolist()), "hollow on the outer side")],
    )


def sphere_directions(count: int) -> Array:
    """Return (count, 3) unit vectors spread evenly over the sphere (Fibonacci lattice)."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * index
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
