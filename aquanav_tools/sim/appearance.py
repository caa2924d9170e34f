"""How vehicles look: simple shapes of our own, of the size and with the thrusters that a vehicle's file says.

A vehicle touches as its capsule, and a boat as its hulls, whatever it looks like. Those without a shape here look like
what they touch as.
"""

from __future__ import annotations

import numpy as np

from aquanav_tools.sim.boat import Boat
from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.solids import box, dome, inside_out, joined, prism, tube
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array, Capsule, Mesh

OPEN_FRAMES = {"bluerov2": (0.457, 0.338, 0.254), "bluerov2-heavy": (0.457, 0.575, 0.254)}
"""Length, width and height of vehicles with an open frame, m: Blue Robotics' data sheets. They are drawn as wide as
their capsule."""
STANDARD_THRUSTERS = (
    ((0.140, -0.110, -0.02), (0.7071, 0.7071, 0.0)), ((0.140, 0.110, -0.02), (0.7071, -0.7071, 0.0)),
    ((-0.140, -0.110, -0.02), (-0.7071, 0.7071, 0.0)), ((-0.140, 0.110, -0.02), (-0.7071, -0.7071, 0.0)),
    ((0.0, -0.110, 0.03), (0.0, 0.0, 1.0)), ((0.0, 0.110, 0.03), (0.0, 0.0, 1.0)),
)  # fmt: skip
"""Places and directions for a frame whose file has no thrusters: four level ones and two upright."""
NOZZLE_RADIUS, NOZZLE_LENGTH = 0.048, 0.055
"""Of a T200 thruster, m."""
BLACK, GREY, WHITE, GLASS = (28, 30, 34), (110, 116, 122), (225, 228, 230), (60, 90, 105)
BLUE, YELLOW, ORANGE, RED = (20, 95, 190), (245, 190, 30), (240, 120, 30), (200, 40, 35)


def vehicle_mesh(vehicle: Vehicle) -> Mesh:
    """Return how a vehicle looks: triangles in the body frame, m, normals outwards, with colours."""
    if isinstance(vehicle, OriginalVehicle) and vehicle.ballast is None:
        return _round_boat(vehicle.capsule)
    thrusters = vehicle.thrusters if isinstance(vehicle, FossenVehicle) else None
    places = () if thrusters is None else tuple(zip(thrusters.positions, thrusters.directions, strict=True))
    if vehicle.name in OPEN_FRAMES:
        return _open_frame(vehicle, places or STANDARD_THRUSTERS)
    return joined([_torpedo(vehicle.capsule), *(_thruster(*place) for place in places)])


def boat_mesh(boat: Boat | OriginalVehicle) -> Mesh:
    """Return how a boat looks: its hulls, exactly, with a deck, a box and a mast on them; see `vehicle_mesh`."""
    if isinstance(boat, OriginalVehicle):
        return vehicle_mesh(boat)
    outlines = [hull.outline for hull in boat.hulls]
    low, high = (pick([pick(outline, axis=0) for outline in outlines], axis=0) for pick in (np.min, np.max))
    top = max(hull.position[2] + 0.5 * hull.height for hull in boat.hulls)
    hulls = [
        prism(outline, hull.position[2] - 0.5 * hull.height, hull.position[2] + 0.5 * hull.height, ORANGE)
        for outline, hull in zip(outlines, boat.hulls, strict=True)
    ]
    return joined([*hulls, *_deck(low, high, top)])


def _deck(low: Array, high: Array, top: float) -> list[Mesh]:
    """Return what stands on hulls that reach from a (2,) corner to another and up to a height."""
    length, width = high - low
    middle, y = 0.5 * (low[0] + high[0]) - 0.08 * length, 0.5 * (low[1] + high[1])
    beam, mast = 0.03 * length, top + 0.5 * length
    bars = [box((2.0 * beam, 0.9 * width, beam), (middle + x, y, top + 0.5 * beam), GREY) for x in _ends(0.2 * length)]
    return [
        *bars,
        box((0.34 * length, 0.42 * width, 0.11 * length), (middle, y, top + beam + 0.055 * length), WHITE),
        box((0.20 * length, 0.30 * width, 0.01 * length), (middle, y, top + beam + 0.115 * length), BLACK),
        tube((middle - 0.2 * length, y, top), (middle - 0.2 * length, y, mast), (0.012 * length,) * 2, GREY),
        dome((middle - 0.2 * length, y, mast), 0.03 * length, (0.0, 0.0, 1.0), RED),
    ]


def _open_frame(vehicle: Vehicle, thrusters: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]) -> Mesh:
    """Return a frame of two side panels with floats on top, tubes between them, lights, and thrusters."""
    length, width, height = OPEN_FRAMES[vehicle.name]
    width = 2.0 * vehicle.capsule.radius
    side, bottom, top = 0.5 * width - 0.008, -0.5 * height, 0.5 * height
    panels, floats = [], []
    for sign in (-1.0, 1.0):
        y = sign * side
        panels += [
            box((length, 0.014, 0.06), (0.0, y, bottom + 0.03), BLACK),
            box((0.86 * length, 0.014, 0.07), (0.0, y, top - 0.075), BLACK),
            *(box((0.07, 0.014, height - 0.1), (x, y, -0.02), BLACK) for x in _ends(0.5 * length - 0.05)),
        ]
        floats.append(_float(length, sign * (side - 0.055), top))
    tubes = [
        tube((-0.16, 0.0, 0.01), (0.15, 0.0, 0.01), (0.057, 0.057), WHITE, (False, False)),
        tube((-0.18, 0.0, 0.01), (-0.16, 0.0, 0.01), (0.059, 0.059), BLACK),
        dome((0.15, 0.0, 0.01), 0.055, (1.0, 0.0, 0.0), GLASS),
        tube((-0.15, 0.0, bottom + 0.05), (0.13, 0.0, bottom + 0.05), (0.043, 0.043), GREY),
        box((0.05, width, 0.012), (0.10, 0.0, bottom + 0.006), BLACK),
        box((0.05, width, 0.012), (-0.10, 0.0, bottom + 0.006), BLACK),
    ]
    lights = [
        tube((0.16, sign * (side - 0.05), bottom + 0.05), (0.20, sign * (side - 0.05), bottom + 0.05), (0.018, 0.022),
             WHITE)
        for sign in (-1.0, 1.0)
    ]  # fmt: skip
    return joined([*panels, *floats, *tubes, *lights, *(_thruster(*place) for place in thrusters)])


def _float(length: float, y: float, top: float) -> Mesh:
    """Return a block of foam with bevelled ends."""
    x, half = 0.44 * length, 0.045
    outline = np.array([
        [-x, -half + 0.02], [-x + 0.04, -half], [x - 0.06, -half], [x, -half + 0.025],
        [x, half - 0.025], [x - 0.06, half], [-x + 0.04, half], [-x, half - 0.02],
    ])  # fmt: skip
    return prism(outline + [0.0, y], top - 0.065, top, BLUE, taper=1.03)


def _thruster(position: tuple[float, ...], direction: tuple[float, ...]) -> Mesh:
    """Return a nozzle with a hub and the blades of a propeller in it."""
    place, axis = np.array(position), np.array(direction) / np.linalg.norm(direction)
    back, front = place - 0.5 * NOZZLE_LENGTH * axis, place + 0.5 * NOZZLE_LENGTH * axis
    inner = 0.86 * NOZZLE_RADIUS
    blade = 0.25 * NOZZLE_LENGTH * axis
    return joined([
        tube(list(back), list(front), (NOZZLE_RADIUS, NOZZLE_RADIUS), BLACK, (False, False)),
        inside_out(tube(list(back), list(front), (inner, inner), GREY, (False, False))),
        tube(list(back - blade), list(front), (0.32 * NOZZLE_RADIUS, 0.32 * NOZZLE_RADIUS), BLACK),
        tube(list(place - 0.1 * blade), list(place + 0.1 * blade), (inner, inner), (66, 70, 76)),
    ])  # fmt: skip


def _torpedo(hull: Capsule) -> Mesh:
    """Return a capsule, yellow with a dark band before its tail, a red stripe along its back, and a propeller's hub."""
    half, radius, end = 0.5 * hull.axis_length, hull.radius, 0.5 * hull.length
    band = -half + max(0.25 * hull.axis_length, 0.02 * radius)
    return joined([
        dome((half, 0.0, 0.0), radius, (1.0, 0.0, 0.0), YELLOW),
        tube((band, 0.0, 0.0), (half, 0.0, 0.0), (radius, radius), YELLOW, (False, False)),
        tube((-half, 0.0, 0.0), (band, 0.0, 0.0), (radius, radius), BLACK, (False, False)),
        dome((-half, 0.0, 0.0), radius, (-1.0, 0.0, 0.0), YELLOW),
        box((0.9 * hull.length - 0.8 * radius, 0.2 * radius, 0.1 * radius), (0.0, 0.0, 0.96 * radius), RED),
        tube((-0.85 * end, 0.0, 0.0), (-1.0 * end, 0.0, 0.0), (0.3 * radius, 0.2 * radius), BLACK),
    ])  # fmt: skip


def _round_boat(hull: Capsule) -> Mesh:
    """Return a boat whose outline from above is its capsule's, with a cabin."""
    radius, half = hull.radius, 0.5 * hull.axis_length
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 11)
    bow = np.column_stack([half + radius * np.cos(angles), radius * np.sin(angles)])
    outline = np.concatenate([bow, -bow])
    return joined([
        prism(outline, -0.3 * radius, 0.3 * radius, ORANGE, taper=0.8),
        prism(outline, 0.3 * radius, 0.42 * radius, WHITE),
        prism(0.88 * outline, 0.42 * radius, 0.44 * radius, GREY),
        box((0.9 * half, radius, 0.75 * radius), (-0.2 * half, 0.0, 0.8 * radius), WHITE),
        box((0.7 * half, 1.02 * radius, 0.25 * radius), (-0.16 * half, 0.0, 0.92 * radius), GLASS),
        tube((-0.5 * half, 0.0, radius), (-0.5 * half, 0.0, 2.2 * radius), (0.03 * radius,) * 2, GREY),
        dome((-0.5 * half, 0.0, 2.2 * radius), 0.08 * radius, (0.0, 0.0, 1.0), RED),
    ])  # fmt: skip


def _ends(distance: float) -> tuple[float, float]:
    return -distance, distance
