"""Marching cubes: the surface on which a sampled field is zero, closed and without a crack whatever the samples are.

In each cell the corners of the surface are joined face by face, so that two cells that share a face agree. Where that
leaves a choice (two opposite corners of a face on one side), the value in the middle of the face's hyperbola decides
(Nielson and Hamann 1991, "The asymptotic decider"), which draws the topology of the interpolated field.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.types import Array, IntArray

CELL_FACES = np.array([[1, 3, 7, 5], [0, 4, 6, 2], [2, 6, 7, 3], [0, 1, 5, 4], [4, 5, 7, 6], [0, 2, 3, 1]])
"""Corners of a cell's faces, counter-clockwise seen from outside; corner x + 2 y + 4 z lies at (x, y, z)."""
WITHIN_CELL = 3
"""Of a vertex's place: it is the middle of a polygon, not on an edge along axis 0, 1 or 2. More polygons of one cell
have the numbers after it."""


def marching_cubes(field: npt.NDArray[np.float32]) -> tuple[Array, IntArray, IntArray]:
    """Return the surface in a grid of samples, none of which is 0, its normals towards positive samples.

    Args:
        field: (X, Y, Z).

    Returns:
        (V, 3) vertices, in samples; (F, 3) faces; (V, 4) where each vertex is: a sample and the axis along which the
        vertex lies beyond it, or a cell and WITHIN_CELL or more. No two have the same.
    """
    count = _count_crossed_edges(field)
    places = np.empty((2 * count + 8, 4), np.int64)
    vertices, faces = np.empty((len(places), 3)), np.empty((4 * count, 3), np.int64)
    num_vertices, num_faces = _march(field, vertices, places, faces)
    return vertices[:num_vertices].copy(), faces[:num_faces].copy(), places[:num_vertices].copy()


@numba.njit(cache=True)
def _count_crossed_edges(field):  # type: ignore[no-untyped-def]
    count = 0
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            for k in range(field.shape[2]):
                is_rock = field[i, j, k] > 0.0
                count += i + 1 < field.shape[0] and (field[i + 1, j, k] > 0.0) != is_rock
                count += j + 1 < field.shape[1] and (field[i, j + 1, k] > 0.0) != is_rock
                count += k + 1 < field.shape[2] and (field[i, j, k + 1] > 0.0) != is_rock
    return count


@numba.njit(cache=True)
def _march(field, vertices, places, faces):  # type: ignore[no-untyped-def]
    """Fill vertices, their places and faces; return how many of the first and the last there are."""
    _, num_y, num_z = field.shape
    ids = np.empty((2, num_y, num_z, 3), np.int64)  # of the vertices on edges from the samples of two layers
    values, following, loop = np.empty(8, np.float32), np.empty(24, np.int64), np.empty(12, np.int64)
    num_vertices = _add_vertices(field, 0, ids[0], vertices, places, 0)
    num_faces = 0
    for i in range(field.shape[0] - 1):
        num_vertices = _add_vertices(field, i + 1, ids[(i + 1) % 2], vertices, places, num_vertices)
        for j in range(num_y - 1):
            for k in range(num_z - 1):
                num_rock = 0
                for corner in range(8):
                    value = field[i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2)]
                    values[corner] = value
                    num_rock += value > 0.0
                if num_rock == 0 or num_rock == 8:
                    continue
                # In a face with four crossings a diagonal may lie, which both its cells would draw.
                has_choice = _join_edges(values, following)
                num_middles = 0
                for start in range(24):
                    size = 0
                    edge = start
                    while following[edge] >= 0:
                        corner = edge // 3
                        layer = ids[(i + (corner & 1)) % 2]
                        loop[size] = layer[j + (corner >> 1 & 1), k + (corner >> 2), edge % 3]
                        size += 1
                        after = following[edge]
                        following[edge] = -1
                        edge = after
                    if has_choice and size > 3:
                        vertices[num_vertices] = 0.0
                        for n in range(size):
                            vertices[num_vertices] += vertices[loop[n]] / size
                            faces[num_faces] = (loop[n], loop[(n + 1) % size], num_vertices)
                            num_faces += 1
                        places[num_vertices] = (i, j, k, WITHIN_CELL + num_middles)
                        num_vertices += 1
                        num_middles += 1
                    elif size:
                        num_faces = _add_fan(vertices, loop, size, faces, num_faces)
    return num_vertices, num_faces


@numba.njit(cache=True)
def _add_vertices(field, i, ids, vertices, places, count):  # type: ignore[no-untyped-def]
    """Add the vertices on the edges that leave the samples of one layer; return how many there are now."""
    for j in range(field.shape[1]):
        for k in range(field.shape[2]):
            here = field[i, j, k]
            for axis in range(3):
                x, y, z = i + (axis == 0), j + (axis == 1), k + (axis == 2)
                if x == field.shape[0] or y == field.shape[1] or z == field.shape[2]:
                    continue
                there = field[x, y, z]
                if (here > 0.0) != (there > 0.0):
                    ids[j, k, axis] = count
                    places[count] = (i, j, k, axis)
                    vertices[count] = (i, j, k)
                    vertices[count, axis] += here / (here - there)
                    count += 1
    return count


@numba.njit(cache=True)
def _join_edges(values, following):  # type: ignore[no-untyped-def]
    """Set for each edge of a cell that the surface crosses the one where its polygon goes on, -1 for all others.

    An edge's number is three times its lower corner and its axis. Seen from rock, polygons run counter-clockwise: on
    every face of the cell from where its rim enters water to where the rim leaves it.

    Returns:
        Whether some face of the cell has four crossings, and so left a choice.
    """
    following[:] = -1
    has_choice = False
    for face in range(6):
        corners = CELL_FACES[face]
        num_crossed = 0
        for n in range(4):
            num_crossed += (values[corners[n]] > 0.0) != (values[corners[(n + 1) % 4]] > 0.0)
        if num_crossed == 0:
            continue
        step = 1  # around water: it leaves where the water's corners end
        if num_crossed == 4:
            has_choice = True
            a, b, c, d = values[corners[0]], values[corners[1]], values[corners[2]], values[corners[3]]
            middle = a * c - b * d if a > 0.0 else b * d - a * c  # of the sign of the hyperbola's middle
            if middle < 0.0:
                step = 3  # water is joined through the middle: around the rock
        for n in range(4):
            if values[corners[n]] > 0.0 and values[corners[(n + 1) % 4]] < 0.0:
                m = (n + step) % 4
                while not (values[corners[m]] < 0.0 and values[corners[(m + 1) % 4]] > 0.0):
                    m = (m + step) % 4
                following[_edge(corners[n], corners[(n + 1) % 4])] = _edge(corners[m], corners[(m + 1) % 4])
    return has_choice


@numba.njit(cache=True)
def _edge(one, other):  # type: ignore[no-untyped-def]
    """Return the number of the edge between two corners of a cell."""
    return 3 * min(one, other) + ((one ^ other) >> 1)


@numba.njit(cache=True)
def _add_fan(vertices, loop, size, faces, count):  # type: ignore[no-untyped-def]
    """Add the faces over a polygon, a quadrangle's along its shorter diagonal; return how many there are now."""
    first = 0
    if size == 4:
        one = ((vertices[loop[0]] - vertices[loop[2]]) ** 2).sum()
        other = ((vertices[loop[1]] - vertices[loop[3]]) ** 2).sum()
        first = 1 if other < one else 0
    for n in range(1, size - 1):
        faces[count] = (loop[first], loop[(first + n) % size], loop[(first + n + 1) % size])
        count += 1
    return count
