"""The planner leaves a policy alone that comes to new places, and leads one out that does not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from aquanav_tools.envs.observation import layout
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.planner import ECHO_SOUNDERS, SHOWN, STUCK, PlannedPolicy
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.policy_kinds import BatchPrivileged, PrivilegedPolicy, Vectorised
from aquanav_tools.evaluate.wrappers import inner_of
from aquanav_tools.sim.scales import DISTANCE_SCALE, SPEED_SCALE, soft, unsoft
from tests.evaluate.models import make_model

SECONDS = 0.1
PARTS = layout("full")
GOAL = slice(*PARTS["goal"].indices(44)[:2])


class Watching:
    """Hands on what it is shown."""

    def reset(self, seed: int) -> None:
        """Forget nothing: there is nothing."""

    def act(self, observation: Any) -> Any:
        raise AssertionError("logits are asked for")

    def logits(self, observations: npt.NDArray[np.float32], slots: Any) -> npt.NDArray[np.float32]:
        return observations

    def decide(self, logits: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        return logits


class Decisions:
    decision_seconds = SECONDS


def planned() -> PlannedPolicy:
    policy = PlannedPolicy(Watching(), (ECHO_SOUNDERS,))
    policy.bind(Decisions())
    policy.reset(0)
    return policy


def observation(to_goal: float, speed: float = 0.0, ahead: float = 0.2) -> npt.NDArray[np.float32]:
    """Return what is seen on an even keel with the goal ahead: walls all around but astern, at a share of the rays."""
    seen = np.zeros(60, dtype=np.float32)
    seen[PARTS["rays"]] = ahead
    seen[GOAL] = soft(to_goal, DISTANCE_SCALE), 0.0, 0.0
    seen[PARTS["velocity"]] = soft(speed, SPEED_SCALE), 0.0, 0.0
    seen[44:] = 4.0 * ahead
    seen[44 + 7] = 4.0  # straight astern
    return seen


def test_policy_that_comes_to_new_places_sees_its_goal() -> None:
    policy = planned()
    for n in range(200):
        row = observation(40.0 - 0.1 * n, speed=1.0, ahead=1.0)
        np.testing.assert_array_equal(policy.act(row), row)


def test_policy_that_stays_in_a_dead_end_is_shown_the_way_out_of_it() -> None:
    policy, row = planned(), observation(9.0)
    shown = [policy.act(row + np.float32(1e-6 * n)) for n in range(int(STUCK / SECONDS) + 30)]
    np.testing.assert_allclose(shown[int(STUCK / SECONDS) - 5][GOAL], row[GOAL], atol=1e-4)
    distance, azimuth, _ = shown[-1][GOAL]
    assert unsoft(distance, DISTANCE_SCALE) == pytest.approx(SHOWN, rel=1e-5)
    assert abs(azimuth) > 0.4  # more than 72 degrees off the bow, where the goal is
    rest = np.ones(60, dtype=bool)
    rest[GOAL] = False
    np.testing.assert_allclose(shown[-1][rest], row[rest], atol=1e-3)


def test_vehicles_side_by_side_are_led_as_each_alone() -> None:
    rows = [observation(9.0), observation(20.0, ahead=0.3)]
    both, alone = planned(), [planned(), planned()]
    for n in range(int(STUCK / SECONDS) + 20):
        seen = np.stack(rows) + np.float32(1e-6 * n)
        together = both.logits(seen, np.array([0, 1]))
        for row, led, policy in zip(seen, together, alone, strict=True):
            np.testing.assert_array_equal(policy.act(row), led)


def test_asked_twice_about_the_same_decision_it_says_the_same_and_counts_it_once() -> None:
    once, twice = planned(), planned()
    for n in range(int(STUCK / SECONDS) + 20):
        row = observation(9.0) + np.float32(1e-6 * n)
        np.testing.assert_array_equal(once.act(row), twice.act(row))
        np.testing.assert_array_equal(twice.act(row), twice.act(row))


def test_an_episode_begins_without_the_last_ones_walls() -> None:
    policy, row = planned(), observation(9.0)
    for n in range(int(STUCK / SECONDS) + 5):
        policy.act(row + np.float32(1e-6 * n))
    policy.reset(1)
    np.testing.assert_array_equal(policy.act(row), row)


def test_it_goes_around_a_shipped_network_in_a_batch_and_alone() -> None:
    loaded = load_policy("planner:baseline:reference-echosounders")
    assert loaded.name == "planner:baseline:reference-echosounders"
    assert loaded.sha256 == load_policy("baseline:reference-echosounders").sha256
    assert loaded.observed is not None and loaded.observed.sensors == (ECHO_SOUNDERS,)
    assert isinstance(loaded.policy, Vectorised)
    assert isinstance(loaded.policy, PrivilegedPolicy) and isinstance(loaded.policy, BatchPrivileged)


@pytest.mark.parametrize(
    ("spec", "reason"),
    [
        ("planner:baseline:reactive", "is a program"),
        ("planner:baseline:oracle", "is a program"),
        ("planner:baseline:boat-standard", "another one|steers a boat"),
    ],
)
def test_what_it_cannot_lead_is_refused_with_a_sentence(spec: str, reason: str) -> None:
    with pytest.raises(InputError, match=rf"({reason}).*Leave out planner:\."):
        load_policy(spec)


def test_earlier_decisions_that_options_name_are_refused_as_those_that_a_file_says(tmp_path: Path) -> None:
    path = tmp_path / "policy.zip"
    make_model(num_observations=88).save(path)
    with pytest.raises(InputError, match=r"observes earlier decisions.*Leave out planner:\."):
        load_policy(f"planner:{path}", history=(1,))


def test_a_shield_goes_around_a_planner_and_the_name_within_is_found() -> None:
    spec = "shield:planner:baseline:reference-echosounders"
    assert load_policy(spec).name == spec
    assert inner_of(spec) == "baseline:reference-echosounders"


def test_policy_on_paper_observations_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "paper.zip"
    make_model(num_observations=31).save(path)
    with pytest.raises(InputError, match=r"reads the preset 'full'.*Leave out planner:\."):
        load_policy(f"planner:{path}")
