"""Is it a cave? Ambient occlusion: how much of the view from inside is wall that was really scanned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.scan.orientation import Caster, face_areas
from aquanav_tools.errors import MeshError, UnseenWallsError
from aquanav_tools.geometry.mesh.rays import RayScene
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

MIN_OCCLUSION = 0.6
"""A facade fills at most half of the view of any point before it; the middle of a passage sees 0.8 and more."""
MIN_FACING = 0.2
"""Photos were taken between walls when this share of the lines through the water before their cameras meets walls that
face each other. Measured on real photos: a workshop 0.58, an office corridor 0.34. Computed: before facades, in corners
of two walls and ground, over floors and around boulders 0, three sides of a court 0.09, a rock shelter from outside
0.15."""
MAX_FACING_COSINE = -0.5
"""Walls face each other when their normals are this near to opposite: floor and facade, boulder and ground are not."""
NUM_DIRECTIONS = 256
CONE = float(np.cos(np.deg2rad(45.0)))
"""Sides of the view: the directions within 45 degrees of an axis."""
SIDES = {
    "up": (0.0, 0.0, 1.0),
    "down": (0.0, 0.0, -1.0),
    "+x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "+y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
}
MIN_CLOSED_SHARE = 0.99
"""A scan that was closed all around needs hardly any new face."""
MIN_TUNNEL_HITS = 0.8
"""From a tunnel's wall this share of the rays before it meets rock; the outside of a cave sees little of itself ..."""
MAX_TUNNEL_SHARE = 0.03
"""... on at most this share of its area. Measured: nine closed caves 0.0 %, blocks around a passage 10 to 20 %."""
NUM_HEIGHT_SAMPLES = 20_000
"""Points of a cloud between whose lowest and highest around a viewpoint its height is taken."""
MIN_ABOVE_FLOOR = 0.5
"""Floor counts as seen when it was straight below this share of the viewpoints."""
NUM_TUNNEL_SAMPLES = 4_000
TUNNEL_OFFSET = 1e-3
"""Rays that look for a tunnel start this far from the wall, m."""
MAX_CONVEXITY = 0.85
"""A boulder fills more of its convex hull than this; a passage winds and fills a half or less."""


def ambient_occlusion(surface: Mesh, viewpoints: Array) -> Array:
    """Return the (N,) shares of all directions in which the scanned surface is in view from (N, 3) points."""
    shares: Array = np.isfinite(_cast(surface, viewpoints, _lines())).mean(axis=1)
    return shares


def facing(surface: Mesh, places: Array) -> Array:
    """Return the (N,) shares of lines through (N, 3) places that meet surface on both sides which faces itself there.

    It is 0 outside of the surface's convex hull, and where only floor and one wall are in view.
    """
    hits = _first_hits(surface, places, _lines())
    half = hits.shape[1] // 2
    normals = np.where((hits >= 0)[..., None], surface.normals[hits], 0.0)
    cosines = np.einsum("nld,nld->nl", normals[:, :half], normals[:, half:])
    shares: Array = (cosines < MAX_FACING_COSINE).mean(axis=1)
    return shares


def _lines() -> Array:
    """Return NUM_DIRECTIONS unit vectors, the opposite of each in the first half in the second."""
    upper = sphere_directions(NUM_DIRECTIONS)[: NUM_DIRECTIONS // 2]
    return np.concatenate([upper, -upper])


def free_height(surface: Mesh, viewpoints: Array) -> float:
    """Return the median distance between floor and ceiling at (N, 3) points inside, in the surface's units.

    Raises:
        UnseenWallsError: floor and ceiling are both seen from none of them.
    """
    heights = _cast(surface, viewpoints, np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]))
    if not np.isfinite(heights).all(axis=1).any():
        up, down = np.isfinite(heights).sum(axis=0)
        raise UnseenWallsError(
            "height-unknown",
            f"None of the {len(viewpoints)} viewpoints has both floor and ceiling in the model, so the passage's "
            f"height is unknown: straight above {up} of them there is surface, straight below {down}.",
            "Take photos of both, or give another source of scale, such as camera positions with --positions.",
            [(tuple(viewpoints[0].tolist()), "no floor and ceiling above and below")],
        )
    heights = heights.sum(axis=1)
    return float(np.median(heights[np.isfinite(heights)]))


def seen_height(surface: Mesh, points: Array, viewpoints: Array, reach: float) -> tuple[float, str]:
    """Return the height of a passage of which floor or ceiling were not seen, in the model's unit, and what it is.

    What was seen of it may be much less: photos that look down along a corridor show its lower half. Then it is twice
    as high as the viewpoints are above the floor, for who walks or dives keeps about half-way up.

    Args:
        surface: what was seen.
        points: (K, 3) on it.
        viewpoints: (N, 3) inside.
        reach: how far was seen from there, horizontally.
    """
    sample = points[:: max(1, len(points) // NUM_HEIGHT_SAMPLES)]
    spans = []
    for place in viewpoints:
        near = np.hypot(*(sample - place)[:, :2].T) <= reach
        if near.any():
            spans.append(float(np.ptp(np.percentile(sample[near, 2], [2.0, 98.0]))))
    seen = float(np.median(spans)) if spans else float(np.ptp(sample[:, 2]))
    found = [(seen, "the height of what was seen")]
    distances = _cast(surface, viewpoints, np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]))
    for side, what in zip(distances.T, ("above the floor", "below the ceiling"), strict=True):
        is_met = np.isfinite(side)
        if is_met.mean() >= MIN_ABOVE_FLOOR:
            found.append((2.0 * float(np.median(side[is_met])), f"twice the height of the cameras {what}"))
    return max(found)


def _first_hits(surface: Mesh, origins: Array, directions: Array) -> IntArray:
    """Return the (N, D) faces that are met first from each point in each unit direction, -1 where nothing is."""
    return RayScene(surface).faces(*_fan(origins, directions)).reshape(len(origins), -1)


def _cast(surface: Mesh, origins: Array, directions: Array) -> Array:
    """Return the (N, D) distances to the surface from each point in each unit direction, inf where nothing is hit."""
    return RayScene(surface).lengths(*_fan(origins, directions)).reshape(len(origins), -1)


def _fan(origins: Array, directions: Array) -> tuple[Array, Array]:
    """Return (N * D, 3) origins and directions of rays from each of (N, 3) points in each of (D, 3) directions."""
    return np.repeat(origins, len(directions), axis=0), np.tile(directions, (len(origins), 1))


def check_occlusion(
    surface: Mesh, viewpoints: Array, what: str, names: Sequence[str] = (), *, before: Array | None = None
) -> float:
    """Return the median ambient occlusion at some viewpoints inside.

    Args:
        surface: the scan, without anything invented.
        viewpoints: (N, 3) places in the water, m.
        what: how the message calls them, for example "the cameras".
        names: N names of the places, if they have some.
        before: (M, 3) places that were looked through from there, m: it is enough that walls face each other there.

    Raises:
        UnseenWallsError: it is below MIN_OCCLUSION, and walls that face each other below MIN_FACING where that is
            enough: the scene is no cave, or much of its wall was not seen. Its places are a typical viewpoint, and
            beside it the sides where wall is missing.
    """
    directions = _lines()
    distances = _cast(surface, viewpoints, directions)
    shares = np.isfinite(distances).mean(axis=1)
    share, between = float(np.median(shares)), 0.0 if before is None else float(np.median(facing(surface, before)))
    if share >= MIN_OCCLUSION or between >= MIN_FACING:
        return share
    typical = int(np.argmin(np.abs(shares - share)))
    place, name = viewpoints[typical], f" ({names[typical]})" if len(names) else ""
    sides = _sides(np.isfinite(distances), directions)
    raise UnseenWallsError(
        "open-walls",
        f"This is no cave, or much of its wall was not seen: from {what}, the scanned surface fills only {share:.0%} "
        f"of the view all around, and a passage needs {MIN_OCCLUSION:.0%}. Of {NUM_DIRECTIONS} rays in all directions, "
        f"{shares.min():.0%} to {shares.max():.0%} meet the surface from {len(viewpoints)} places; the median at "
        f"({', '.join(f'{value:.2f}' for value in place)}) m{name}. Before a facade half of them do at most, in the "
        f"middle of a passage 80% and more. By sides: {', '.join(f'{side} {seen:.0%}' for side, seen in sides.items())}"
        f".{'' if before is None else _lines_sentence(between)}",
        "If it is a cave, scan or photograph its walls on the sides that are missing.",
        [(tuple(place.tolist()), f"{share:.0%} of the view from here{name} is wall")]
        + _unseen(place, sides, distances),
    )


def _lines_sentence(share: float) -> str:
    return (
        f" Nor were these between walls: half-way to what they look at, {share:.0%} of all lines meet walls that face "
        f"each other, and between walls {MIN_FACING:.0%} and more do; before a facade or around an object hardly any."
    )


def _sides(is_wall: BoolArray, directions: Array) -> dict[str, float]:
    """Return the share of rays to each side that meet wall, from (N, D) flags and (D, 3) directions."""
    return {side: float(is_wall[:, directions @ axis > CONE].mean()) for side, axis in SIDES.items()}


def _unseen(place: Array, sides: dict[str, float], distances: Array) -> list[tuple[tuple[float, float, float], str]]:
    """Return where around a place wall is missing, as far away as wall is elsewhere, for a picture."""
    is_wall = np.isfinite(distances)
    reach = float(np.median(distances[is_wall])) if is_wall.any() else 1.0
    return [
        (tuple((place + reach * np.array(SIDES[side])).tolist()), f"towards {side}: {seen:.0%} of the view is wall")
        for side, seen in sides.items()
        if seen < MIN_OCCLUSION
    ]


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
    place = middles[np.argmax(ambient_occlusion(mesh, middles))]
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
