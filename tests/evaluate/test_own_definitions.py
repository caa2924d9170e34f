"""The user's own code in evaluation: where it fails, what files cannot make run, and what a policy was trained with."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import aquanav
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.evaluation import Evaluation
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.sim.contacts import default_backend
from tests.caves import tube_scenario
from tests.own_modules import WriteModule, own_module

__all__ = ["own_module"]

CODE = """
class Odd:
    base = "careful"

    def terms(self, batch):
        if ((batch.seeds % 2 == 1) & (batch.decisions > 5)).any():
            raise RuntimeError("odd")
        return {"none": 0.0 * batch.clearances}

class Fine(Odd):
    def terms(self, batch):
        return {"none": 0.0 * batch.clearances}

class Height:
    def spec(self, scenario, vehicle):
        return Box(-np.inf, np.inf, (1,))

    def measure(self, batch):
        return batch.positions[:, 2:]

class Nowhere(Height):
    def measure(self, batch):
        return batch.positions[:, 2:] * np.where(batch.seeds == 1, np.nan, 1.0)[:, None]
"""


def ahead(observation: Any) -> list[int]:
    return [1, 1, 2]


@pytest.fixture
def cave(tmp_path: Path) -> Path:
    write_scenario(tube_scenario(), tmp_path / "tube")
    return tmp_path / "tube"


BACKENDS = (default_backend(), "batch")


def score(cave: Path, output: str, backend: str = "batch", **options: Any) -> Evaluation:
    given = {"episodes": 4, "max_decisions": 20, "record": "none", "backend": backend, **options}
    return aquanav.evaluate(ahead, cave, output=output, **given)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_reward_that_fails_costs_the_episodes_it_fails_in(cave: Path, own_module: WriteModule, backend: str) -> None:
    own = own_module(CODE)
    plain, odd = score(cave, "plain", backend), score(cave, "odd", backend, reward=f"{own}:Odd")
    for before, now in zip(plain.episodes, odd.episodes, strict=True):
        if now.seed % 2:
            assert now.outcome == "failed"
            assert now.reason == (
                f"The reward {own}:Odd raised RuntimeError: odd ({own}.py, line 10), after 6 decisions of the episode."
            )
        else:
            assert (now.outcome, now.path_length, now.reward) == (before.outcome, before.path_length, before.reward)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_reward_and_a_sensor_that_fail_in_bays_cost_the_same_episodes(own_module: WriteModule, backend: str) -> None:
    own = own_module(CODE)
    given: dict[str, Any] = {"episodes": 4, "max_decisions": 20, "record": "none", "backend": backend}
    more: list[dict[str, Any]] = [{}, {"reward": f"{own}:Odd"}, {"sensors": (f"{own}:Nowhere",)}]
    plain, odd, nowhere = (
        aquanav.evaluate(lambda seen: [1, 2], "bay-calm", output=f"{n}", **given, **options)
        for n, options in enumerate(more)
    )
    for before, now, unseen in zip(plain.episodes, odd.episodes, nowhere.episodes, strict=True):
        assert (now.outcome == "failed") == (now.seed % 2 == 1) and (unseen.outcome == "failed") == (now.seed == 1)
        if now.outcome == "failed":
            assert now.reason.startswith(f"The reward {own}:Odd raised RuntimeError: odd ({own}.py, line 10), after 6 ")
        else:
            assert (now.outcome, now.path_length, now.reward) == (before.outcome, before.path_length, before.reward)
        if unseen.outcome == "failed":
            assert "returned [nan], which is not finite, after 0 decisions" in unseen.reason


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_sensor_that_fails_at_the_beginning_costs_its_episode(
    cave: Path, own_module: WriteModule, backend: str
) -> None:
    own = own_module(CODE)
    found = score(cave, "out", backend, sensors=(f"{own}:Nowhere",)).episodes
    assert [episode.outcome == "failed" for episode in found] == [episode.seed == 1 for episode in found]
    assert "returned [nan], which is not finite, after 0 decisions" in next(one.reason for one in found if one.reason)


@pytest.mark.parametrize("backend", BACKENDS)
def test_results_that_name_code_are_replayed_only_if_trusted(cave: Path, own_module: WriteModule, backend: str) -> None:
    own = own_module(CODE)
    score(cave, "out", backend, reward=f"{own}:Fine", sensors=(f"{own}:Height",))
    with pytest.raises(InputError, match=rf"results.json names code: {own}:Fine, {own}:Height. A file runs none by "):
        aquanav.replay("out", 1, policy=ahead)
    assert aquanav.replay("out", 1, policy=ahead, trust=True).episode.index == 1


def test_code_that_results_name_is_not_even_imported(cave: Path, own_module: WriteModule, tmp_path: Path) -> None:
    own = own_module("open('imported', 'w')")
    score(cave, "out")
    path = tmp_path / "out" / "results.json"
    table = json.loads(path.read_text())
    table["protocol"]["termination"] = f"{own}:rule"
    path.write_text(json.dumps(table))
    with pytest.raises(InputError, match="names code"):
        aquanav.replay("out", 1, policy=ahead)
    assert not (tmp_path / "imported").exists()


def test_a_protocol_that_names_code_is_taken_only_if_trusted(cave: Path, own_module: WriteModule) -> None:
    own = own_module(CODE)
    Path("rules.toml").write_text(f'reward = "{own}:Fine"\n')
    with pytest.raises(InputError, match=rf"rules.toml names code: {own}:Fine. .* add --trust; or name the code as "):
        score(cave, "out", protocol="rules.toml")
    trusted = score(cave, "out", protocol="rules.toml", trust=True)
    assert json.loads(trusted.results.read_text())["protocol"]["reward"] == f"{own}:Fine"


def test_a_policy_is_evaluated_with_the_sensor_that_it_learned_with(cave: Path, own_module: WriteModule) -> None:
    own = own_module(CODE)
    sensors = (f"{own}:Height",)
    aquanav.train(cave, steps=64, num_envs=2, n_steps=32, batch=32, hidden=(8,), final_episodes=0, backend="batch",
                  sensors=sensors, output="run")  # fmt: skip
    options: dict[str, Any] = {"episodes": 2, "max_decisions": 5, "record": "none", "backend": "batch"}
    with pytest.raises(InputError, match=rf"name that: .* run says that it was .* --sensors {own}:Height."):
        aquanav.evaluate("run", cave, output="out", **options)
    with pytest.raises(InputError, match="takes 45 values, and there are 46 of the observation full with the sensors"):
        aquanav.evaluate("run", cave, output="out", sensors=(*sensors, "depth"), **options)
    assert len(aquanav.evaluate("run", cave, output="out", sensors=sensors, **options).episodes) == 2
