"""Where the lines of a grid pierce triangles, and from which side.

A line through a closed surface leaves it as often as it enters it.

Lines through an edge or a corner are decided as if they ran a little beside it, always on the same side, so that of the
faces around it exactly those are pierced that would be.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.types import Array

Counts = npt.NDArray[np.int8]


def signed_piercings(
    triangles: Array, origin: Array, spacing: float, shape: tuple[int, int, int]
) -> tuple[Counts, Counts, Counts]:
    """Return what the winding number gains from each sample of a grid to the next one along x, y and z.

    Only what the triangles between the two add: -1 where a normal points ahead, 1 where it points back.

    Args:
        triangles: (F, 3, 3) corners, world, m.
        origin: (3,) world position of sample [0, 0, 0], m.
        spacing: distance between samples, m.
        shape: number of samples per axis.

    Returns:
        For each axis an (X, Y, Z) array; the last along the axis is 0.
    """
    grid = np.ascontiguousarray((triangles - origin) / spacing)
    counts = tuple(np.zeros(shape, dtype=np.int8) for _ in range(3))
    for axis in range(3):
        _pierce(grid, axis, np.moveaxis(counts[axis], (axis, (axis + 1) % 3, (axis + 2) % 3), (0, 1, 2)))
    return counts  # type: ignore[return-value]


@numba.njit(cache=True)
def _pierce(triangles, axis, counts):  # type: ignore[no-untyped-def]
    """Add the piercings of lines along an axis; of `counts` that axis comes first, then the two after it in turn."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        j0 = max(int(np.ceil(min(a[u], b[u], c[u]))), 0)
        j1 = min(int(np.floor(max(a[u], b[u], c[u]))), counts.shape[1] - 1)
        k0 = max(int(np.ceil(min(a[v], b[v], c[v]))), 0)
        k1 = min(int(np.floor(max(a[v], b[v], c[v]))), counts.shape[2] - 1)
        if j0 > j1 or k0 > k1:
            continue
        for j in range(j0, j1 + 1):
            for k in range(k0, k1 + 1):
                first = _side(a[u], a[v], b[u], b[v], j, k)
                if _side(b[u], b[v], c[u], c[v], j, k) != first or _side(c[u], c[v], a[u], a[v], j, k) != first:
                    continue
                i = int(np.floor(_height(a, b, c, axis, u, v, j, k)))
                if 0 <= i < counts.shape[0] - 1:
                    counts[i, j, k] -= first  # counter-clockwise seen from ahead: the normal points ahead
    return


@numba.njit(cache=True)
def _side(px, py, qx, qy, x, y):  # type: ignore[no-untyped-def]
    """Return 1 where (x, y) lies left of the line from p to q, -1 where right of it, the same for both its faces."""
    turned = px > qx or (px == qx and py > qy)
    if turned:
        px, py, qx, qy = qx, qy, px, py
    area = (qx - px) * (y - py) - (qy - py) * (x - px)
    # On the line: as if the point lay a little further along x, and much less so along y. From p to q x grows, or y.
    side = 1 if area > 0.0 or (area == 0.0 and qy < py) else -1
    if area == 0.0 and qy == py:
        side = 1
    return -side if turned else side


@numba.njit(cache=True)
def _height(a, b, c, axis, u, v, x, y):  # type: ignore[no-untyped-def]
    """Return where a line along the axis meets the plane of a triangle."""
    bu, bv, bh = b[u] - a[u], b[v] - a[v], b[axis] - a[axis]
    cu, cv, ch = c[u] - a[u], c[v] - a[v], c[axis] - a[axis]
    area = bu * cv - bv * cu
    if area == 0.0:
        return a[axis]
    s, t = ((x - a[u]) * cv - (y - a[v]) * cu) / area, (bu * (y - a[v]) - bv * (x - a[u])) / area
    return a[axis] + s * bh + t * ch
