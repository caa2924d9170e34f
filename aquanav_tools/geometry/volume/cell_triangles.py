"""Which triangles of a cave's wall reach into which cells of its distance field."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.volume.field import BRICK, ROCK, DistanceField
from aquanav_tools.types import BoolArray, IntArray, Mesh


def triangles_in_cells(
    mesh: Mesh, field: DistanceField, cell: int, margin: float
) -> tuple[IntArray, npt.NDArray[np.int32]]:
    """Return the triangles that reach into each cell, or come near to it; some that only come near may be missing.

    Cells are numbered brick by brick, in C order within: those of brick b begin at b * (BRICK / cell)^3.

    Args:
        mesh: The wall.
        field: Its distance field.
        cell: Samples along a cell's edge, a divisor of BRICK.
        margin: Spacings by which cells are taken larger on each side.

    Returns:
        starts: (C + 1,); the triangles of cell c are members[starts[c]:starts[c + 1]].
        members: Triangles' numbers.

    Raises:
        MeshError: the wall reaches out of the field's bricks: the two are not of the same cave.
    """
    triangles = (mesh.triangles - field.origin) / field.spacing
    corners = np.floor(triangles.reshape(-1, 3) / BRICK).astype(np.int64)
    is_inside: BoolArray = np.asarray(((corners >= 0) & (corners < field.bricks.shape)).all(axis=1))
    is_inside[is_inside] = field.bricks[tuple(corners[is_inside].T)] != ROCK
    if not is_inside.all():
        raise MeshError(
            f"{(~is_inside).sum()} of {len(corners)} corners of the wall's triangles lie where the distance field has "
            "only rock: the two are not of the same cave. Build the scenario again."
        )
    counts = np.zeros(len(field.samples) * (BRICK // cell) ** 3 + 1, dtype=np.int64)
    _visit(triangles, field.bricks, cell, margin, counts, np.empty(0, dtype=np.int32))
    starts = np.concatenate([[0], np.cumsum(counts[:-1])])
    members = np.empty(starts[-1], dtype=np.int32)
    _visit(triangles, field.bricks, cell, margin, starts[:-1].copy(), members)
    return starts, members


@numba.njit(cache=True)
def _visit(triangles, bricks, cell, margin, ends, members):  # type: ignore[no-untyped-def]
    """Count the triangles of each cell in `ends`; with room in `members`, note them there, and move the ends on."""
    per_brick = BRICK // cell
    half = 0.5 * cell + margin
    for t in range(len(triangles)):
        a = triangles[t, 0]
        normal = np.cross(triangles[t, 1] - a, triangles[t, 2] - a)
        reach = half * np.abs(normal).sum()
        low, high = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
        for axis in range(3):
            low[axis] = max(int(np.floor((triangles[t, :, axis].min() - margin) / cell)), 0)
            last = int(np.floor((triangles[t, :, axis].max() + margin) / cell))
            high[axis] = min(last + 1, per_brick * bricks.shape[axis])
        for x in range(low[0], high[0]):
            for y in range(low[1], high[1]):
                for z in range(low[2], high[2]):
                    brick = bricks[x // per_brick, y // per_brick, z // per_brick]
                    if brick == ROCK:
                        continue  # no wall comes here, as none of its corners does: only the margin
                    middle = (np.array((x, y, z)) + 0.5) * cell
                    if abs((normal * (middle - a)).sum()) > reach:
                        continue  # the triangle's plane passes by
                    place = (x % per_brick * per_brick + y % per_brick) * per_brick + z % per_brick
                    c = brick * per_brick**3 + place
                    if len(members):
                        members[ends[c]] = t
                    ends[c] += 1
