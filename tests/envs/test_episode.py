"""How a decision ends an episode."""

from __future__ import annotations

from typing import Any

from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.sim.batch.episode import Decision


def outcome(**changes: Any) -> str:
    return OUTCOMES[Decision(**{"max_decisions": 3, **changes}).judge()[0]]


def test_episode_succeeds_at_the_goal() -> None:
    assert outcome(is_at_goal=False) == "running"
    assert outcome(is_at_goal=True) == "success"


def test_episode_times_out_after_its_decisions() -> None:
    assert [outcome(decisions=n) for n in (1, 2, 3)] == ["running", "running", "timeout"]


def test_success_in_the_last_decision_counts() -> None:
    assert outcome(decisions=3, is_at_goal=True) == "success"


def test_contact_ends_the_episode_only_by_the_strict_rule() -> None:
    assert outcome(num_touched=3) == "running"
    assert outcome(num_touched=1, ends_on_collision=True) == "collision"
    assert outcome(ends_on_collision=True) == "running"


def test_contact_on_the_way_comes_before_the_goal() -> None:
    assert outcome(num_touched=1, ends_on_collision=True, is_at_goal=True) == "collision"
