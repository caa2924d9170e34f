"""How a decision ends an episode."""

from __future__ import annotations

from typing import Any

from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.sim.batch.episode import Decision


def outcome(**changes: Any) -> str:
    return OUTCOMES[Decision(**{"tolerance": 0.5, "max_decisions": 3, **changes}).judge()[0]]


def test_episode_succeeds_within_the_tolerance() -> None:
    assert outcome(remaining=0.51) == "running"
    assert outcome(remaining=0.5) == "success"


def test_episode_times_out_after_its_decisions() -> None:
    assert [outcome(decisions=n) for n in (1, 2, 3)] == ["running", "running", "timeout"]


def test_success_in_the_last_decision_counts() -> None:
    assert outcome(decisions=3, remaining=0.1) == "success"


def test_contact_ends_the_episode_only_by_the_strict_rule() -> None:
    assert outcome(num_touched=3) == "running"
    assert outcome(num_touched=1, ends_on_collision=True) == "collision"
    assert outcome(ends_on_collision=True) == "running"


def test_contact_on_the_way_comes_before_the_goal() -> None:
    assert outcome(num_touched=1, ends_on_collision=True, remaining=0.0) == "collision"
