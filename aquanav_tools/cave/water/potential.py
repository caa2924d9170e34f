"""The potential flow through the cells: its equations, their solution, and the section where it is fastest.

Water without friction and spin flows along the gradient of a potential, which is 1 behind the inlets' lids, 0 behind
the outlets', and has no flux through walls. A spring, where a cave has no lid, is a plug of cells with one potential.
Finite volumes: what enters a cell leaves it, and a face's flux is its open area times the difference of the potentials
over the cells' distance. The equations have as many unknowns as there are cells; conjugate gradients with algebraic
multigrid solve them in a number of rounds that hardly grows with them.

Source: Patankar, Numerical Heat Transfer and Fluid Flow (1980), chapter 4; for faces that a wall cuts: Purvis and
Burkhalter, Prediction of Critical Mach Number for Store Configurations, AIAA Journal 17 (1979).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.water.flow_cells import DUCT_CELLS, FlowCells, Lids, in_frame, inside_outline
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.volume.field import BRICK, BRICK_BITS, ROCK
from aquanav_tools.types import Array, BoolArray, IntArray

TOLERANCE = 1e-11
"""Of the solution's residual over that of no flow."""
MAX_ROUNDS = 500
MULTIGRID: dict[str, Any] = {
    "smooth": ("jacobi", {"omega": 1.6, "weighting": "local"}),
    "presmoother": ("gauss_seidel", {"sweep": "forward"}),
    "postsmoother": ("gauss_seidel", {"sweep": "backward"}),
    "improve_candidates": None,
}
"""How pyamg coarsens and smooths: bounds row by row instead of spectral radii, which it would estimate from random
vectors in two thirds of the time; forward and back again is symmetric, as conjugate gradients need it. Of 229,000 cells
24 rounds instead of 17, in 60 % of the time; 4/3 and 2 in place of 1.6 take 27 and 30 rounds."""
FREE = -1
NUM_LEVELS = 2000
"""Surfaces of equal potential among which the narrowest is sought."""
CELLS_AVERAGED = 2.0
"""The area of such a surface is a mean over so many cells along the flow, since it is counted in cells."""
CLEAR_OF_LIDS, CLEAR_OF_SPRINGS = 2, 6
"""Cells off which the narrowest section is sought. Two off a spring a tube's came out 5 % too small, six off 1 %."""

Ints = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Faces:
    """Open faces between two cells; flux is positive from `lower` to `upper`."""

    lower: Ints
    """(F,) number of the cell on the lower side, through all bricks in C order."""
    upper: Ints
    """(F,) of the cell on the upper side."""
    axis: npt.NDArray[np.int8]
    """(F,) axis that the face is square to."""
    openness: Array
    """(F,) open share."""


@dataclass(frozen=True, eq=False)
class PotentialFlow:
    """A discrete flow that loses no water."""

    faces: Faces
    """Those that the flow reaches."""
    flux: Array
    """(F,) m^3/s for a difference of 1 m^2/s between inlets and outlets."""
    cells: IntArray
    """(N,) the cells that the flow reaches, rising."""
    lid: npt.NDArray[np.int8]
    """(N,) number of the lid behind which a cell lies, or of its spring, counted on from the lids; else FREE."""
    potential: Array
    """(N,) m^2/s."""
    num_lids: int
    """Numbers from here on are springs."""

    @property
    def divergence(self) -> Array:
        """(N,) what leaves each cell and did not enter it, m^3/s."""
        ends = np.searchsorted(self.cells, np.stack([self.faces.lower, self.faces.upper]))
        count = len(self.cells)
        leaving, entering = (np.bincount(end, self.flux, count).astype(np.float64) for end in ends)
        return np.asarray(leaving - entering)

    def through(self, lid: int) -> float:
        """Return what enters through a lid or at a spring, m^3/s; negative where water leaves."""
        return float(self.divergence[self.lid == lid].sum())


def open_faces(cells: FlowCells) -> Faces:
    """Return all open faces with a cell on both sides."""
    count = int(np.count_nonzero(cells.openness))
    lower, upper = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    axis = np.empty(count, dtype=np.int8)
    used = _list_faces(cells.openness, cells.bricks, cells.places, lower, upper, axis)
    lower, upper, axis = lower[:used].copy(), upper[:used].copy(), axis[:used].copy()
    return Faces(lower, upper, axis, cells.openness.reshape(-1, 3)[upper, axis].astype(np.float64))


def solve_potential(cells: FlowCells, lids: Lids, springs: Array, is_inlet: BoolArray) -> PotentialFlow | None:
    """Return the flow from the inlets to the others; None when no way through the cells joins the two.

    Args:
        cells: the water.
        lids: where it enters and leaves.
        springs: (S, 4) middles and radii of further such places, in the water, m.
        is_inlet: (L + S,) at which of them it enters, lids first.

    Raises:
        MeshError: the equations do not converge.
    """
    faces = open_faces(cells)
    numbers = np.unique(np.concatenate([faces.lower, faces.upper]))
    lid = np.full(len(numbers), FREE, dtype=np.int8)
    _find_lid_cells(cells.centres(numbers), cells.spacing, lids.arrays, lid)
    ends = np.searchsorted(numbers, np.stack([faces.lower, faces.upper]))
    for number, (*middle, radius) in enumerate(springs, start=len(lids.labels)):
        lid[_plug(cells.centres(numbers), ends, np.array(middle), radius)] = number
    is_reached = _between(ends, lid, is_inlet)
    if not is_reached.any():
        return None
    kept = is_reached[ends[0]]
    faces = Faces(faces.lower[kept], faces.upper[kept], faces.axis[kept], faces.openness[kept])
    numbers, lid = numbers[is_reached], lid[is_reached]
    ends = np.searchsorted(numbers, np.stack([faces.lower, faces.upper]))
    potential = np.where((lid != FREE) & is_inlet[lid], 1.0, 0.0)
    potential[lid == FREE] = _solve(faces.openness, ends, lid == FREE, potential)
    flux = cells.spacing * faces.openness * (potential[ends[0]] - potential[ends[1]])
    return PotentialFlow(faces, flux, numbers.astype(np.int64), lid, potential, len(lids.labels))


def narrowest_section(flow: PotentialFlow, cells: FlowCells) -> tuple[float, Array]:
    """Return the area of the narrowest section of a flow, m^2, and the (3,) middle of it, m.

    The sections are the surfaces of equal potential: all of the water passes through each of them.
    """
    momentum, spread = _cell_flow(flow, cells.spacing)
    inside = (flow.lid == FREE) & (spread > 0.0)
    low, high = (flow.potential - 0.5 * spread)[inside], (flow.potential + 0.5 * spread)[inside]
    pieces = momentum[inside] / spread[inside]  # area of the surface inside each cell that it passes through
    lowest, highest = _clear_of_ends(flow)
    reach = flow.potential[(flow.potential >= lowest) & (flow.potential <= highest)]
    levels = np.quantile(reach, np.linspace(0.0, 1.0, NUM_LEVELS))
    areas = _started(low, pieces, levels) - _started(high, pieces, levels)
    # Levels stand at equal volumes; where it is narrow, so many lie within CELLS_AVERAGED of flow.
    slab = len(reach) * cells.spacing**3 / NUM_LEVELS
    narrow = CELLS_AVERAGED * cells.spacing * float(np.quantile(areas, 0.05))
    window = min(max(1, round(narrow / slab)), NUM_LEVELS)
    smooth = np.convolve(areas, np.full(window, 1.0 / window), mode="valid")
    best = int(smooth.argmin())
    level = levels[best + window // 2]
    passed = (low <= level) & (level <= high)
    middle = np.average(cells.centres(flow.cells[inside][passed]), axis=0, weights=pieces[passed])
    return float(smooth[best]), middle


def _clear_of_ends(flow: PotentialFlow) -> tuple[float, float]:
    """Return the potentials between which the surfaces keep off lids and springs, whose own surface is ragged."""
    ends = np.searchsorted(flow.cells, np.stack([flow.faces.lower, flow.faces.upper]))
    is_near = flow.lid >= flow.num_lids
    for cells_left in range(CLEAR_OF_SPRINGS, 0, -1):
        if cells_left == CLEAR_OF_LIDS:
            is_near |= flow.lid != FREE
        touched = is_near[ends[0]] | is_near[ends[1]]
        is_near[ends[:, touched].ravel()] = True
    near = flow.potential[is_near]
    lowest, highest = near[near < 0.5].max(initial=0.0), near[near >= 0.5].min(initial=1.0)
    return (float(lowest), float(highest)) if lowest < highest else (0.0, 1.0)


def _started(begins: Array, pieces: Array, levels: Array) -> Array:
    """Return the (L,) sum of the pieces that begin below each level."""
    order = np.argsort(begins)
    sums = np.concatenate([[0.0], np.cumsum(pieces[order])])
    total: Array = sums[np.searchsorted(begins[order], levels)]
    return total


def _cell_flow(flow: PotentialFlow, spacing: float) -> tuple[Array, Array]:
    """Return each cell's (N,) speed times volume, m^4/s, and how far its potential spreads across it, m^2/s."""
    count = len(flow.cells)
    ends = np.searchsorted(flow.cells, np.stack([flow.faces.lower, flow.faces.upper]))
    square, spread = np.zeros(count), np.zeros(count)
    for axis in range(3):
        chosen = flow.faces.axis == axis
        both = np.zeros(count)
        for end in ends:
            both += np.bincount(end[chosen], flow.flux[chosen], count)
        square += (0.5 * spacing * both) ** 2
        slope = np.abs(flow.potential[ends[1, chosen]] - flow.potential[ends[0, chosen]])
        touched = sum(np.bincount(end[chosen], minlength=count) for end in ends)
        total = sum(np.bincount(end[chosen], slope, count) for end in ends)
        spread += total / np.maximum(touched, 1)
    return np.sqrt(square), spread


def _plug(centres: Array, ends: IntArray, middle: Array, radius: float) -> IntArray:
    """Return the cells in a ball that faces in it join to the one at its middle; those behind rock stay out."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    away = np.linalg.norm(centres - middle, axis=1)
    lower, upper = ends[:, (away[ends] <= radius).all(axis=0)]
    links = coo_matrix((np.ones(len(lower), dtype=np.int8), (lower, upper)), shape=(len(away), len(away)))
    piece = connected_components(links, directed=False)[1]
    return np.flatnonzero(piece == piece[away.argmin()])


def _between(ends: IntArray, lid: npt.NDArray[np.int8], is_inlet: BoolArray) -> BoolArray:
    """Return the (N,) cells in pieces of water that reach both an inlet and an outlet."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count = len(lid)
    links = coo_matrix((np.ones(ends.shape[1], dtype=np.int8), (ends[0], ends[1])), shape=(count, count))
    pieces, piece = connected_components(links, directed=False)
    has_inlet, has_outlet = np.zeros(pieces, dtype=bool), np.zeros(pieces, dtype=bool)
    has_inlet[piece[(lid != FREE) & is_inlet[lid]]] = True
    has_outlet[piece[(lid != FREE) & ~is_inlet[lid]]] = True
    reached: BoolArray = (has_inlet & has_outlet)[piece]
    return reached


def _solve(openness: Array, ends: IntArray, is_free: BoolArray, potential: Array) -> Array:
    """Return the potential of the free cells, m^2/s."""
    import pyamg

    matrix, right = _equations(openness, ends, is_free, potential)
    solver = pyamg.smoothed_aggregation_solver(matrix, symmetry="symmetric", max_coarse=200, **MULTIGRID)
    residuals: list[float] = []
    found: Array = solver.solve(right, tol=TOLERANCE, maxiter=MAX_ROUNDS, accel="cg", residuals=residuals)
    if not residuals[-1] <= 10.0 * TOLERANCE * max(float(np.linalg.norm(right)), 1e-300):
        raise MeshError(
            f"The flow through {len(right)} cells did not converge: a residual of {residuals[-1]:.3g} is left. "
            "The cavity's surface is damaged near a portal; look at the report, or build without a current."
        )
    return found


def _equations(openness: Array, ends: IntArray, is_free: BoolArray, potential: Array) -> tuple[Any, Array]:
    """Return the (M, M) sparse matrix and the (M,) right side for the free cells."""
    from scipy.sparse import coo_matrix

    row_of = np.cumsum(is_free) - 1
    count = int(is_free.sum())
    diagonal = np.bincount(ends[0], openness, len(is_free)) + np.bincount(ends[1], openness, len(is_free))
    right = np.zeros(len(is_free))
    rows, columns, values = [row_of[is_free]], [row_of[is_free]], [diagonal[is_free]]
    for here, there in (ends, ends[::-1]):
        inner, border = is_free[here] & is_free[there], is_free[here] & ~is_free[there]
        rows.append(row_of[here[inner]])
        columns.append(row_of[there[inner]])
        values.append(-openness[inner])
        right += np.bincount(here[border], openness[border] * potential[there[border]], len(is_free))
    triplets = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return coo_matrix(triplets, shape=(count, count)).tocsr(), right[is_free]


@numba.njit(cache=True)
def _list_faces(openness, bricks, places, lower, upper, axes):  # type: ignore[no-untyped-def]
    """Write the open faces that have a cell on both sides; return how many."""
    used = 0
    for b in range(1, len(places)):
        for i in range(BRICK):
            for j in range(BRICK):
                for k in range(BRICK):
                    for axis in range(3):
                        if openness[b, i, j, k, axis] == 0.0:
                            continue
                        x = BRICK * places[b, 0] + i - (axis == 0)
                        y = BRICK * places[b, 1] + j - (axis == 1)
                        z = BRICK * places[b, 2] + k - (axis == 2)
                        number = cell_number(bricks, x, y, z)
                        if number >= 0:
                            lower[used], upper[used] = number, ((b * BRICK + i) * BRICK + j) * BRICK + k
                            axes[used] = axis
                            used += 1
    return used


@numba.njit(cache=True)
def cell_number(bricks, x, y, z):  # type: ignore[no-untyped-def]
    """Return the number of a cell by its indices, -1 where there is no brick."""
    if min(x, y, z) < 0:
        return -1
    bx, by, bz = x >> BRICK_BITS, y >> BRICK_BITS, z >> BRICK_BITS
    if bx >= bricks.shape[0] or by >= bricks.shape[1] or bz >= bricks.shape[2] or bricks[bx, by, bz] == ROCK:
        return -1
    local = ((x & (BRICK - 1)) * BRICK + (y & (BRICK - 1))) * BRICK + (z & (BRICK - 1))
    return bricks[bx, by, bz] * BRICK**3 + local


@numba.njit(cache=True)
def _find_lid_cells(centres, spacing, lids, lid):  # type: ignore[no-untyped-def]
    """Note for every cell whose centre is in the passage behind a lid which one it is."""
    for n in range(len(centres)):
        for m in range(len(lids[0])):
            a, b, height = in_frame(lids[0][m], centres[n, 0], centres[n, 1], centres[n, 2])
            if 0.0 < height < (DUCT_CELLS + 1.0) * spacing and max(abs(a), abs(b)) < lids[3][m] + spacing:
                if inside_outline(a, b, lids[1], lids[2][m], lids[2][m + 1]) > -spacing:
                    lid[n] = m
