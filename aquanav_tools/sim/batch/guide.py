"""Progress along the guide in Warp: the rules of `cave/route/guide.py`, in float64 as there."""

from __future__ import annotations

from typing import Any

import warp as wp

from aquanav_tools.cave.route import guide as route
from aquanav_tools.sim.batch.runtime import OPTIONS

wp.set_module_options(OPTIONS)

f64 = wp.float64
CATCH = wp.constant(wp.float64(route.CATCH))
PARALLEL = wp.constant(wp.float64(route.PARALLEL))


@wp.struct
class Panels:
    """A guide's panels on the device."""

    centres: wp.array(dtype=wp.vec3d)
    normals: wp.array(dtype=wp.vec3d)
    axes: wp.array2d(dtype=wp.vec3d)
    """(P, 2) of the outlines' planes."""
    radii: wp.array(dtype=f64)
    arcs: wp.array2d(dtype=f64)
    """Progress at even shares of each gate, m."""
    corners: wp.array(dtype=wp.vec2d)
    ends: wp.array(dtype=wp.int32)


def make_panels(guide: route.Guide, device: Any) -> Panels:
    """Return a guide on a device."""
    panels = Panels()
    corners, ends = guide.outlines
    panels.centres = wp.array(guide.centres, dtype=wp.vec3d, device=device)
    panels.normals = wp.array(guide.normals, dtype=wp.vec3d, device=device)
    panels.axes = wp.array(guide.axes, dtype=wp.vec3d, device=device)
    panels.radii = wp.array(guide.radii, dtype=wp.float64, device=device)
    panels.arcs = wp.array(guide._arcs, dtype=wp.float64, device=device)
    panels.corners = wp.array(corners, dtype=wp.vec2d, device=device)
    panels.ends = wp.array(ends, dtype=wp.int32, device=device)
    return panels


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
