"""The original's DistanceRewarder, for parity: a chain of panel centres.

The distance to go is that to the centre of the first panel not yet crossed, and from there along the centres to the
last one. When the vehicle has left a panel that it touched, on whichever side, the panel whose centre is nearest to it
(the last one never) and all before it count as crossed, for the rest of the episode.

The distance jumps where a panel is crossed off its centre, going back through a panel crosses it, and a panel of
another passage crosses those before it. The guide has none of this and is what measures progress by default.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.sim.batch.guide import Panels, is_in_outline, make_panels
from aquanav_tools.sim.batch.runtime import OPTIONS, find_device
from aquanav_tools.types import Array, Capsule

wp.set_module_options(OPTIONS)

f64 = wp.float64


@wp.struct
class Chain:
    """What N vehicles have crossed of a guide's panels."""

    to_go: wp.array(dtype=f64)
    """(P,) from each panel along the centres to the last, m."""
    crossed: wp.array(dtype=wp.int32)
    """(N,) panels crossed in this episode."""
    touched: wp.array2d(dtype=wp.bool)
    """(N, P) whether the vehicle touches the panel."""


def make_chain(guide: Guide, crossed: Any, touched: Any, device: Any) -> Chain:
    """Return the chain of a guide's panels; (N,) and (N, P) arrays on the device keep what vehicles have crossed."""
    chain = Chain()
    steps = np.linalg.norm(np.diff(guide.centres, axis=0), axis=1)
    chain.to_go = wp.array(np.append(np.cumsum(steps[::-1])[::-1], 0.0), dtype=wp.float64, device=device)
    chain.crossed, chain.touched = crossed, touched
    return chain


@wp.func
def nearest_centre(position: wp.vec3d, panels: Panels):
    """Return the panel whose centre is nearest to a position, the last one left out."""
    nearest = int(0)
    for n in range(1, panels.centres.shape[0] - 1):
        if wp.length_sq(panels.centres[n] - position) < wp.length_sq(panels.centres[nearest] - position):
            nearest = n
    return nearest


@wp.func
def forget_crossings(i: int, chain: Chain):
    """Begin an episode of vehicle `i`, in place."""
    chain.crossed[i] = 0
    for panel in range(chain.touched.shape[1]):
        chain.touched[i, panel] = False


@wp.func
def follow_chain(
    i: int, position: wp.vec3d, ahead: wp.vec3d, half_axis: f64, radius: f64, panels: Panels, chain: Chain
):
    """Note the panels that vehicle `i` touches or has left, in place, and return its distance to go, m."""
    for panel in range(panels.centres.shape[0]):
        offset, normal = position - panels.centres[panel], panels.normals[panel]
        is_touched = bool(False)
        if wp.abs(wp.dot(offset, normal)) <= half_axis * wp.abs(wp.dot(ahead, normal)) + radius:
            is_touched = is_in_outline(offset, panels, panel)
        if chain.touched[i, panel] and not is_touched:
            chain.crossed[i] = wp.max(chain.crossed[i], nearest_centre(position, panels) + 1)
        chain.touched[i, panel] = is_touched
    crossed = chain.crossed[i]
    return wp.length(panels.centres[crossed] - position) + chain.to_go[crossed]


@wp.kernel
def follow_one(
    pose: wp.array(dtype=wp.vec3d), half_axis: f64, radius: f64, panels: Panels, chain: Chain, out: wp.array(dtype=f64)
):
    """Follow one vehicle's (2,) position and axis, and write its distance to go."""
    out[0] = follow_chain(0, pose[0], pose[1], half_axis, radius, panels, chain)


class PanelChain:
    """The chain of a guide's panels, and how far along it one vehicle is."""

    def __init__(self, guide: Guide, capsule: Capsule) -> None:
        device = find_device("cpu")
        crossed = wp.zeros(1, dtype=wp.int32, device=device)
        touched = wp.zeros((1, len(guide.panels)), dtype=wp.bool, device=device)
        chain, out = make_chain(guide, crossed, touched, device), wp.zeros(1, dtype=wp.float64, device=device)
        pose = wp.zeros(2, dtype=wp.vec3d, device=device)
        inputs = [pose, 0.5 * capsule.axis_length, capsule.radius, make_panels(guide, device), chain, out]
        self._launch = wp.launch(follow_one, dim=1, inputs=inputs, device=device, record_cmd=True)
        self._crossed, self._touched = crossed.numpy(), touched.numpy()
        self._pose, self._out = pose.numpy(), out.numpy()

    @property
    def num_crossed(self) -> int:
        """Panels crossed so far."""
        return int(self._crossed[0])

    def reset(self) -> None:
        """Forget all crossings."""
        self._crossed[:] = 0
        self._touched[:] = False

    def follow(self, position: Array, ahead: Array) -> float:
        """Take note of the panels that a vehicle touches or has left, and return its distance to go, m.

        Args:
            position: (3,) of its middle, world, m.
            ahead: (3,) unit vector along its axis, world.
        """
        self._pose[0], self._pose[1] = position, ahead
        self._launch.launch()
        return float(self._out[0])
