"""Boats among rocks, one or many, each in a bay and on a sea of its own: their arrays, and the kernels run on them.

Rocks stand upright, so that seen from above a contact is one of two outlines, which a few lines solve exactly. Bullet
would need the rocks as triangles anew for the bay of each episode, to find the same points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.errors import InputError
from aquanav_tools.machine import num_cores
from aquanav_tools.sea.sea_map import Berth, SeaMap
from aquanav_tools.sim.batch import boat_kernels as kernels
from aquanav_tools.sim.batch.boat_bodies import BoatBodies
from aquanav_tools.sim.batch.boat_contact import Bay, make_bay, make_hull_outline, make_outline_work
from aquanav_tools.sim.batch.boat_hull import make_hull_work
from aquanav_tools.sim.batch.boat_law import BoatLaw
from aquanav_tools.sim.batch.boat_rays import make_beams
from aquanav_tools.sim.batch.boat_state import (
    AHEAD,
    BoatEpisode,
    BoatState,
    BoatTask,
    DrawEpisode,
    Model,
    Surroundings,
    make_boat_rules,
    make_boat_state,
    write_row,
)
from aquanav_tools.sim.batch.boat_water import pack_sea
from aquanav_tools.sim.batch.engine import MotionLaw
from aquanav_tools.sim.batch.runtime import find_device, launch_kernel, run_slices, sequence
from aquanav_tools.sim.batch.waves import NUM_ROWS, num_blocks, vec8
from aquanav_tools.sim.boat import DENSITY, Boat, footprint_of
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.randomisation import Randomisation
from aquanav_tools.sim.sea_water import SeaWater
from aquanav_tools.sim.sensors import RayPattern
from aquanav_tools.types import Array, Pose, yaw_quaternion

MAX_BOATS = 1 << 16
"""Chosen; some 2 GB with their seas."""
MIN_SLICE = 16
"""Boats for which a further thread is worth its start."""


class BoatWorld:
    """N boats. `reset`, then `set_commands` and `step` once per decision; ended episodes are followed by new ones.

    The arrays in `boats` are Warp's, on `device`; `as_numpy` shows them.
    """

    def __init__(
        self,
        boat: Boat | OriginalVehicle,
        task: BoatTask,
        num: int,
        draw_episode: DrawEpisode,
        *,
        pattern: RayPattern,
        num_waves: int,
        randomisation: Randomisation | None = None,
        law: MotionLaw | None = None,
        next_step: bool = True,
        device: str = "cpu",
        num_threads: int | None = None,
    ) -> None:
        """Make room for `num` boats; call `reset` next.

        Args:
            boat: All of them.
            task: What is observed and paid for, and when episodes end.
            num: Number of boats.
            draw_episode: Returns a boat's next episode.
            pattern: Of beams.
            num_waves: In the sea of each; episodes may have fewer.
            randomisation: From which each episode draws its boat's dynamics; None leaves them as the boat's file has
                them.
            law: Where boats go in a physics step were there no rocks; None leaves it to water and wind.
            next_step: Whether an ended episode's successor begins at the next step, or in the same one.
            device: "cpu", "cuda" or "cuda:0".
            num_threads: On the processor; None takes as many as the process may use.

        Raises:
            InputError: no such device, or a senseless number; or a boat may sink by what is drawn; or a law is to
                move boats on a GPU.
        """
        if not 1 <= num <= MAX_BOATS:
            raise InputError(f"A batch must have 1 to {MAX_BOATS} boats, got {num}.")
        self.num, self.boat, self.footprint = num, boat, footprint_of(boat)
        self.device = find_device(device)
        if law is not None and not self.device.is_cpu:
            why = "A law of motion of your own is computed on the processor"
            raise InputError(f"{why}, not on {device}. Leave that out.")
        self._draw_episode, self._next_step, self._task = draw_episode, next_step, task
        self._num_blocks = num_blocks(num_waves)
        self._deepest = -float(pattern.radii.max())
        most = (0, 0) if randomisation is None else randomisation.most_delays()
        delays = max(task.action_delay, most[0]), max(task.observation_delay, most[1])
        self.boats = make_boat_state(num, task, len(pattern.lengths), delays, self.device)
        self._bodies = BoatBodies(boat, num, task.dt, randomisation, self.device)
        self.boats.body_of.assign(self._bodies.body_of)
        self._model = self._make_model(pattern, task)
        self._around = self._make_surroundings()
        self._rules = make_boat_rules(task, self.device)
        self._law = None if law is None else BoatLaw(law, self.boats, self.device)
        self._bay_slots = BaySlots(self._around.bays, self._deepest)
        self.episodes: list[BoatEpisode | None] = [None] * num
        """The episode that each boat is in."""
        self._views: dict[str, Any] = {}
        """Of arrays on the processor, in the same memory."""
        self._is_retired = np.zeros(num, dtype=np.bool_)
        self._bounds = _slices(num, num_threads) if self.device.is_cpu else [0, num]
        self._threads = ThreadPoolExecutor(len(self._bounds) - 1) if len(self._bounds) > 2 else None
        self._sequences = self._record()

    def _make_model(self, pattern: RayPattern, task: BoatTask) -> Model:
        model, device = Model(), self.device
        model.bodies = self._bodies.array
        model.outline = make_hull_outline(self.footprint, device)
        model.beams = make_beams(pattern, task.observation == "original", device)
        model.hull_work = make_hull_work(self.num, self._bodies.surface, self._num_blocks, device)
        model.outline_work = make_outline_work(self.num, model.outline, device)
        return model

    def _make_surroundings(self) -> Surroundings:
        around, num, blocks = Surroundings(), self.num, self._num_blocks
        around.bays = wp.zeros(num, dtype=Bay, device=self.device)
        around.bay_of = wp.zeros(num, dtype=wp.int32, device=self.device)
        around.sea.table = wp.zeros((num, NUM_ROWS, blocks), dtype=vec8, device=self.device)
        around.sea.phases = wp.zeros((num, blocks), dtype=vec8, device=self.device)
        around.currents = wp.zeros((num, AHEAD), dtype=wp.vec3d, device=self.device)
        around.winds = wp.zeros((num, AHEAD), dtype=wp.vec2d, device=self.device)
        return around

    def reset(self) -> None:
        """Begin an episode of each boat."""
        self._is_retired[:] = False
        everyone = np.ones(self.num, dtype=np.bool_)
        self._hold(everyone, everyone)
        self._begin(everyone)
        for name in ("rewards", "terms", "terminated", "truncated"):
            getattr(self.boats, name).zero_()
        run_slices(self._sequences.beginning, self._threads)

    def randomise_time_limits(self, decisions: npt.NDArray[np.integer]) -> None:
        """Let time run out (N,) decisions earlier in the episodes that have just begun."""
        self.boats.ages.assign(decisions.astype(np.int32))

    def retire(self, boats: Sequence[int]) -> None:
        """Let no episode follow of these boats until the next reset."""
        self._is_retired[list(boats)] = True

    def step(self, judge: Callable[[], None] | None = None) -> None:
        """Carry out a decision of every boat.

        Args:
            judge: Called when the decision is over, before ended episodes are followed by others in the same step.
        """
        is_over = self.as_numpy("outcomes") > 0
        begins = is_over & ~self._is_retired & self._next_step
        self._hold(is_over, begins)
        if begins.any():
            self._begin(begins)
        self._decide()
        self._draw_on(~is_over)
        if judge is not None:
            judge()
        if not self._next_step:
            ended = (self.as_numpy("outcomes") > 0) & ~self._is_retired
            if ended.any():
                self._hold(is_over, ended)
                self._begin(ended)
                run_slices(self._sequences.beginning, self._threads)

    def _decide(self) -> None:
        """Run the kernels of a decision, and ask the user's law between them where there is one."""
        sequences = self._sequences
        run_slices(sequences.decision, self._threads)
        if self._law is not None:
            for _ in range(self._task.substeps):
                self._law.ask()
                run_slices(sequences.obeying, self._threads)
            run_slices(sequences.judging, self._threads)

    def _hold(self, held: npt.NDArray[np.bool_], begun: npt.NDArray[np.bool_]) -> None:
        """Say which boats stay where they are in a step, and which begin an episode."""
        self.write("held", held)
        self.write("restarted", begun)

    def _begin(self, chosen: npt.NDArray[np.bool_]) -> None:
        """Draw the next episodes of the chosen boats, and place them at their berths."""
        rows = np.flatnonzero(chosen)
        episodes = [self._draw_episode(i) for i in rows.tolist()]
        self._bodies.draw(rows, np.array([episode.seed for episode in episodes], dtype=np.uint32))
        if self._bodies.drawn is not None:
            self._bodies.drawn.write_sensing(self.boats, rows)
        for i, episode in zip(rows.tolist(), episodes, strict=True):
            self.episodes[i] = episode
            self._place(i, episode)

    def _place(self, i: int, episode: BoatEpisode) -> None:
        """Put a boat at its berth, on the sea of an episode."""
        boats, sea = self.boats, self._around.sea
        state = state_at_berth(self._bodies.boat_of(i), episode.berth, episode.water)
        table, phases = pack_sea(*episode.water.waves, self._num_blocks)
        write_row(self._around.bay_of, i, self._bay_slots.take(i, episode.bay))
        for array, value in (
            (sea.table, table), (sea.phases, phases), (boats.noises, episode.noise),
            (boats.positions, state[:3]), (boats.orientations, state[3:7]), (boats.dropouts, episode.dropout),
            (boats.seeds, np.uint32(episode.seed).view(np.int32)),
        ):  # fmt: skip
            write_row(array, i, value)
        self._draw_ahead(i)

    @property
    def dynamics(self) -> dict[str, Array]:
        """(N,) what the episodes have drawn of their boats' dynamics, by name; nothing without a randomisation."""
        return {} if self._bodies.drawn is None else self._bodies.drawn.by_name

    def _draw_on(self, moved: npt.NDArray[np.bool_]) -> None:
        """Draw the gusts of boats that have used up theirs."""
        for i in np.flatnonzero(moved & (self.as_numpy("decisions") % AHEAD == 0)).tolist():
            self._draw_ahead(i)

    def _draw_ahead(self, i: int) -> None:
        """Draw the current and the wind of a boat's next AHEAD decisions."""
        episode = self.episodes[i]
        assert episode is not None, "reset comes first"
        currents, winds = episode.water.draw_ahead(self._task.dt * self._task.substeps, AHEAD)
        write_row(self._around.currents, i, episode.current_fraction * currents)
        write_row(self._around.winds, i, winds)

    def current_at(self, i: int) -> Array:
        """Return the (3,) velocity of the water without its waves around boat `i` in the next decision, m/s."""
        found: Array = self._around.currents.numpy()[i, self.as_numpy("decisions")[i] % AHEAD].copy()
        return found

    def water_at(self, i: int) -> SeaWater:
        """Return the sea around boat `i`, its waves as they are now: for pictures. Its gusts are drawn ahead."""
        episode = self.episodes[i]
        assert episode is not None, "reset comes first"
        water, phases = episode.water, self._around.sea.phases.numpy()[i].ravel()
        water.set_phases(phases[: len(water.waves[1])])
        return water

    def as_numpy(self, name: str) -> Any:
        """Return an array of `BoatState` as NumPy's: the same memory on the processor, a copy from a GPU."""
        if name == "clearances":
            run_slices(self._sequences.clearing, self._threads)
        if name in self._views:
            return self._views[name]
        array = getattr(self.boats, name)
        values = array.numpy()
        if array.device.is_cpu:
            self._views[name] = values
        return values

    @property
    def has_moved(self) -> npt.NDArray[np.bool_]:
        """(N,) whether the step was a decision of an episode: not its beginning, nor a wait after its end."""
        has_moved: npt.NDArray[np.bool_] = self.as_numpy("held") == 0
        return has_moved

    def write(self, name: str, values: Any) -> None:
        """Change an array of `BoatState`: all rows."""
        if self.device.is_cpu:
            self.as_numpy(name)[:] = values
        else:
            array = getattr(self.boats, name)
            array.assign(np.ascontiguousarray(values, dtype=array.numpy().dtype))

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all that the future depends on, but for the episodes that boats are in."""
        names = BoatState.vars  # type: ignore[attr-defined]
        arrays = {name: np.array(getattr(self.boats, name).numpy()) for name in names}
        return arrays | {"phases": np.array(self._around.sea.phases.numpy())}

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Go back to where `state` was taken; boats must have begun the episodes that they were in."""
        for name in BoatState.vars:  # type: ignore[attr-defined]
            getattr(self.boats, name).assign(state[name])
        self._around.sea.phases.assign(state["phases"])
        for i, decisions in enumerate(state["decisions"].tolist()):
            for _ in range(decisions // AHEAD):
                self._draw_ahead(i)

    def close(self) -> None:
        """End the threads. Closing twice does nothing."""
        if self._threads is not None:
            self._threads.shutdown()

    def _record(self) -> _Sequences:
        """Return the launches for each slice."""
        recorded = _Sequences([], [], [], [], [])
        boats, around, model, rules = self.boats, self._around, self._model, self._rules
        for first, last in zip(self._bounds[:-1], self._bounds[1:], strict=True):

            def launch_of(kernel: Any, *inputs: Any, num: int = last - first) -> Any:
                return launch_kernel(kernel, dim=num, inputs=list(inputs), device=self.device, record_cmd=True)

            begin = launch_of(kernels.begin, first, boats, around)
            sense = launch_of(kernels.sense, first, 0, boats, around, model, rules)
            sense_begun = launch_of(kernels.sense, first, 1, boats, around, model, rules)
            score = launch_of(kernels.score, first, boats, around, model, rules)
            if self._law is None:
                move = launch_of(kernels.move, first, boats, around, model, rules)
                recorded.decision.append(sequence([begin, move, sense, score], self.device))
            else:
                take = launch_of(kernels.take, first, boats, around, rules)
                obey = launch_of(kernels.obey, first, self._law.free, boats, around, model)
                recorded.decision.append(sequence([begin, take], self.device))
                recorded.obeying.append(sequence([obey], self.device))
                recorded.judging.append(sequence([sense, score], self.device))
            recorded.beginning.append(sequence([begin, sense_begun], self.device))
            recorded.clearing.append(sequence([launch_of(kernels.clear, first, boats, around, model)], self.device))
        return recorded


@dataclass(frozen=True)
class _Sequences:
    """Kernels to be run one after the other, of each slice of the boats."""

    decision: list[Callable[[], None]]
    """The whole of it; its beginning alone where a law of the user's own moves boats."""
    obeying: list[Callable[[], None]]
    """A physics step by such a law."""
    judging: list[Callable[[], None]]
    """What follows the last of these."""
    beginning: list[Callable[[], None]]
    clearing: list[Callable[[], None]]


class BaySlots:
    """Which row of an array of bays each boat's bay is in: boats in the same bay share one."""

    def __init__(self, bays: Any, deepest: float) -> None:
        """Keep bays in an array on a device, whose beams see what reaches up to `deepest` (m) below still water."""
        self._bays, self._deepest = bays, deepest
        self._used: list[set[int]] = [set() for _ in range(bays.shape[0])]
        self._maps: list[SeaMap | None] = [None] * bays.shape[0]
        self._kept: list[Bay | None] = [None] * bays.shape[0]
        """The arrays that the device's rows point to."""
        self._slot_of = [-1] * bays.shape[0]
        self._free = list(range(bays.shape[0]))[::-1]
        self._by_map: dict[int, int] = {}

    def take(self, i: int, sea: SeaMap) -> int:
        """Return the row of a boat's new bay, which is there from now on."""
        slot = self._by_map.get(id(sea), -1)
        if slot != self._slot_of[i] or slot < 0:
            self._leave(i)
        if slot < 0:
            slot = self._free.pop()
            self._by_map[id(sea)], self._maps[slot] = slot, sea
            bay = self._kept[slot] = make_bay(sea, self._deepest, self._bays.device)
            row = wp.array([bay], dtype=Bay, device=self._bays.device)
            wp.copy(self._bays, row, dest_offset=slot, count=1)
        self._slot_of[i] = slot
        self._used[slot].add(i)
        return slot

    def _leave(self, i: int) -> None:
        slot = self._slot_of[i]
        if slot < 0:
            return
        self._used[slot].discard(i)
        if not self._used[slot]:
            del self._by_map[id(self._maps[slot])]
            self._maps[slot] = self._kept[slot] = None
            self._free.append(slot)


def state_at_berth(boat: Boat | OriginalVehicle, berth: Berth, water: SeaWater) -> Array:
    """Return the state of a boat at rest afloat at a berth: (13,), of the original's boat (14,)."""
    if isinstance(boat, OriginalVehicle):
        return boat.state_at(Pose(np.array([*berth.position, 0.0]), yaw_quaternion(berth.heading)))
    state = boat.state_at(berth.position, berth.heading, DENSITY)
    state[2] += water.rise(state[None, :3])[0]
    return state


def _slices(num: int, num_threads: int | None) -> list[int]:
    """Return where each thread's boats begin, and `num`."""
    available = num_cores() if num_threads is None else num_threads
    if available < 1:
        raise InputError(f"num_threads must be at least 1, got {num_threads}.")
    bounds: list[int] = np.linspace(0, num, max(1, min(available, num // MIN_SLICE)) + 1).astype(int).tolist()
    return bounds
