"""What the oracle advises a whole batch: that it leads to the goal, and that it is what the oracle for one chooses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from aquanav_tools.envs.action import choices_of
from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.oracle import OraclePolicy
from aquanav_tools.scenario.schema import LimitSettings, Scenario
from tests.caves import tube_scenario
from tests.evaluate.winding import winding_scenario

NUM = 12


def batch_of(scenario: Scenario, num: int = NUM, **options: Any) -> CaveBatch:
    """Vehicles whose dives end where they touch a wall, begun from seeds 0, 1, ... ."""
    batch = CaveBatch(scenario, num, next_step=False, on_collision="end", **options)
    batch.reset(list(range(num)))
    return batch


def outcomes_of(batch: CaveBatch, decisions: int = 900) -> np.ndarray:
    """How each vehicle's first dive ends when it does as it is advised; 0 where it has not."""
    first = np.zeros(batch.num, dtype=int)
    for _ in range(decisions):
        batch.set_commands(batch.advice())
        batch.step()
        first = np.where(first == 0, batch.view_of("last_outcomes"), first)
        if first.all():
            break
    return first


@pytest.mark.parametrize("options", [{"action_delay": 2}, {"randomisation": "late"}])
def test_its_advice_leads_through_a_passage_that_winds(options: dict[str, Any]) -> None:
    assert (outcomes_of(batch_of(winding_scenario(), **options)) == 1).all()


def test_its_advice_is_what_the_oracle_for_one_chooses() -> None:
    """Their ways are found apart, as a tree and as a path, so that choices differ where a threshold is near."""
    scenario = winding_scenario()
    env, policy = CaveEnv(scenario), OraclePolicy()
    env.reset(seed=0, options={"start": 0})
    policy.bind(env)
    policy.reset(0)
    batch = CaveBatch(scenario, 1, next_step=False)
    batch.reset([0], [0])
    alike = []
    for _ in range(150):
        chosen = policy.act(np.zeros(0, dtype=np.float32))
        alike.append((choices_of(batch.advice()[0]) == chosen).mean())
        env.step(chosen)
        batch.command(chosen[None])
        batch.step()
        np.testing.assert_allclose(batch.view_of("positions")[0], env.state[:3], atol=1e-6)
    assert np.mean(alike) > 0.8
    env.close()


def test_asking_changes_nothing_and_every_vehicle_is_advised_for_itself() -> None:
    asked, silent = batch_of(winding_scenario()), batch_of(winding_scenario())
    for _ in range(30):
        advised = asked.advice().copy()
        np.testing.assert_array_equal(advised, asked.advice())
        for batch in (asked, silent):
            batch.set_commands(advised)
            batch.step()
    np.testing.assert_array_equal(asked.copy_of("positions"), silent.copy_of("positions"))
    few = batch_of(winding_scenario(), 3)
    for _ in range(30):
        few.set_commands(few.advice())
        few.step()
    np.testing.assert_array_equal(few.copy_of("positions"), asked.copy_of("positions")[:3])


def test_it_knows_the_way_in_a_cave_that_takes_the_place_of_another() -> None:
    short = tube_scenario(limits=LimitSettings(decisions=5))
    batch = CaveBatch([short, winding_scenario()], 2 * NUM, next_step=False, replaceable=True, on_collision="end")
    batch.reset(list(range(2 * NUM)))
    batch.advice()
    assert batch.replace(0, winding_scenario())
    for _ in range(5):  # until all episodes of the first have ended
        batch.set_commands(batch.advice())
        batch.step()
    assert set(batch.cave_of[:NUM].tolist()) == {2}
    assert (outcomes_of(batch)[:NUM] == 1).all()


def test_it_advises_alike_after_coming_back() -> None:
    batch = batch_of(winding_scenario(), 4)
    for _ in range(60):
        batch.set_commands(batch.advice())
        batch.step()
    kept = batch.state()
    expected = [batch.advice().copy()]
    batch.set_commands(expected[0])
    batch.step()
    other = batch_of(winding_scenario(), 4)
    other.restore(kept)
    assert {name for name in kept if name.startswith("oracle/")} <= set(other.state())
    np.testing.assert_array_equal(other.advice(), expected[0])


def test_it_knows_no_vehicle_of_another_model() -> None:
    with pytest.raises(InputError, match="of another model"):
        batch_of(winding_scenario(), 2, vehicle="original-auv").advice()
