"""What the oracle would choose, for all vehicles of a batch at once: the teacher of policies that learn by imitation.

It knows the map, the body that each episode drew, its commands under way and the water of now wherever it comes to.
Like `evaluate.oracle`, whose laws of pursuit it shares, it takes the fastest pace that keeps enough room while it
follows the roomiest way, and where none does, the command after which pursuit keeps most room and then gets farthest.
Its way begins where the vehicle is, at every decision, as vehicles are anywhere that their own policies lead them to.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.cave.water import roomy_ways as water_ways
from aquanav_tools.cave.water.roomy_ways import RoomyWays, roomy_ways
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.actuators import actuated, trim_of
from aquanav_tools.sim.batch.caves import Cave, shared
from aquanav_tools.sim.batch.contact import axis_clearance
from aquanav_tools.sim.batch.craft import Craft
from aquanav_tools.sim.batch.motion import State, read_motion, swim
from aquanav_tools.sim.batch.pursuit import (
    HORIZON,
    MARGIN,
    MAX_HALVINGS,
    PACES,
    PATIENCE,
    SHARE,
    SLOWEST,
    STRIDE,
    command_towards,
)  # fmt: skip
from aquanav_tools.sim.batch.runtime import OPTIONS, launch_kernel, run_slices
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.batch.table import StructTable
from aquanav_tools.sim.batch.water import current_around
from aquanav_tools.sim.batch.world import BatchWorld
from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.vehicle_base import Vehicle

wp.set_module_options(OPTIONS)

f64 = wp.float64
NUM_AHEAD, MOST_HALVINGS, WAIT = wp.constant(HORIZON), wp.constant(MAX_HALVINGS), wp.constant(PATIENCE)
SLOW, ROOM, PART, STEP = (wp.constant(wp.float64(value)) for value in (SLOWEST, MARGIN, SHARE, STRIDE))
"""As `pursuit` has them."""
BITS = wp.constant(3)
MASK = wp.constant(water_ways.BLOCK - 1)
VOLUME = wp.constant(water_ways.BLOCK**3)
UNKNOWN = wp.constant(water_ways.NO_NODE)
PARTS_PER_THREAD = 4
"""Slices of the batch that a thread works off: vehicles beside walls take ten times as long as others."""
STATE = ("nearest", "waited", "nodes")


@wp.struct
class Ways:
    """`RoomyWays` on the device."""

    origin: wp.vec3d
    spacing: f64
    num: wp.vec3i
    """Blocks along each axis."""
    blocks: wp.array(dtype=wp.int32)
    cells: wp.array(dtype=wp.int32)
    aims: wp.array(dtype=wp.vec3d)
    heights: wp.array(dtype=f64)
    beyond: wp.array(dtype=f64)
    rooms: wp.array(dtype=f64)


@wp.struct
class Memory:
    """What it remembers of each vehicle's episode."""

    nearest: wp.array(dtype=f64)
    """(N,) how near to the goal the vehicle has come, in strides, m."""
    waited: wp.array(dtype=wp.int32)
    """(N,) decisions since."""
    nodes: wp.array(dtype=wp.int32)
    """(N,) sample of the water that it was last found at."""


@wp.struct
class Led:
    """Where a first command leads that pursuit follows."""

    command: wp.vec3d
    """The first one: ballast, steer and thrust."""
    clearance: f64
    """The least on the way, m."""
    remaining: f64
    """Way to the goal in the end, m."""


@wp.func
def node_at(ways: Ways, position: wp.vec3d, before: int):
    """Return the sample that a place goes by; where none is near, the one before."""
    place = (position - ways.origin) / ways.spacing
    i, j, k = int(wp.rint(place[0])), int(wp.rint(place[1])), int(wp.rint(place[2]))
    x, y, z = i >> BITS, j >> BITS, k >> BITS
    if i < 0 or j < 0 or k < 0 or x >= ways.num[0] or y >= ways.num[1] or z >= ways.num[2]:
        return before
    block = ways.blocks[(x * ways.num[1] + y) * ways.num[2] + z]
    if block == UNKNOWN:
        return before
    node = ways.cells[block * VOLUME + ((i & MASK) << (2 * BITS)) + ((j & MASK) << BITS) + (k & MASK)]
    if node == UNKNOWN:
        return before
    return node


@wp.func
def remaining_from(ways: Ways, node: int, position: wp.vec3d):
    """Return the way to the goal from a place, m."""
    return ways.beyond[node] + wp.length(ways.aims[node] - position)


@wp.func
def held(moving: State, level: f64, command: wp.vec3d, current: wp.vec3d, cave: Cave, craft: Craft):
    """Return the state, and the ballast's level, after a decision in free water."""
    state, trimmed = moving, f64(1.0) * level
    for _ in range(cave.rules.substeps):
        wrench, after = actuated(command, trimmed, craft.controls)
        trimmed = after
        state = swim(state, wrench, current, craft.body, cave.rules.dt)
    return state, trimmed


@wp.func
def led(
    i: int, has_command: int, command: wp.vec3d, begin: State, level: f64, water: wp.vec3d, pace: f64, enough: f64,
    node: int, batch: BatchState, cave: Cave, craft: Craft, ways: Ways,
):  # fmt: skip
    """Carry out a command, or the pursuit's own, and then pursue the way, until there is less room than `enough`."""
    state, trimmed, at, current = begin, f64(1.0) * level, int(node), f64(1.0) * water
    result, asked = Led(), f64(1.0) * command
    clearance = axis_clearance(cave.grid, state, craft.hull) - craft.hull.radius
    if has_command == 0:
        trim = trim_of(trimmed, craft.controls)
        asked = command_towards(state, trim, clearance, pace, current, ways.aims[at], ways.heights[at])
    result.command = asked
    least = f64(wp.inf)
    for _ in range(NUM_AHEAD):
        moved, after = held(state, trimmed, asked, current, cave, craft)
        state = moved
        trimmed = after
        clearance = axis_clearance(cave.grid, state, craft.hull) - craft.hull.radius
        least = wp.min(least, clearance)
        if least < enough:
            break
        at = node_at(ways, state.position, at)
        current = current_around(i, cave.water, cave.grid, batch, state.position)
        trim = trim_of(trimmed, craft.controls)
        asked = command_towards(state, trim, clearance, pace, current, ways.aims[at], ways.heights[at])
    result.clearance = least
    result.remaining = remaining_from(ways, at, state.position)
    return result


@wp.func
def asked_room(i: int, remaining: f64, room: f64, memory: Memory):
    """Return the clearance that is asked for, m, and note how near to the goal vehicle `i` has come."""
    memory.waited[i] = memory.waited[i] + 1
    if remaining < memory.nearest[i] - STEP:
        memory.nearest[i] = remaining
        memory.waited[i] = 0
    halvings = wp.min(memory.waited[i] / WAIT, MOST_HALVINGS)
    return wp.min(ROOM, PART * wp.max(room, f64(0.0))) * wp.pow(f64(0.5), f64(halvings))


@wp.kernel
def advise(
    first: int,
    batch: BatchState,
    caves: wp.array(dtype=Cave),
    crafts: wp.array(dtype=Craft),
    all_ways: wp.array(dtype=Ways),
    paces: wp.array(dtype=f64),
    memory: Memory,
    advice: wp.array2d(dtype=wp.float32),
):
    """Write each vehicle's best command, ballast, steer and thrust, which takes effect after those under way."""
    i = batch.order[first + wp.tid()]
    cave, craft, ways = caves[batch.cave_of[i]], crafts[batch.craft_of[i]], all_ways[batch.cave_of[i]]
    state = read_motion(i, batch.positions, batch.orientations, batch.velocities)
    level, current, turn = f64(1.0) * batch.levels[i], batch.currents[i], batch.decisions[i]
    if turn == 0:
        memory.nearest[i] = f64(wp.inf)
        memory.waited[i] = 0
        memory.nodes[i] = 0
    node = node_at(ways, state.position, memory.nodes[i])
    delay = batch.action_delays[i]
    for n in range(delay):
        place = 3 * ((turn + n) % delay)
        pending = wp.vec3d()
        for axis in range(3):
            pending[axis] = f64(batch.waiting_commands[i, place + axis])
        moved, after = held(state, level, pending, current, cave, craft)
        state = moved
        level = after
        node = node_at(ways, state.position, node)
    memory.nodes[i] = node
    room = asked_room(i, remaining_from(ways, node, state.position), ways.rooms[node], memory)
    chosen, is_chosen = wp.vec3d(), int(0)
    for n in range(paces.shape[0]):
        if is_chosen == 0:
            paced = led(i, 0, chosen, state, level, current, paces[n], room, node, batch, cave, craft, ways)
            if paced.clearance >= room:
                chosen = paced.command
                is_chosen = 1
    if is_chosen == 0:
        most, nearest = f64(-wp.inf), f64(wp.inf)
        for number in range(27):
            command = wp.vec3d(f64(number / 9 - 1), f64(number / 3 % 3 - 1), f64(number % 3 - 1))
            tried = led(i, 1, command, state, level, current, SLOW, most, node, batch, cave, craft, ways)
            kept = wp.min(tried.clearance, room)
            if kept > most or (kept == most and tried.remaining < nearest):
                most = kept
                nearest = tried.remaining
                chosen = command
    for axis in range(3):
        advice[i, axis] = float(chosen[axis])


class BatchOracle:
    """The oracle of a batch on the processor, whose vehicles move by the equations of `motion`."""

    def __init__(self, world: BatchWorld, pairs: Sequence[tuple[Scenario, Vehicle]]) -> None:
        """Find the ways in the caves.

        Args:
            world: The batch.
            pairs: Each cave, with the vehicle in it, by the world's number of the cave.

        Raises:
            InputError: the vehicle is the original's, or the batch is on a GPU.
            MeshError: no place of a cave is wide enough for its vehicle.
        """
        if not world.device.is_cpu:
            raise InputError("The oracle of a batch looks ahead on the processor. Choose device='cpu'.")
        device, self._device = world.device, world.device
        self._ways = StructTable(Ways, [self._found(*pair) for pair in pairs], device)
        self._memory = memory = Memory()
        memory.nearest = wp.zeros(world.num, dtype=wp.float64, device=device)
        memory.waited = wp.zeros(world.num, dtype=wp.int32, device=device)
        memory.nodes = wp.zeros(world.num, dtype=wp.int32, device=device)
        advice = wp.zeros((world.num, 3), dtype=wp.float32, device=device)
        self._advice: npt.NDArray[np.float32] = advice.numpy()
        inputs = [*world.launched_on, self._ways.array, wp.array(PACES, dtype=wp.float64, device=device)]
        self._threads = ThreadPoolExecutor(world.num_slices)
        cuts = np.linspace(0, world.num, PARTS_PER_THREAD * world.num_slices + 1).astype(int).tolist()
        self._kept = [advice, inputs]
        self._launches = [
            launch_kernel(
                advise, dim=last - first, inputs=[first, *inputs, memory, advice], device=device, record_cmd=True
            ).launch
            for first, last in pairwise(cuts)
            if last > first
        ]

    def _found(self, scenario: Scenario, vehicle: Vehicle) -> Ways:
        if not isinstance(vehicle, FossenVehicle) or vehicle.thrusters:
            raise InputError(
                "The oracle of a batch knows vehicles with a thrust ahead and a moment of steer, and this one is of "
                "another model. Choose one such as bluerov2; in aquanav-eval leave out --backend batch: the oracle of "
                "one vehicle knows more of them."
            )
        goal, radius = np.array(scenario.settings.goal.position, dtype=np.float64), vehicle.capsule.radius
        key = ("ways", goal.tolist(), radius)
        return shared(scenario.field, key, lambda: _on_device(roomy_ways(scenario.field, goal, radius), self._device))

    def put(self, cave: int, scenario: Scenario, vehicle: Vehicle) -> None:
        """Take note of a cave that has taken another one's number."""
        self._ways.put(cave, self._found(scenario, vehicle))

    def __call__(self) -> npt.NDArray[np.float32]:
        """Return the (N, 3) ballast, steer and thrust, each -1, 0 or 1, that it would command now."""
        run_slices(self._launches, self._threads)
        return self._advice

    def close(self) -> None:
        """End the threads. Closing twice does nothing."""
        self._threads.shutdown()

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of what it remembers."""
        return {name: np.array(getattr(self._memory, name).numpy()) for name in STATE}

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Go back to where `state` was taken."""
        for name in STATE:
            getattr(self._memory, name).assign(state[name])


def _on_device(found: RoomyWays, device: Any) -> Ways:
    ways = Ways()
    ways.origin, ways.spacing, ways.num = wp.vec3d(*found.origin), found.spacing, wp.vec3i(*found.blocks.shape)
    ways.aims = wp.array(found.aims, dtype=wp.vec3d, device=device)
    for name, kind in (("blocks", wp.int32), ("cells", wp.int32)):
        setattr(ways, name, wp.array(getattr(found, name).ravel(), dtype=kind, device=device))
    for name in ("heights", "beyond", "rooms"):
        setattr(ways, name, wp.array(getattr(found, name), dtype=wp.float64, device=device))
    return ways
