from __future__ import annotations

from aquanav_tools.envs.episode import Episode, EpisodeRules

RULES = EpisodeRules(tolerance=0.5, max_decisions=3, ends_on_collision=False)
STRICT = EpisodeRules(tolerance=0.5, max_decisions=3, ends_on_collision=True)
FREE, TOUCH = [False] * 5, [False, True, False, True, True]


def test_episode_succeeds_within_the_tolerance() -> None:
    assert Episode(RULES).advance(FREE, 0.51) == "running"
    assert Episode(RULES).advance(FREE, 0.5) == "success"


def test_episode_times_out_after_its_decisions() -> None:
    episode = Episode(RULES)
    assert [episode.advance(FREE, 9.0) for _ in range(3)] == ["running", "running", "timeout"]


def test_success_in_the_last_decision_counts() -> None:
    episode = Episode(RULES)
    assert [episode.advance(FREE, left) for left in (9.0, 5.0, 0.1)][-1] == "success"


def test_contact_ends_the_episode_only_by_the_strict_rule() -> None:
    assert Episode(RULES).advance(TOUCH, 9.0) == "running"
    assert Episode(STRICT).advance(TOUCH, 9.0) == "collision"


def test_contact_on_the_way_comes_before_the_goal() -> None:
    assert Episode(STRICT).advance(TOUCH, 0.0) == "collision"


def test_lasting_contact_counts_once_and_again_after_a_free_decision() -> None:
    episode = Episode(EpisodeRules(0.5, 100, False))
    for touched in (TOUCH, TOUCH, FREE, TOUCH, FREE, FREE):
        episode.advance(touched, 9.0)
    assert episode.num_collisions == 2
