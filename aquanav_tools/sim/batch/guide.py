"""Progress along the guide of a cave.

The original adds the distance to the next panel's centre to the chain of centres behind it. That jumps when a panel
is crossed off its centre, and its nearest-panel rule jumps at loops. Here progress between two panels is interpolated
by the angle between their planes, so that it is continuous at every panel and even along a circle's arc, and a vehicle
only changes its gate (the stretch between two panels) by passing through a panel's outline, forwards or backwards: in a
dead end that runs beside the route it stays, and behind a loop it is found again where the route goes on.

Progress has no jumps, but it is steeper than the way is long where panels stand closer than on the centreline: on the
inside of a bend of radius R by R / (R - r) at r from its middle line, which is the price of being even along it. (The
way that no move changes by more than its length is the shortest one: `cave/route/shortest.py`.) A vehicle that rounds
a loop on its other side is credited all of it at once where it meets the route again.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.geometry.polyline import arc_lengths
from aquanav_tools.sim.batch.runtime import OPTIONS, launch_kernel
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
CATCH = wp.constant(wp.float64(0.25))
"""A vehicle within this distance of a panel is in it, m: half a step at 5 m/s and ten decisions per second, and less
than the rock between two passages."""
ARC_SAMPLES = 16
"""Within a gate progress is even along the centreline by so many pieces: its panels may lean away from it."""
PARALLEL = wp.constant(wp.float64(1.0 - 1e-9))
"""Cosine above which two planes do not meet within a hundred kilometres."""


@wp.struct
class Panels:
    """A guide's panels on the device."""

    centres: wp.array(dtype=wp.vec3d)
    normals: wp.array(dtype=wp.vec3d)
    axes: wp.array2d(dtype=wp.vec3d)
    """(P, 2) of the outlines' planes."""
    radii: wp.array(dtype=f64)
    arcs: wp.array2d(dtype=f64)
    """(P - 1, ARC_SAMPLES + 1) progress at even shares of the angle in each gate, m: even along the centreline."""
    corners: wp.array(dtype=wp.vec2d)
    ends: wp.array(dtype=wp.int32)


def make_panels(guide: Guide, device: Any) -> Panels:
    """Return a guide on a device."""
    panels = Panels()
    corners, ends = guide.outlines
    panels.centres = wp.array(guide.centres, dtype=wp.vec3d, device=device)
    panels.normals = wp.array(guide.normals, dtype=wp.vec3d, device=device)
    panels.axes = wp.array(guide.axes, dtype=wp.vec3d, device=device)
    panels.radii = wp.array(guide.radii, dtype=wp.float64, device=device)
    panels.corners = wp.array(corners, dtype=wp.vec2d, device=device)
    panels.ends = wp.array(ends, dtype=wp.int32, device=device)
    panels.arcs = wp.array(_arcs_of(guide, panels, device), dtype=wp.float64, device=device)
    return panels


def _arcs_of(guide: Guide, panels: Panels, device: Any) -> Array:
    """Return the table of `Panels.arcs`."""
    stations = np.maximum.accumulate(guide.stations)
    gates = np.arange(guide.num_gates).repeat(np.diff(stations) + 1)
    points = np.concatenate([guide.centreline[first : last + 1] for first, last in pairwise(stations)])
    found = wp.zeros(len(gates), dtype=f64, device=device)
    inputs = [wp.array(points, dtype=wp.vec3d, device=device), wp.array(gates, dtype=wp.int32, device=device), panels]
    launch_kernel(_write_shares, dim=len(gates), inputs=inputs, outputs=[found], device=device)
    shares, rows, even = found.numpy(), [], np.linspace(0.0, 1.0, ARC_SAMPLES + 1)
    for gate, (begin, end) in enumerate(pairwise(guide.arc_lengths)):
        line = points[gates == gate]
        walked = arc_lengths(line)
        part = np.maximum.accumulate([0.0, *shares[gates == gate][1:-1], 1.0])
        if walked[-1] == 0.0:  # both panels stand at one point of the centreline
            part = walked = np.array([0.0, 1.0])
        rows.append(begin + np.interp(even, part, walked / walked[-1]) * (end - begin))
    return np.array(rows)


@wp.func
def is_in_outline(offset: wp.vec3d, panels: Panels, panel: int):
    """Return whether an offset from a panel's centre, seen along its normal, lies in its outline (even-odd rule)."""
    u, v = wp.dot(offset, panels.axes[panel, 0]), wp.dot(offset, panels.axes[panel, 1])
    first = int(0)
    if panel > 0:
        first = panels.ends[panel - 1]
    last = panels.ends[panel]
    crossings = int(0)
    a = panels.corners[last - 1]
    for n in range(first, last):
        b = panels.corners[n]
        if (a[1] > v) != (b[1] > v):
            if u < a[0] + (v - a[1]) / (b[1] - a[1]) * (b[0] - a[0]):
                crossings += 1
        a = b
    return crossings % 2 == 1


@wp.func
def tracked(position: wp.vec3d, panels: Panels, gate: int):
    """Return the gate beside the nearest panel that the position is in; the old one where it is in none."""
    nearest = CATCH
    now = gate
    for panel in range(panels.centres.shape[0]):
        offset = position - panels.centres[panel]
        along = wp.dot(offset, panels.normals[panel])
        reach = panels.radii[panel] + CATCH
        if wp.abs(along) <= nearest and wp.dot(offset, offset) <= reach * reach:
            if is_in_outline(offset, panels, panel):
                nearest = wp.abs(along)
                now = panel - 1
                if along >= f64(0.0):
                    now = panel
    return wp.clamp(now, 0, panels.centres.shape[0] - 2)


@wp.func
def share_of(position: wp.vec3d, panels: Panels, gate: int):
    """Return how much of the angle between a gate's two planes lies behind a position; of the distance, if parallel."""
    zero, one = f64(0.0), f64(1.0)
    behind = wp.max(wp.dot(position - panels.centres[gate], panels.normals[gate]), zero)
    ahead = wp.max(wp.dot(panels.centres[gate + 1] - position, panels.normals[gate + 1]), zero)
    if behind + ahead == zero:
        return one
    cosine = wp.dot(panels.normals[gate], panels.normals[gate + 1])
    if cosine > PARALLEL:
        return behind / (behind + ahead)
    sine = wp.sqrt(wp.max(one - cosine * cosine, zero))
    return wp.min(wp.atan2(behind * sine, ahead + behind * cosine) / wp.acos(wp.max(cosine, -one)), one)


@wp.func
def remaining_at(position: wp.vec3d, panels: Panels, gate: int):
    """Return the metres still to go along the guide."""
    num = panels.arcs.shape[1] - 1
    place = share_of(position, panels, gate) * f64(num)
    n = wp.min(int(place), num - 1)
    before, after = panels.arcs[gate, n], panels.arcs[gate, n + 1]
    return panels.arcs[panels.arcs.shape[0] - 1, num] - (before + (place - f64(n)) * (after - before))


@wp.func
def is_at_goal(position: wp.vec3d, remaining: f64, tolerance: f64, panels: Panels):
    """Return whether a vehicle with so many metres to go has reached the last panel, and no water beside or behind it.

    Planes go on behind walls: a passage that begins beside the goal, or leads on behind it, has nothing to go either.
    """
    goal = panels.centres.shape[0] - 1
    offset = position - panels.centres[goal]
    reach = panels.radii[goal] + tolerance
    is_beside = wp.dot(offset, offset) > reach * reach
    is_behind = wp.dot(offset, panels.normals[goal]) > wp.max(tolerance, CATCH)
    return remaining <= tolerance and not is_beside and not is_behind


@wp.kernel
def _write_shares(
    positions: wp.array(dtype=wp.vec3d), gates: wp.array(dtype=wp.int32), panels: Panels, shares: wp.array(dtype=f64)
):
    i = wp.tid()
    shares[i] = share_of(positions[i], panels, gates[i])
