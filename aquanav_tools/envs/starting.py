"""Where an episode begins: at one of the scenario's starts, or anywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from aquanav_tools.cave.route.shortest import ShortestPaths, shortest_paths
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.errors import InputError, MeshError, ScenarioError, did_you_mean
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.hull import hull_clearance
from aquanav_tools.task import TaskOptions, task_options
from aquanav_tools.types import Array, Capsule, IntArray, Pose, yaw_quaternion

CONDITIONS = ("sensor_noise", "sensor_dropout", "current_range")
"""Options of the task that an episode may have of its own: `reset(options={"sensor_noise": 0.1})`."""
RESET_OPTIONS = ("start", *CONDITIONS)
START_RULES = ("listed", "anywhere")
NUM_SEEDS = 1 << 32
"""An episode's seed is below this: all that it draws follows from it."""
NOWHERE_LISTED = -1
"""Index of a start that is not in the scenario's list."""
MARGIN = 0.1
"""Clearance of the hull at a start, m: more than the field's usual error."""
MIN_WAY = 2.0
"""Starts keep this way to the goal beyond its tolerance, m: a second at the original's speed."""
MAX_YAW_ERROR = float(np.deg2rad(45.0))
MAX_TRIES = 1000
NUM_DRAWN = 8
"""Starts anywhere that are drawn to see whether there are enough, each in a tenth of MAX_TRIES: where these are found,
hardly an episode tries in vain."""
EVERYWHERE = (0.0, 1.0)
"""Range of the way in which all starts are."""


class Starts:
    """Chooses the start of an episode."""

    def __init__(
        self, scenario: Scenario, capsule: Capsule, rule: str, start_range: tuple[float, float] = EVERYWHERE
    ) -> None:
        """Prepare the starts of a scenario for a vehicle's capsule.

        Args:
            scenario: Where they are.
            capsule: Of the vehicle.
            rule: One of START_RULES.
            start_range: As of the task's options.

        Raises:
            InputError: there is no such rule, or no listed start in the range.
        """
        check_choice("rule for starts", rule, START_RULES)
        self._scenario = scenario
        shares = [start.difficulty for start in scenario.starts]
        self.numbers = listed_numbers(scenario.name, shares, start_range) if rule == "listed" else None
        """Of the listed starts that may be drawn."""
        self._capsule = capsule
        self._paths: ShortestPaths | None = None
        if rule == "anywhere":
            goal = np.array(scenario.settings.goal.position, dtype=np.float64)
            self._paths = shortest_paths(scenario.field, goal, capsule.radius)
            lengths = self._paths.place_lengths
            near, far = np.array(start_range) * lengths.max(initial=0.0)
            enough = (lengths > scenario.settings.goal.tolerance + MIN_WAY) & (lengths >= near) & (lengths <= far)
            self._places = self._paths.places[enough]
            self._half_cell = 0.5 * self._paths.lengths.spacing

    def choose(self, rng: np.random.Generator, options: dict[str, Any]) -> tuple[Pose, int]:
        """Return a start pose and its index in the scenario's list, NOWHERE_LISTED for one drawn anywhere.

        Args:
            rng: What is drawn from, unless the options name a start.
            options: Of reset: {"start": index of one of the scenario's starts} or none; others are not looked at.

        Raises:
            InputError: there is no such start.
        """
        starts = self._scenario.starts
        if "start" in options:
            index = check_start(options["start"], len(starts))
        elif self._paths is not None:
            return self.draw(rng), NOWHERE_LISTED
        else:
            assert self.numbers is not None, "starts are drawn anywhere"
            index = int(self.numbers[rng.integers(len(self.numbers))])
        return starts[index].pose, index

    def way_to_goal(self, position: Array, index: int) -> float:
        """Return the length of the shortest way to the goal from a start that was chosen, m."""
        if self._paths is None or index != NOWHERE_LISTED:
            return self._scenario.starts[index].geodesic_to_goal
        return self._paths.remaining(position)

    def draw(self, rng: np.random.Generator, max_tries: int = MAX_TRIES) -> Pose:
        """Return a level pose, drawn evenly from the water, that heads down the way to the goal more or less.

        Raises:
            ScenarioError: there is hardly any water for the vehicle to begin in.
        """
        field, capsule, paths = self._scenario.field, self._capsule, self._paths
        assert paths is not None, "starts are listed"
        for _ in range(max_tries if len(self._places) else 0):
            jitter, turn = rng.uniform(-self._half_cell, self._half_cell, 3), rng.uniform(-MAX_YAW_ERROR, MAX_YAW_ERROR)
            position = self._places[rng.integers(len(self._places))] + jitter
            heading = _heading(paths, position, self._half_cell)
            if heading is None:  # straight up or down
                turn, heading = turn * np.pi / MAX_YAW_ERROR, 0.0
            pose = Pose(position, yaw_quaternion(heading + turn))
            state = np.concatenate([pose.position, pose.orientation])
            if hull_clearance(state, 0.5 * capsule.axis_length, capsule.radius, *field.grid) > MARGIN:
                return pose
        raise ScenarioError(
            f"No free start was found in {max_tries} tries in {self._scenario.name}: the cave is hardly wider than the "
            f"vehicle, or no place is {MIN_WAY:g} m away from the goal. Use the scenario's own starts, or a smaller "
            "vehicle."
        )


def can_begin_anywhere(scenario: Scenario, capsule: Capsule) -> bool:
    """Return whether starts of a hull can be drawn anywhere in the water, as lessons may ask for."""
    rng = np.random.default_rng(0)
    try:
        starts = Starts(scenario, capsule, "anywhere")
        for _ in range(NUM_DRAWN):
            starts.draw(rng, MAX_TRIES // 10)
    except (MeshError, ScenarioError):
        return False
    return True


def listed_numbers(name: str, shares: Sequence[float], start_range: tuple[float, float]) -> IntArray:
    """Return the numbers of the listed starts in a range of the way.

    Args:
        name: Of the scenario.
        shares: Of the longest way to the goal, ahead of each start.
        start_range: As of the task's options.

    Raises:
        InputError: there is none; the message says where they are.
    """
    if start_range == EVERYWHERE:
        return np.arange(len(shares))
    numbers = np.flatnonzero([start_range[0] <= share <= start_range[1] for share in shares])
    if len(shares) and not len(numbers):
        raise InputError(
            f"None of the {len(shares)} starts of {name} has {start_range[0]:g} to {start_range[1]:g} of the longest "
            f"way to the goal ahead: they have {min(shares):.2f} to {max(shares):.2f}. Choose another --start-range, "
            "or build the scenario anew: --starts.last-share 1 spreads starts over all of it."
        )
    return numbers


def _heading(paths: ShortestPaths, position: Array, step: float) -> float | None:
    """Return the horizontal direction, rad, in which the way to go falls; None where it falls up or down."""
    east, north, up = (
        paths.remaining(position - step * axis) - paths.remaining(position + step * axis) for axis in np.eye(3)
    )
    return float(np.arctan2(north, east)) if np.hypot(east, north) > 0.1 * abs(up) else None


def episode_task(task: TaskOptions, options: dict[str, Any]) -> TaskOptions:
    """Return the task's options for one episode, with what the options of reset change for it.

    Raises:
        InputError: reset has no option of a name, or a value makes no sense.
    """
    for name in options:
        if name not in RESET_OPTIONS:
            raise InputError(f"reset has no option '{name}'.{did_you_mean(str(name), RESET_OPTIONS)}")
    changed = {name: options[name] for name in CONDITIONS if name in options}
    return replace(task, **changed) if changed else task


def episode_conditions(options: dict[str, Any], num: int) -> dict[str, Any]:
    """Return what the options of reset change of the task, by name: (N,) values for `num` vehicles, (N, 2) of ranges.

    Raises:
        InputError: reset has no option of a name, or a value makes no sense.
    """
    conditions: dict[str, Any] = {}
    for name in options:
        if name not in RESET_OPTIONS:
            raise InputError(f"reset has no option '{name}'.{did_you_mean(str(name), RESET_OPTIONS)}")
        if name not in CONDITIONS:
            continue
        shape = (num, 2) if name == "current_range" else (num,)
        try:
            values = np.broadcast_to(np.asarray(options[name], dtype=np.float64), shape)
        except (TypeError, ValueError) as cause:
            what = "one range, or one for each vehicle" if len(shape) == 2 else "one number, or one for each vehicle"
            raise InputError(f"{name} of reset must be {what} ({num}), got {options[name]!r}.") from cause
        for value in np.unique(values, axis=0).tolist():
            task_options({name: tuple(value) if len(shape) == 2 else value})  # refuses what makes no sense
        conditions[name] = values
    return conditions


def check_start(start: Any, num_starts: int) -> int:
    """Return the number of a start; raise an InputError where there is none."""
    if not isinstance(start, int | np.integer) or not 0 <= start < num_starts:
        raise InputError(f"The start must be a number from 0 to {num_starts - 1}, got {start!r}.")
    return int(start)
