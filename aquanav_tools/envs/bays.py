"""Which bay an episode is in, and where in it the boat begins."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.starting import NOWHERE_LISTED, START_RULES, check_start
from aquanav_tools.errors import InputError, ScenarioError
from aquanav_tools.sea.generate import MAX_START_TURN, MapSettings, draw_map, generate_map
from aquanav_tools.sea.original import SUFFIX, read_original_map
from aquanav_tools.sea.outlines import to_outline
from aquanav_tools.sea.sea_map import Berth, Goal, SeaMap, ShortestPath, read_map
from aquanav_tools.sea.shortest import shortest_path
from aquanav_tools.types import Array

MAX_TRIES = 200


class Bays:
    """Chooses the bay and the berth of an episode."""

    def __init__(self, bay: SeaMap | MapSettings | int | str | Path | None, boat_width: float, rule: str) -> None:
        """Prepare a choice of bays.

        Args:
            bay: A fixed bay, by itself, its seed, or its file; or what the bays are like of which each episode draws
                another; None draws them by the usual settings.
            boat_width: Of the boat, for which bays are drawn, m.
            rule: One of START_RULES, for a fixed bay.

        Raises:
            InputError: the settings leave no room, or there is no such rule.
            ScenarioError: the file is no map.
        """
        check_choice("rule for starts", rule, START_RULES)
        usual = MapSettings(boat_width=boat_width)
        self._settings = bay if isinstance(bay, MapSettings) else usual
        self._room = self._settings.room
        self._is_anywhere = rule == "anywhere"
        self.fixed = _fixed_bay(bay, usual)
        """The bay of all episodes; None where each has another."""
        self.kind: SeaMap | MapSettings = self._settings if self.fixed is None else self.fixed
        """The same, or what bays are drawn by."""

    def choose(self, rng: np.random.Generator, options: dict[str, Any]) -> tuple[SeaMap, Berth, ShortestPath, int]:
        """Return a bay, the berth in it, the shortest way from there, and the berth's number, NOWHERE_LISTED if drawn.

        Args:
            rng: What is drawn from.
            options: Of reset: {"start": number of one of a fixed bay's berths} or none; others are not looked at.

        Raises:
            InputError: there is no such berth.
        """
        if self.fixed is None:
            if "start" in options:
                raise InputError("Each episode has another bay, so that no start has a number. Choose a fixed bay.")
            sea = draw_map(rng, self._settings)
            return sea, sea.starts[0], sea.paths[0], NOWHERE_LISTED
        sea = self.fixed
        if self._is_anywhere and "start" not in options:
            return sea, *self._draw(rng, sea), NOWHERE_LISTED
        count = len(sea.starts)
        number = check_start(options["start"], count) if "start" in options else int(rng.integers(count))
        return sea, sea.starts[number], sea.paths[number], number

    def _draw(self, rng: np.random.Generator, sea: SeaMap) -> tuple[Berth, ShortestPath]:
        """Return a berth drawn evenly from the water from which the goal can be reached, and the way from there."""
        for _ in range(MAX_TRIES):
            place = rng.uniform(sea.edge[:2], sea.edge[2:])
            turn = rng.uniform(-MAX_START_TURN, MAX_START_TURN)
            if sea.clearance_at(place) < self._room or distance_to(sea.goal, place) <= sea.goal.tolerance + self._room:
                continue
            path = shortest_path(sea.outlines, place, sea.goal, self._room)
            if path is not None:
                east, north = sea.goal.centre - place
                return Berth(place, float(np.arctan2(north, east) + turn)), path
        raise ScenarioError(
            f"No start was found in {MAX_TRIES} tries from which the goal of {sea.name} can be reached with "
            f"{self._room:.2f} m to either side. Take the bay's own starts, or a narrower boat."
        )


def distance_to(goal: Goal, place: Array) -> float:
    """Return the distance from a (2,) place to a goal's point, line or area, m; 0 inside the area."""
    if len(goal.corners) == 1:
        return float(np.hypot(*(goal.corners[0] - place[:2])))
    return max(float(to_outline(goal.corners, 0, len(goal.corners), float(place[0]), float(place[1]))), 0.0)


def _fixed_bay(bay: SeaMap | MapSettings | int | str | Path | None, settings: MapSettings) -> SeaMap | None:
    if isinstance(bay, SeaMap):
        return _usable(bay)
    if bay is None or isinstance(bay, MapSettings):
        return None
    if isinstance(bay, int | np.integer):
        return generate_map(int(bay), settings)
    path = Path(bay)
    is_original = path.with_name(path.stem + SUFFIX).exists()
    return _usable(read_original_map(path, settings.room) if is_original else read_map(path))


def _usable(sea: SeaMap) -> SeaMap:
    if not sea.starts or len(sea.paths) != len(sea.starts):
        raise ScenarioError(
            f"The bay {sea.name} has {len(sea.starts)} starts and {len(sea.paths)} shortest ways; it needs one way for "
            "each of one or more starts. Draw it with sea.generate, or read it with sea.original."
        )
    return sea
