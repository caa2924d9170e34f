"""Joining what is the user's own to a batch of vehicles: when each is asked, and where the answers go."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.batch_view import BatchView
from aquanav_tools.envs.definitions import (
    OwnCode,
    WrongAnswerError,
    array_of,
    base_of,
    box_of,
    check_commands,
    check_flags,
    common_box,
    find_disturbance,
    find_sensor,
)
from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.envs.reward import NOTHING, REWARDS, TERMS
from aquanav_tools.errors import InputError
from aquanav_tools.registry import Registry, is_own
from aquanav_tools.sim.scales import PRESETS
from aquanav_tools.task import TaskOptions

if TYPE_CHECKING:
    from aquanav_tools.sim.batch.sensors.base import SensorBatch

MAX_MOVE = 1.0
"""In a physics step, m: a vehicle at 50 m/s. A wall may be too thin to stop one that is faster."""
OWN_PREFIX = "own/"
"""Of the names of arrays in `state`."""
ENDED = OUTCOMES.index("ended")
Flags = npt.NDArray[np.bool_]


class VehicleArrays(Protocol):
    """The vehicles, in caves or of boats, as what is the user's own reads and changes their arrays."""

    def as_numpy(self, name: str) -> Any:
        """Return an array, (N, ...)."""

    def write(self, name: str, values: npt.NDArray[Any]) -> None:
        """Change an array."""

    @property
    def has_moved(self) -> Flags:
        """(N,) whether the step was a decision of an episode: not its beginning, nor a wait after its end."""


class Extensions:
    """All that is the user's own in one batch.

    `prepare` first. Then `begin` after each reset, and for each decision `before` it, `judge` when it is done and no
    successor of an ended episode has begun, and `after` when they have.
    """

    def __init__(self, options: TaskOptions, observation: str, parts: object = None) -> None:
        """Import what the options name.

        Args:
            options: Of the task.
            observation: A preset, or module:Name.
            parts: A dictionary of parts that is observed as it is, of which the preset is one; None without.

        Raises:
            InputError: a name means nothing, or not what is asked for.
        """
        self._reward = OwnCode("reward", options.reward, "terms") if is_own(options.reward) else None
        if not is_own(observation):
            Registry("observation preset", dict.fromkeys(PRESETS)).find(observation)
        self._observation = OwnCode("observation", observation) if is_own(observation) else None
        twice = [name for name in options.sensors if options.sensors.count(name) > 1]
        if twice:
            raise InputError(f"The sensor {twice[0]} is named twice, and would draw the same errors. Leave one out.")
        self._sensors = {name: find_sensor(name) for name in options.sensors}
        self._termination = options.termination and OwnCode("termination rule", options.termination)
        self._act, self._blur = find_disturbance(options.disturbance)
        self._motion = OwnCode("law of motion", options.motion) if options.motion else None
        self._delay, self._history = options.observation_delay, options.history
        self._changes_observations = bool(self._observation or self._sensors or self._blur or self._history)
        self.is_used = self._changes_observations or bool(
            self._reward or self._termination or self._act or self._motion
        )
        """Whether anything is the user's own."""
        if parts is not None and self._changes_observations:
            raise InputError(
                "A dictionary of parts is observed as it is. Name sensors of your own in it, as module:Name, and leave "
                "out the options sensors, history and what disturbs observations."
            )
        self.failures: dict[int, str] = {}
        """Why something failed since the last decision began, by vehicle."""
        self.reward = options.reward if self._reward is None else base_of(self._reward, NOTHING, (NOTHING, *REWARDS))
        """The reward of aquanav's that is paid as well."""
        self.observation = observation if self._observation is None else base_of(self._observation, "full", PRESETS)
        """The preset in the vehicles' own arrays."""
        self.term_names: tuple[str, ...] = () if self.reward == NOTHING else TERMS
        self.arrays: dict[str, npt.NDArray[Any]] = {}
        """(N, ...) that stand for those of the same name in the batch."""

    @property
    def observation_delay(self) -> int:
        """Decisions by which the vehicles' own arrays are late; where more is observed, all of it is made late here."""
        return 0 if self._changes_observations else self._delay

    def law(self, dt: float) -> Callable[..., npt.NDArray[np.float64]] | None:
        """Return how vehicles move in a physics step of a duration, s, as `sim.batch.engine.MotionLaw`."""
        if self._motion is None:
            return None
        self._motion.without_batch(dt)
        return self._move

    def prepare(
        self,
        view: Callable[[Callable[[str], npt.NDArray[Any]]], BatchView],
        vehicles: VehicleArrays,
        base: spaces.Box,
        pairs: Sequence[tuple[Any, Any]],
        make_sensors: Callable[[], SensorBatch] | None,
    ) -> spaces.Box:
        """Return the space of observations.

        Args:
            view: Returns the view of arrays that a function reads by name.
            vehicles: Those of the batch.
            base: Space of the preset `observation`.
            pairs: Each scenario and its vehicle, for the sensors.
            make_sensors: Returns what aquanav's own sensors measure from; None where there are none.

        Raises:
            InputError: a sensor or an observation has no space of a fixed shape.
        """
        self._vehicles, self._read, self._write = vehicles, vehicles.as_numpy, vehicles.write
        self.view = view(self._shown)
        num = self.view.num
        from aquanav_tools.sim.batch.sensors.suite import SensorSuite

        built_in = {name: own for name, own in self._sensors.items() if not isinstance(own, OwnCode)}
        self._suite = SensorSuite(built_in) if built_in else None
        self._sensor_batch = make_sensors() if built_in and make_sensors is not None else None
        known = {} if self._suite is None else self._suite.common_spec(pairs).spaces
        self.arrays["last_commands"] = np.zeros((num, 3), dtype=np.float32)
        space = base if self._observation is None else box_of(self._observation, lambda own: own.space)
        parts: list[Any] = [space]
        for name, sensor in self._sensors.items():
            parts.append(common_box(sensor, pairs) if isinstance(sensor, OwnCode) else known[name])
        self._shapes = [part.shape for part in parts]
        if self._changes_observations:
            low, high = (np.concatenate([getattr(part, end).ravel() for part in parts]) for end in ("low", "high"))
            self.arrays["recent"] = np.zeros((num, max(self._ages), len(low)), dtype=np.float32)
            low, high = (np.tile(end.astype(np.float32), len(self._ages)) for end in (low, high))
            space = spaces.Box(low, high, dtype=np.float32)
            for name in ("observations", "final_observations"):
                self.arrays[name] = np.zeros((num, len(low)), dtype=np.float32)
        if self._reward is not None:
            self.arrays["terms"] = np.zeros((num, len(self.term_names)), dtype=self._read("terms").dtype)
        return space

    def begin(self) -> None:
        """Look at the episodes that have just begun, all of them."""
        if not self.is_used:
            return
        self.failures = {}
        self.arrays["last_commands"][:] = 0.0
        everyone = np.ones(self.view.num, dtype=np.bool_)
        if self._reward is not None:
            self._pay(np.zeros_like(everyone))
        self._look(everyone, everyone)

    def before(self) -> None:
        """Disturb the commands of the decision that is about to be carried out."""
        self.failures = {}
        if self._act is not None:
            commands = self._read("commands")
            acting = self._act.ask(self.view, check_commands, self.failures, commands.copy())
            if acting is not None:
                self._write("commands", acting)

    def judge(self) -> None:
        """End episodes, pay for the decision, and observe what it led to."""
        if not self.is_used:
            return
        is_moving = self._vehicles.has_moved
        if self._termination:
            self._end(is_moving)
        if self._reward is not None:
            self._pay(is_moving)
        begun = self._read("restarted") > 0
        self._look(is_moving | begun, begun)
        self.arrays["last_commands"][:] = np.where(is_moving[:, None], self._read("commands"), 0.0)

    def after(self) -> None:
        """Keep the last observations of episodes whose successors have begun in the same step, and look at these."""
        if not self.is_used:
            return
        begun = self._read("restarted") > 0
        self.arrays["last_commands"][begun] = 0.0
        if self._changes_observations and begun.any():
            self.arrays["final_observations"][begun] = self.arrays["observations"][begun]
            self._look(begun, begun, only_restarted=True)

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of the arrays."""
        remembered = {} if self._suite is None else self._suite.state()
        return remembered | {OWN_PREFIX + name: values.copy() for name, values in self.arrays.items()}

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Take back what `state` returned."""
        for name, values in self.arrays.items():
            taken = state[OWN_PREFIX + name]
            if values.shape != taken.shape:  # terms that have not been asked for their names yet
                self.arrays[name] = np.empty_like(taken)
            self.arrays[name][:] = taken
        if self._suite is not None:
            self._suite.restore(state)

    def close(self) -> None:
        """End the threads of sensors. Closing twice does nothing."""
        if self._sensor_batch is not None:
            self._sensor_batch.close()

    def _move(
        self,
        states: npt.NDArray[np.float64],
        commands: npt.NDArray[np.float64],
        currents: npt.NDArray[np.float64],
        rows: npt.NDArray[np.int64],
    ) -> npt.NDArray[np.float64]:
        """Return where the law leads; where it fails, vehicles stay where they are."""
        assert self._motion is not None
        failures: dict[int, str] = {}
        values = states.copy(), commands, currents.copy()
        moved = self._motion.ask(self.view.only(rows.tolist()), _check_states, failures, *values)
        moved = states if moved is None else moved
        is_left = np.zeros(len(rows), dtype=np.bool_)
        is_left[list(failures)] = True
        is_left |= np.linalg.norm(moved[:, :3] - states[:, :3], axis=1) > MAX_MOVE
        for row in np.flatnonzero(is_left).tolist():
            far = float(np.linalg.norm(moved[row, :3] - states[row, :3]))
            why = f"{self._motion.label} moved a vehicle by {far:.3g} m in one physics step, more than {MAX_MOVE:g} m."
            self.failures.setdefault(int(rows[row]), failures.get(row, why))
        return np.where(is_left[:, None], states, moved)

    def _shown(self, name: str) -> npt.NDArray[Any]:
        """Return an array for the view: the batch's own observations, not those that are made of them here."""
        return self.arrays[name] if name == "last_commands" else self._read(name)

    def _end(self, is_moving: Flags) -> None:
        assert self._termination
        flags = self._termination.ask(self.view, check_flags, self.failures)
        outcomes = self._read("outcomes").copy()
        ends = is_moving & (outcomes == 0) & (np.zeros_like(is_moving) if flags is None else flags)
        if ends.any():
            outcomes[ends] = ENDED
            for name in ("outcomes", "last_outcomes"):
                self._write(name, outcomes)
            self._write("terminated", self._read("terminated") | ends)

    def _pay(self, is_moving: Flags) -> None:
        """Add the reward's own terms to what is paid already."""
        assert self._reward is not None
        own = self._reward.ask(self.view, self._check_terms, self.failures)
        num_base = 0 if self.reward == NOTHING else len(TERMS)
        terms = np.zeros((self.view.num, len(self.term_names)), dtype=self._read("terms").dtype)
        if num_base:
            terms[:, :num_base] = self._read("terms")
        if own is not None:
            own[~is_moving] = 0.0
            terms[:, num_base:] = own
            paid = own.sum(axis=1)
            for name in ("rewards", "returns", "last_returns"):
                before = self._read(name)
                self._write(name, (before + paid).astype(before.dtype))
        if self.arrays["terms"].shape == terms.shape:
            self.arrays["terms"][:] = terms  # in place: others hold the array
        else:
            self.arrays["terms"] = terms

    def _check_terms(self, given: Any, num: int) -> npt.NDArray[Any]:
        """Return (num, U) terms; their names are those of the first answer."""
        if not isinstance(given, dict) or not given:
            raise WrongAnswerError(
                f"returned a {type(given).__name__}, and a dict of terms by their names is asked for"
            )
        names = tuple(given)
        base = () if self.reward == NOTHING else TERMS
        if len(self.term_names) == len(base):
            twice = sorted({str(name) for name in names} & set(base))
            if twice:
                raise WrongAnswerError(f"has a term '{twice[0]}', as the reward {self.reward} has beside it")
            self.term_names = base + names
        own = self.term_names[len(base) :]
        if set(names) != set(own):
            raise WrongAnswerError(f"returned the terms {', '.join(map(str, names))}, and before {', '.join(own)}")
        return np.stack([array_of(given[name], (num,), np.float64) for name in own], axis=1)

    def _look(self, rows: Flags, begins: Flags, only_restarted: bool = False) -> None:
        """Observe; `rows` of the arrays change, and in those that begin nothing waits yet."""
        if not self._changes_observations:
            return
        num, seen = self.view.num, self._read("observations")
        if self._observation is not None:
            seen = self._flat(self._observation, self._shapes[0])
        readings: dict[str, npt.NDArray[Any]] = {}
        if self._suite is not None and self._sensor_batch is not None:
            self._sensor_batch.only_restarted = only_restarted
            readings = self._suite.measure(self._sensor_batch)
        parts = [seen]
        for (name, own), shape in zip(self._sensors.items(), self._shapes[1:], strict=True):
            flat = self._flat(own, shape) if isinstance(own, OwnCode) else readings[name].reshape(num, -1)
            parts.append(flat)
        whole = np.concatenate(parts, axis=1)
        if self._blur is not None:
            check = partial(_check_floats, shape=whole.shape[1:])
            blurred = self._blur.ask(self.view, check, self.failures, whole.copy())
            whole = np.zeros_like(whole) if blurred is None else blurred
        assert whole.shape[0] == num
        self.arrays["observations"][rows] = self._remembered(whole, rows, begins)[rows]

    @property
    def _ages(self) -> list[int]:
        """How many decisions ago what is observed was measured, block by block."""
        return [self._delay + ago for ago in (0, *self._history)]

    def _remembered(self, whole: npt.NDArray[Any], rows: Flags, begins: Flags) -> npt.NDArray[Any]:
        """Return (N, B D) what the `rows` observe: what was measured before an episode began is what it begins with."""
        recent, depth = self.arrays["recent"], max(self._ages)
        seen = np.tile(whole, len(self._ages))
        if depth == 0:
            return seen
        recent[begins] = whole[begins, None]
        moving = np.flatnonzero(rows & ~begins)
        now, size = self._read("decisions")[moving], whole.shape[1]
        for block, age in enumerate(self._ages):
            if age:
                seen[moving, block * size : (block + 1) * size] = recent[moving, (now - age) % depth]
        recent[moving, now % depth] = whole[moving]
        return seen

    def _flat(self, own: OwnCode, shape: tuple[int, ...]) -> npt.NDArray[Any]:
        """Return (N, K) readings; zeros where there are none."""
        given = own.ask(self.view, partial(_check_floats, shape=shape), self.failures)
        blank = np.zeros((self.view.num, int(np.prod(shape))), dtype=np.float32)
        return blank if given is None else given.reshape(blank.shape)


def _check_floats(given: Any, num: int, shape: tuple[int, ...]) -> npt.NDArray[Any]:
    return array_of(given, (num, *shape), np.float32)


def _check_states(given: Any, num: int) -> npt.NDArray[Any]:
    states = array_of(given, (num, 13), np.float64)
    lengths = np.linalg.norm(states[:, 3:7], axis=1, keepdims=True)
    if (abs(lengths - 1.0) > 0.1).any():
        raise WrongAnswerError(f"returned a quaternion of length {lengths[abs(lengths - 1.0) > 0.1][0]:.3g}, not 1")
    states[:, 3:7] /= lengths
    return states
