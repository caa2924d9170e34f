"""The benchmark's task for a batch of boats, each in a bay of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.action import AFLOAT, DIVING
from aquanav_tools.envs.batch import BatchActions, Floats
from aquanav_tools.envs.bays import Bays
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.disturbance import draw_ray_seed
from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.envs.extensions import refuse_own
from aquanav_tools.envs.reward import TERMS, boat_weights
from aquanav_tools.envs.seas import Seas
from aquanav_tools.envs.surface_env import DT, SUBSTEPS, boat_of, episode_rules
from aquanav_tools.envs.surface_observation import SurfaceObservation, fill_surface
from aquanav_tools.errors import InputError
from aquanav_tools.sea.generate import MapSettings
from aquanav_tools.sea.outlines import to_outline
from aquanav_tools.sea.sea_map import SeaMap
from aquanav_tools.sim.boat import Boat
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.sea_fleet import SeaFleet
from aquanav_tools.sim.sea_state import SeaState
from aquanav_tools.sim.sea_water import SeaWater
from aquanav_tools.sim.sensors import boat_pattern
from aquanav_tools.task import TaskOptions, task_options
from aquanav_tools.types import Array

if TYPE_CHECKING:
    from aquanav_tools.sim.batch.disturbance import RayErrors

AHEAD = 128
"""Decisions for which gusts are drawn at once: chosen; drawing takes as long for one as for all of them."""
AT_REST = (
    "commands", "waiting_commands", "decisions", "ages", "is_touching", "collisions", "outcomes", "returns", "currents",
)  # fmt: skip
"""Arrays that are zero where an episode begins."""
Flags = npt.NDArray[np.bool_]


class BoatBatch:
    """N boats at the task of `SurfaceEnv`, with the same options and definitions: a `Batch`.

    A boat given a seed of its own has the very episode that `SurfaceEnv` has of it: bay, sea and gusts are drawn in the
    same order from the same generator, on the host when the episode begins. Its later episodes are drawn from that seed
    and their number. Not batched yet, and refused: the observation "original".
    """

    def __init__(
        self,
        bay: SeaMap | MapSettings | int | str | Path | None,
        num: int,
        *,
        next_step: bool,
        sea: str | SeaState = "calm",
        observation: str = "full",
        action: str = "multidiscrete",
        vehicle: str | Path | Boat | OriginalVehicle = "otter",
        max_decisions: int | None = None,
        device: str = "cpu",
        num_threads: int | None = None,
        **task: Any,
    ) -> None:
        """Prepare bays and boats; call `reset` next.

        Args:
            bay: As of `SurfaceEnv`.
            num: Number of boats.
            next_step: Whether an ended episode's successor begins at the next step, or in the same one.
            sea: As of `SurfaceEnv`.
            observation: "paper" or "full".
            action: "multidiscrete", "discrete" or "continuous".
            vehicle: As of `SurfaceEnv`.
            max_decisions: Episode limit; None takes 2400.
            device: Only "cpu": boats have no kernels for cards.
            num_threads: None takes as many as the process may use.
            task: The fields of `aquanav_tools.task.TaskOptions`.

        Raises:
            ScenarioError: the bay cannot be read, or has no start.
            InputError: an option is unknown, senseless or not batched.
        """
        check_choice("device for boats", device, ("cpu",))
        options = task_options(task)
        refuse_own(options, observation, "Boats")
        check_choice("batched observation preset", observation, ("paper", "full"))
        boat, pattern = boat_of(vehicle), boat_pattern()
        self.num, self.decision_seconds, self.ray_lengths = num, DT * SUBSTEPS, pattern.lengths
        self._weights = boat_weights(options.reward)
        self._rules = episode_rules(options, self._weights, max_decisions)
        self._seas, self._shares = Seas(sea, options.current), options.current_range
        self.fleet = SeaFleet(boat, num, self._seas.num_waves, pattern, DT, SUBSTEPS, num_threads)
        self._bays = Bays(bay, self.fleet.footprint.width, options.starts)
        self.observation_space = SurfaceObservation(observation, pattern.lengths).space
        self.parts: tuple[str, ...] = AFLOAT
        self._actions = BatchActions(action, num, AFLOAT)
        self.action_space = self._actions.space
        self._next_step = next_step
        num_corners = 1 if self._bays.fixed is None else len(self._bays.fixed.goal.corners)
        size = spaces.flatdim(self.observation_space)
        self._arrays = _blank_arrays(num, num_corners, size)
        self._waters: list[SeaWater | None] = [None] * num
        self._currents_ahead, self._winds_ahead = np.zeros((num, AHEAD, 3)), np.zeros((num, AHEAD, 2))
        self._is_resting = np.zeros(num, dtype=np.bool_)
        self._disturb(options, size)

    def _disturb(self, options: TaskOptions, size: int) -> None:
        """Prepare what errs and what comes late."""
        self._errors: RayErrors | None = None
        if options.sensor_noise > 0.0 or options.sensor_dropout > 0.0:
            from aquanav_tools.sim.batch.disturbance import RayErrors

            self._errors = RayErrors(self.num, self.ray_lengths, options.sensor_noise, options.sensor_dropout)
        for name, width in (("commands", 3 * options.action_delay), ("observations", size * options.observation_delay)):
            self._arrays[f"waiting_{name}"] = np.zeros((self.num, width), dtype=np.float32)

    def _delay(self, name: str, values: Floats, turns: npt.NDArray[np.int64], chosen: Flags) -> None:
        """Let the chosen boats' values wait in the queue of a name, where there is one, and take the oldest."""
        waiting = self._arrays[f"waiting_{name}"]
        if waiting.shape[1] > 0:
            from aquanav_tools.sim.batch.disturbance import delay

            delay(values, waiting, turns, chosen)

    @property
    def dynamics(self) -> dict[str, Array]:
        """Nothing: boats are as their files have them."""
        return {}

    @property
    def term_names(self) -> tuple[str, ...]:
        """Of the columns of "terms"."""
        return TERMS

    @property
    def failures(self) -> dict[int, str]:
        """None: boats have no code of the user's own."""
        return {}

    @property
    def route_lengths(self) -> Array:
        """(N,) how far the goal was at the episodes' beginnings, m."""
        lengths: Array = self.copy_of("lengths")
        return lengths

    @property
    def ways(self) -> Array:
        """(N,) length of the shortest way to the goal from where each episode began, m."""
        ways: Array = self.copy_of("ways")
        return ways

    def reset(
        self, seeds: Sequence[int], starts: Sequence[int | None] | None = None, conditions: dict[str, Any] | None = None
    ) -> None:
        """Begin all episodes, each from a seed of its own."""
        if conditions:
            raise InputError(f"Boats take {', '.join(conditions)} from the task, not from reset.")
        arrays = self._arrays
        arrays["seeds"][:], arrays["episodes"][:] = seeds, 0
        arrays["asked"][:] = [-1 if start is None else start for start in starts or [None] * self.num]
        everyone = np.ones(self.num, dtype=np.bool_)
        self._is_resting[:] = False
        for name in ("rewards", "terms", "terminated", "truncated"):
            arrays[name][:] = 0
        self._begin(everyone)
        self._look(everyone)

    def stagger(self, seed: int) -> None:
        """Let time run out earlier, by chance, in the episodes that have just begun."""
        self._arrays["ages"][:] = np.random.default_rng(seed).integers(self._rules.max_decisions, size=self.num)

    def command(self, actions: Any) -> None:
        """Hand the actions of all boats to the next step."""
        self.hold(self._actions.commands(actions))

    def hold(self, commands: Floats) -> None:
        """Hand (N, 3) ballast, of which boats have none, steer and thrust in [-1, 1] to the next step."""
        self._arrays["commands"][:] = commands

    def rest(self, places: Sequence[int]) -> None:
        """Let no episode follow at these places until the next reset."""
        self._is_resting[places] = True

    def step(self) -> None:
        """Carry out a decision of every boat; where the last one ended an episode, begin the next instead."""
        arrays = self._arrays
        is_over = (arrays["outcomes"] > 0) & self._next_step
        is_moving = ~is_over
        self._sail(is_moving)
        if (begins := is_over & ~self._is_resting).any():
            self._begin(begins)
        before = arrays["remaining"].copy()
        self._look(np.ones(self.num, dtype=np.bool_))
        self._score(is_moving, before)
        ended = arrays["outcomes"] > 0
        if not self._next_step and ended.any():
            arrays["final_observations"][:] = arrays["observations"]
            self._begin(ended)
            self._look(ended)

    def view_of(self, name: str) -> Any:
        """Return an array of a `Batch`, which later steps change."""
        if name == "clearances":
            return self.fleet.clearances()
        if name == "rays":
            return self.fleet.rays
        return self._moving_arrays()[name] if name in self._moving_arrays() else self._arrays[name]

    def copy_of(self, name: str) -> Any:
        """Return a copy of an array that later steps leave alone."""
        return np.array(self.view_of(name))

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all that the future depends on; bays and seas come again from their seeds."""
        return {name: values.copy() for name, values in self._kept().items()}

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Go back to where `state` was taken."""
        for name in ("seeds", "episodes", "asked"):
            self._arrays[name][:] = state[name]
        self._arrays["episodes"] -= 1  # they have begun
        self._begin(np.ones(self.num, dtype=np.bool_))
        for name, values in self._kept().items():
            values[:] = state[name]
        for i, decisions in enumerate(self._arrays["decisions"].tolist()):
            for _ in range(max(decisions - 1, 0) // AHEAD):
                self._draw_ahead(i)

    def close(self) -> None:
        """End the threads."""
        self.fleet.close()

    def _kept(self) -> dict[str, npt.NDArray[Any]]:
        fleet = self.fleet
        return self._arrays | {"states": fleet.states, "phases": fleet.phases, "touched": fleet.touched}

    def _moving_arrays(self) -> dict[str, Any]:
        states = self.fleet.states
        parts = {"positions": states[:, :3], "orientations": states[:, 3:7], "velocities": states[:, 7:13]}
        return parts | {"touched": self.fleet.touched}

    def _begin(self, chosen: Flags) -> None:
        """Draw the next episodes of the chosen boats, and put them at rest at their starts."""
        arrays = self._arrays
        for i in np.flatnonzero(chosen):
            episode, seed = int(arrays["episodes"][i]), int(arrays["seeds"][i])
            rng = np.random.default_rng([seed, episode] if episode else seed)
            asked = int(arrays["asked"][i]) if episode == 0 else -1
            sea, berth, way, number = self._bays.choose(rng, {} if asked < 0 else {"start": asked})
            water, self._arrays["shares"][i] = self._seas.draw(rng, sea.depth, self._shares)
            if self._errors is not None:
                arrays["ray_seeds"][i] = draw_ray_seed(rng)
            self.fleet.begin(int(i), sea, berth, water)
            self._waters[i] = water
            self._draw_ahead(int(i))
            arrays["goals"][i], arrays["centres"][i] = sea.goal.corners, sea.goal.centre
            arrays["tolerances"][i], arrays["ways"][i] = sea.goal.tolerance, way.length
            arrays["start_indices"][i] = number
        arrays["episodes"][chosen] += 1
        for name in AT_REST:
            arrays[name][chosen] = 0
        _measure(self.fleet.states, arrays["goals"], chosen, arrays["lengths"])
        arrays["remaining"][chosen] = arrays["lengths"][chosen]

    def _draw_ahead(self, i: int) -> None:
        water = self._waters[i]
        assert water is not None, "reset comes first"
        currents, self._winds_ahead[i] = water.draw_ahead(self.decision_seconds, AHEAD)
        self._currents_ahead[i] = self._arrays["shares"][i] * currents

    def _sail(self, is_moving: Flags) -> None:
        arrays = self._arrays
        place = arrays["decisions"] % AHEAD
        for i in np.flatnonzero(is_moving & (place == 0) & (arrays["decisions"] > 0)):
            self._draw_ahead(int(i))
        now = np.arange(self.num), place
        arrays["currents"][:] = self._currents_ahead[now]
        acting = arrays["commands"].copy()
        self._delay("commands", acting, arrays["decisions"], is_moving)
        steer, thrust = (acting[:, DIVING.index(name)].astype(np.float64) for name in AFLOAT)
        self.fleet.step(steer, thrust, (arrays["currents"], self._winds_ahead[now]), is_moving)
        arrays["decisions"][is_moving] += 1

    def _look(self, chosen: Flags) -> None:
        arrays, fleet = self._arrays, self.fleet
        fleet.sense()
        _measure(fleet.states, arrays["goals"], chosen, arrays["remaining"])
        rays, decisions = fleet.rays, arrays["decisions"]
        if self._errors is not None:
            rays, _ = self._errors.disturb(rays, arrays["ray_seeds"], decisions)
        seen = np.empty_like(arrays["observations"])
        _observe(fleet.states, rays, self.ray_lengths, arrays["centres"], arrays["commands"], seen)
        self._delay("observations", seen, np.where(decisions == 0, -1, decisions), chosen)
        arrays["observations"][chosen] = seen[chosen]

    def _score(self, is_moving: Flags, before: Array) -> None:
        """Count the decision of those that moved; the others began an episode, and get nothing."""
        arrays, touched = self._arrays, self.fleet.touched
        is_touching = touched > 0
        arrays["collisions"] += is_touching & ~arrays["is_touching"] & is_moving
        arrays["is_touching"][is_moving] = is_touching[is_moving]
        has_hit, is_there = is_touching & self._rules.ends_on_collision, arrays["remaining"] <= arrays["tolerances"]
        is_late = arrays["ages"] + arrays["decisions"] >= self._rules.max_decisions
        outcomes = np.select([~is_moving, has_hit, is_there, is_late], [0, *map(OUTCOMES.index, _ENDS)], 0)
        cut_off = self.fleet.rays.shape[1] - self.fleet.rays @ (1.0 / self.ray_lengths).astype(np.float32)
        amounts = (before - arrays["remaining"], SUBSTEPS, touched, SUBSTEPS * cut_off,
                   *(outcomes == OUTCOMES.index(name) for name in ("success", "collision", "timeout")))  # fmt: skip
        for n, (name, amount) in enumerate(zip(TERMS, amounts, strict=True)):
            arrays["terms"][:, n] = np.where(is_moving, getattr(self._weights, name) * amount, 0.0)
        arrays["rewards"][:] = arrays["terms"].sum(axis=1)
        arrays["returns"] += arrays["rewards"]
        arrays["outcomes"][is_moving] = outcomes[is_moving]
        arrays["truncated"][:] = outcomes == OUTCOMES.index("timeout")
        arrays["terminated"][:] = (outcomes > 0) & ~arrays["truncated"]
        for name in ("outcomes", "returns", "collisions"):
            arrays[f"last_{name}"][:] = arrays[name]
        arrays["last_lengths"][:] = arrays["decisions"]


_ENDS = ("collision", "success", "timeout")
"""Outcomes, the first that holds: a contact during the decision comes before the goal at its end."""


def _blank_arrays(num: int, num_corners: int, size: int) -> dict[str, npt.NDArray[Any]]:
    """Return what is known of each boat beside its motion, by name."""
    integers = ("seeds", "ray_seeds", "episodes", "asked", "decisions", "ages", "collisions", "outcomes",
                "start_indices", "last_outcomes", "last_lengths", "last_collisions")  # fmt: skip
    numbers = ("remaining", "lengths", "ways", "tolerances", "shares", "rewards", "returns", "last_returns")
    tables = {"goals": (num_corners, 2), "centres": (2,), "currents": (3,), "terms": (len(TERMS),)}
    singles = {"commands": 3, "observations": size, "final_observations": size}
    return (
        {name: np.zeros(num, dtype=np.int64) for name in integers}
        | {name: np.zeros(num) for name in numbers}
        | {name: np.zeros(num, dtype=np.bool_) for name in ("is_touching", "terminated", "truncated")}
        | {name: np.zeros((num, *shape)) for name, shape in tables.items()}
        | {name: np.zeros((num, width), dtype=np.float32) for name, width in singles.items()}
    )


@numba.njit(cache=True)
def _measure(states, goals, chosen, distances):  # type: ignore[no-untyped-def]
    """Write how far the chosen boats are from their goals, as `bays.distance_to` has it, m."""
    for i in range(len(states)):
        if chosen[i]:
            x, y, corners = states[i, 0], states[i, 1], goals[i]
            if len(corners) == 1:
                distances[i] = np.hypot(corners[0, 0] - x, corners[0, 1] - y)
            else:
                distances[i] = max(to_outline(corners, 0, len(corners), x, y), 0.0)


@numba.njit(cache=True)
def _observe(states, rays, ray_lengths, centres, commands, observations):  # type: ignore[no-untyped-def]
    whole = np.empty(16, dtype=np.float32)
    for i in range(len(states)):
        fill_surface(whole, states[i], rays[i], ray_lengths, centres[i], commands[i, 1], commands[i, 2])
        observations[i] = whole[: observations.shape[1]]
