"""The flow through a cave from portal to portal: one velocity per place, to be scaled by how strong the current is.

It is the potential flow of `potential`, on a grid of its own, sparse like the distance field and coarser, scaled to a
mean of 1 m/s through the narrowest section. So a current's strength is a speed that a vehicle can be held against,
whatever the size of the cave. Where a cave has fewer than two portals, as most that are built from surveys, the way's
ends stand for those that lack: passages that stay flooded drain, through ends that nobody surveyed.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.water.flow_cells import FlowCells, cut_cells, find_lids
from aquanav_tools.cave.water.potential import narrowest_section, solve_potential
from aquanav_tools.cave.water.velocity import cell_velocities
from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.geometry.polyline import length_of
from aquanav_tools.geometry.volume.field import APRON, BRICK, ROCK, DistanceField, fill_aprons, number_bricks
from aquanav_tools.types import Array, BoolArray

logger = logging.getLogger(__name__)

Shares = tuple[tuple[int, float], ...]

CELLS_ACROSS = 5.0
"""Cells that the narrowest place of the route shall have across."""
FEW_CELLS, MANY_CELLS = 200_000, 2_000_000
"""The flow has about the first number of cells where that is fine enough, and never more than the second."""
SPRING_CLEARANCES, MAX_SPRING = 2.0, 0.25
"""Radius of a spring over the clearance at its middle: it fills the passage; and at most this share of the way, so that
those at the ends of a short way stay apart."""


@dataclass(frozen=True, eq=False)
class Flow:
    """Velocity of the water where the mean through the narrowest section is 1 m/s, trilinear between samples.

    `sim/batch/water.py` has the law that reads it. Samples are kept in bricks as in a DistanceField; where there is no
    brick the water stands still. They go on into the rock by one cell, so that the flow follows the wall and does not
    stop before it.
    """

    origin: Array
    """(3,) world position of sample [0, 0, 0], m."""
    spacing: float
    """Distance between samples, m."""
    bricks: npt.NDArray[np.int32]
    """(X, Y, Z) number of the brick of BRICK^3 samples in each place."""
    samples: npt.NDArray[np.float32]
    """(B, APRON, APRON, APRON, 3) velocity, m/s; brick ROCK is still."""
    narrowest: Array
    """(4,) area of the narrowest section that all of the water passes, m^2, and its middle, m."""
    shares: Shares
    """Labels of the portals that water passes, and the share of it that enters there; negative where it leaves. What
    passes at springs is not among them."""

    def nodes(self) -> tuple[Array, Array]:
        """Return the (N, 3) places of all samples in bricks, m, and the (N, 3) velocities there, m/s."""
        bricks = np.argwhere(self.bricks != ROCK)
        inside = np.indices((BRICK, BRICK, BRICK)).reshape(3, -1).T
        indices = (BRICK * bricks[:, None] + inside).reshape(-1, 3)
        cores = self.samples[self.bricks[tuple(bricks.T)], :BRICK, :BRICK, :BRICK]
        return self.origin + self.spacing * indices, cores.reshape(-1, 3).astype(np.float64)


def find_flow(
    cavity: Cavity,
    field: DistanceField,
    way: Array,
    min_clearance: float,
    inlets: tuple[int, ...] = (),
    outlets: tuple[int, ...] = (),
    spacing: float | None = None,
) -> Flow | None:
    """Return the flow through a cave; None where cells resolve no way between its ends.

    Every inlet has one potential and every outlet another, so that with several of them the water parts by itself: more
    takes the shorter and the wider way. Portals that are neither are closed. With fewer than two portals the water
    enters or leaves, or both, at a spring at an end of the way; within SPRING_CLEARANCES of that it stands still.

    Args:
        cavity: the water and its portals.
        field: its clearance.
        way: (K, 3) from the start to the goal, m; by default the water enters through the portal nearest to the goal,
            or at the goal, so that the way there is upstream.
        min_clearance: of the route, m: its narrowest place shall have CELLS_ACROSS cells across.
        inlets: labels of the portals where water enters.
        outlets: labels of those where it leaves; by default all others.
        spacing: edge of the cells, m; `choose_spacing` when not given.

    Raises:
        InputError: there is no such portal, or one is named as both.
        MeshError: the equations do not converge.
    """
    labels, springs, is_inlet = _choose_ends(cavity, np.asarray(way)[[0, -1]], inlets, outlets)
    length = length_of(way)
    radii = np.minimum(SPRING_CLEARANCES * field.clearance(springs), MAX_SPRING * length)
    lids = find_lids(cavity, labels)
    cells = cut_cells(field, lids, spacing or choose_spacing(cavity.volume, field.spacing, min_clearance))
    flow = solve_potential(cells, lids, np.column_stack([springs, radii]), is_inlet)
    if flow is None:
        return None
    logger.info("Flow through %d cells of %.3g m", len(flow.cells), cells.spacing)
    area, middle = narrowest_section(flow, cells)
    total = float(np.sum([flow.through(int(lid)) for lid in np.flatnonzero(is_inlet)]))
    shares = tuple((label, flow.through(lid) / total) for lid, label in enumerate(labels))
    velocities = cell_velocities(flow, cells, cavity, frozenset(labels)) * (area / total)
    return _packed(cells, velocities, np.array([area, *middle]), shares)


def choose_spacing(volume: float, field_spacing: float, min_clearance: float) -> float:
    """Return the edge of a flow's cells, m."""
    wanted = min(float(np.cbrt(volume / FEW_CELLS)), 2.0 * min_clearance / CELLS_ACROSS)
    return max(wanted, field_spacing, float(np.cbrt(volume / MANY_CELLS)))


def _choose_ends(
    cavity: Cavity, ends: Array, inlets: tuple[int, ...], outlets: tuple[int, ...]
) -> tuple[tuple[int, ...], Array, BoolArray]:
    """Return the labels of all portals that water passes, the (S, 3) springs, and at which of them it enters, m.

    Args:
        cavity: the water and its portals.
        ends: (2, 3) where the way starts, and its goal, m.
        inlets: labels of portals where water shall enter.
        outlets: labels of those where it shall leave.
    """
    known = {portal.label: portal for portal in cavity.portals}
    for label in (*inlets, *outlets):
        if label not in known:
            hint = did_you_mean(str(label), [str(one) for one in known]) if known else " The cave has none."
            raise InputError(f"There is no portal {label} for water to pass.{hint}")
    both = set(inlets) & set(outlets)
    if both:
        raise InputError(f"Water cannot both enter and leave through portal {min(both)}. Name it once.")
    if not known:
        return (), ends[::-1], np.array([True, False])
    if len(known) == 1:
        (portal,) = cavity.portals
        nearest = int(np.linalg.norm(ends - portal.centre, axis=1).argmin())
        enters = portal.label in inlets or (not outlets and nearest == 1)
        return (portal.label,), ends[[1 - nearest]], np.array([enters, not enters])
    if not inlets:
        free = [portal for portal in cavity.portals if portal.label not in outlets]
        if not free:
            raise InputError("Every portal is an outlet, so no water enters. Leave out one of the outlets.")
        inlets = (min(free, key=lambda portal: float(np.linalg.norm(portal.centre - ends[1]))).label,)
    outlets = outlets or tuple(label for label in known if label not in inlets)
    if not outlets:
        raise InputError("Every portal is an inlet, so no water leaves. Leave out one of the inlets.")
    return (*inlets, *outlets), np.zeros((0, 3)), np.array([True] * len(inlets) + [False] * len(outlets))


def _packed(cells: FlowCells, velocities: Array, narrowest: Array, shares: Shares) -> Flow:
    """Return the flow of (B, BRICK, BRICK, BRICK, 3) velocities in cells, without the bricks that are still."""
    moves = np.asarray(velocities.any(axis=(1, 2, 3, 4)))
    is_kept = moves[cells.bricks] & (cells.bricks != ROCK)
    # The apron of a brick looks into the next ones, so those before a brick that moves stay.
    for axis in range(3):
        before = np.zeros_like(is_kept)
        ahead = [slice(None)] * 3
        ahead[axis], back = slice(1, None), [slice(None)] * 3
        back[axis] = slice(None, -1)
        before[tuple(back)] = is_kept[tuple(ahead)]
        is_kept |= before
    bricks = number_bricks(is_kept)
    cores = np.concatenate([velocities[:1] * 0.0, velocities[cells.bricks[is_kept]]]).astype(np.float32)
    return flow_from_bricks(cells.origin + 0.5 * cells.spacing, cells.spacing, bricks, cores, narrowest, shares)


def flow_from_bricks(
    origin: Array,
    spacing: float,
    bricks: npt.NDArray[np.int32],
    cores: npt.NDArray[np.float32],
    narrowest: Array,
    shares: Shares,
) -> Flow:
    """Return the flow of (B, BRICK, BRICK, BRICK, 3) velocities per brick, the apron taken from the next bricks."""
    samples = np.zeros((len(cores), APRON, APRON, APRON, 3), dtype=np.float32)
    samples[1:, :BRICK, :BRICK, :BRICK] = cores[1:]
    fill_aprons(bricks, samples)
    return Flow(np.asarray(origin, dtype=np.float64), float(spacing), bricks, samples, narrowest, shares)
