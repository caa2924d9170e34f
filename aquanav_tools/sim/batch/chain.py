"""The original's DistanceRewarder, for parity: a chain of panel centres.

The distance to go is that to the centre of the first panel not yet crossed, and from there along the centres to the
last one. When the vehicle has left a panel that it touched, on whichever side, the panel whose centre is nearest to it
(the last one never) and all before it count as crossed, for the rest of the episode.

The distance jumps where a panel is crossed off its centre, going back through a panel crosses it, and a panel of
another passage crosses those before it. The guide has none of this and is what measures progress by default.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.sim.batch.guide import Panels, is_in_outline
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64


def distances_along_centres(guide: Guide) -> Array:
    """Return the (P,) distances from each panel along the centres to the last, m."""
    steps = np.linalg.norm(np.diff(guide.centres, axis=0), axis=1)
    return np.append(np.cumsum(steps[::-1])[::-1], 0.0)


@wp.func
def nearest_centre(position: wp.vec3d, panels: Panels):
    """Return the panel whose centre is nearest to a position, the last one left out."""
    nearest = int(0)
    for n in range(1, panels.centres.shape[0] - 1):
        if wp.length_sq(panels.centres[n] - position) < wp.length_sq(panels.centres[nearest] - position):
            nearest = n
    return nearest


@wp.func
def follow_chain(
    i: int,
    position: wp.vec3d,
    ahead: wp.vec3d,
    half_axis: f64,
    radius: f64,
    panels: Panels,
    to_go: wp.array(dtype=f64),
    crossed: wp.array(dtype=wp.int32),
    touched: wp.array2d(dtype=wp.bool),
):
    """Note the panels that vehicle `i` touches or has left, in place, and return its distance to go, m.

    `to_go` is `distances_along_centres`; `crossed` is (N,) panels crossed in this episode, `touched` (N, P) whether the
    vehicle touches the panel.
    """
    for panel in range(panels.centres.shape[0]):
        offset, normal = position - panels.centres[panel], panels.normals[panel]
        is_touched = bool(False)
        if wp.abs(wp.dot(offset, normal)) <= half_axis * wp.abs(wp.dot(ahead, normal)) + radius:
            is_touched = is_in_outline(offset, panels, panel)
        if touched[i, panel] and not is_touched:
            crossed[i] = wp.max(crossed[i], nearest_centre(position, panels) + 1)
        touched[i, panel] = is_touched
    return wp.length(panels.centres[crossed[i]] - position) + to_go[crossed[i]]
