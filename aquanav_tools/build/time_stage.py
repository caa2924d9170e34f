"""How long episodes in a built cave may last, and whether that is enough to arrive."""

from __future__ import annotations

from typing import Any

from aquanav_tools.build.journal import Journal
from aquanav_tools.scenario.limits import ORIGINAL_DECISIONS
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.time_limit import decision_limit, ideal_time, longest_path
from aquanav_tools.sim.vehicle import parse_vehicle


def time_facts(scenario: Scenario) -> dict[str, Any]:
    """Return the limit of an episode and what the longest way takes at best, as plain values."""
    limits, vehicle = scenario.settings.limits, parse_vehicle(scenario.vehicle_toml, scenario.name)
    decisions = decision_limit(scenario, vehicle)
    best = ideal_time(scenario, vehicle)
    return {
        "decisions": decisions,
        "seconds": decisions * limits.dt * limits.substeps,
        "longest_path": longest_path(scenario),
        "longest_path_at_best": best(longest_path(scenario)),
        "top_speed": best.speed,
        "slowest_on_the_way": best.slowest,
    }


def note_time(scenario: Scenario, journal: Journal) -> None:
    """Warn where the vehicle cannot arrive in time; say so where a long way makes episodes longer than usual."""
    facts = time_facts(scenario)
    way, best, limit = facts["longest_path"], facts["longest_path_at_best"], facts["seconds"]
    if facts["slowest_on_the_way"] <= 0.0:
        journal.warn(
            "too-slow",
            f"The current is faster than the vehicle, which makes {facts['top_speed']:.2f} m/s: it cannot pass the "
            "fastest water on its way. Choose a faster vehicle with --vehicle, or a weaker --water.current.",
        )
    elif best > limit:
        journal.warn(
            "too-little-time",
            f"The way of {way:.0f} m takes {best:.0f} s at the vehicle's top speed of {facts['top_speed']:.2f} m/s, "
            f"and an episode ends after {limit:.0f} s ({facts['decisions']} decisions): no policy arrives from the far "
            "end. Leave out --decisions, so that the limit follows from the way, or choose a faster vehicle with "
            "--vehicle.",
        )
    elif facts["decisions"] > ORIGINAL_DECISIONS == scenario.settings.limits.decisions:
        journal.announce(
            f"The way of {way:.0f} m takes {best:.0f} s at top speed, so an episode has {facts['decisions']} decisions "
            f"({limit:.0f} s) instead of {ORIGINAL_DECISIONS}."
        )
