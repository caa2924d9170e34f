"""Evaluations on the batched backend, against PyBullet's and against themselves."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate import batch_runner
from aquanav_tools.evaluate.evaluation import evaluate
from aquanav_tools.evaluate.journal import JOURNAL
from aquanav_tools.evaluate.network import NetworkPolicy
from aquanav_tools.evaluate.options import EvaluateOptions, Grid, ReplayOptions
from aquanav_tools.evaluate.policies import LoadedPolicy, load_policy
from aquanav_tools.evaluate.replaying import replay
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import LimitSettings, Scenario
from tests.bullet import needs_bullet
from tests.evaluate.models import make_model

EXACT = ("outcome", "start", "seed", "collisions", "region", "geodesic")
"""Columns in which both backends agree to the last digit where nothing is drawn."""
CLOSE = ("time", "path_length", "progress", "min_clearance", "energy", "reward", "control_effort", "jerk")
"""Both integrate with the same scheme; rays and clearance come from the field in one and from the mesh in the other."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, tube: Scenario) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "tube"
    settings = dataclasses.replace(tube.settings, limits=LimitSettings(decisions=300))
    write_scenario(dataclasses.replace(tube, settings=settings), path)
    return path


Run = Callable[..., Any]


@pytest.fixture
def run(folder: Path) -> Run:
    """Return a function that evaluates in this process and returns results.json."""

    def evaluate_here(
        policy: str, output: Path, load: Callable[[str], LoadedPolicy] = load_policy, **options: Any
    ) -> Any:
        choices = EvaluateOptions((policy,), (folder,), output, **({"record": "none", "backend": "batch"} | options))
        return json.loads(evaluate(choices, lambda done, total: None, load=load).results.read_text())

    return evaluate_here


@needs_bullet
def test_batch_comes_to_the_verdict_of_pybullet(run: Run, tmp_path: Path) -> None:
    batch = run("baseline:reactive", tmp_path / "batch", episodes=6)
    bullet = run("baseline:reactive", tmp_path / "bullet", episodes=6, backend="pybullet", workers=1)
    assert batch["protocol"].pop("backend") == "batch"
    assert bullet["protocol"].pop("backend") == "pybullet"
    assert batch["protocol"] == bullet["protocol"]
    for ours, theirs in zip(batch["episodes"], bullet["episodes"], strict=True):
        assert [ours[name] for name in EXACT] == [theirs[name] for name in EXACT]
        np.testing.assert_allclose([ours[name] for name in CLOSE], [theirs[name] for name in CLOSE], rtol=0.02)
    assert {episode["outcome"] for episode in batch["episodes"]} == {"success"}


def test_stopped_evaluation_goes_on_to_the_same_bytes_in_batches(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch_runner, "BATCH_SIZE", 2)
    options = {"episodes": 5, "grid": Grid(current=(0.0, 1.0)), "current": (0.2, 0.0, 0.0), "max_decisions": 40}
    output = tmp_path / "eval"
    run("baseline:random", output, **options)
    whole = (output / "results.json").read_bytes()
    lines = (output / JOURNAL).read_bytes().splitlines(keepends=True)
    (output / JOURNAL).write_bytes(b"".join([lines[0], lines[2], lines[7]]))  # one of a batch, and one of another
    run("baseline:random", output, resume=True, **options)
    assert (output / "results.json").read_bytes() == whole


def test_episode_of_a_batch_repeats_to_the_bit(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch_runner, "BATCH_SIZE", 3)
    run("baseline:reactive", tmp_path / "eval", episodes=4, record="failures", max_decisions=30)
    again = replay(ReplayOptions(tmp_path / "eval", 1, tmp_path / "again.rrd"))
    assert (again.episode.index, again.episode.outcome) == (1, "infeasible")  # 3 s are too few for the way
    assert (tmp_path / "again.rrd").stat().st_size > 10_000
    assert len(list((tmp_path / "eval").glob("episode-*.rrd"))) == 4


def test_oracle_of_a_batch_comes_through_whatever_runs_beside(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = {"episodes": 5, "current": (0.2, 0.0, 0.1), "randomisation": "late", "on_collision": "end"}
    together = run("baseline:oracle", tmp_path / "together", **options)
    assert [(episode["outcome"], episode["collisions"]) for episode in together["episodes"]] == [("success", 0)] * 5
    monkeypatch.setattr(batch_runner, "BATCH_SIZE", 2)
    run("baseline:oracle", tmp_path / "apart", **options)
    files = [(tmp_path / name / "results.json").read_bytes() for name in ("together", "apart")]
    assert files[0] == files[1]


def test_oracle_of_boats_runs_alone(tmp_path: Path) -> None:
    options = EvaluateOptions(("baseline:oracle",), (Path("bay-calm"),), tmp_path / "eval", backend="batch")
    with pytest.raises(InputError, match=r"looks at the map of a bay, .* Leave out --backend batch\."):
        evaluate(options, lambda done, total: None)


@pytest.mark.parametrize("size", [1, 3, 5])
def test_episodes_are_the_same_whatever_runs_beside_them(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    path = tmp_path / "policy.zip"
    make_model(PPO, net_arch=[33]).save(path)
    options = {"episodes": 5, "current": (0.2, 0.0, 0.1), "current_range": (0.0, 1.0), "max_decisions": 40}
    options |= {
        "sensor_noise": 0.05,
        "sensor_dropout": 0.1,
        "action_delay": 1,
        "observation_delay": 2,
        "starts": "anywhere",
    }
    together = run(str(path), tmp_path / "together", **options)["episodes"]
    monkeypatch.setattr(batch_runner, "BATCH_SIZE", size)
    assert run(str(path), tmp_path / "apart", **options)["episodes"] == together
    digests = {(episode["start"], episode["digest"]) for episode in together}
    assert len(digests) == 5


@pytest.mark.parametrize("kind", [PPO, RecurrentPPO])
def test_logits_of_many_are_those_of_each(kind: type[BaseAlgorithm], tmp_path: Path) -> None:
    path = tmp_path / "policy.zip"
    make_model(kind, net_arch=[16]).save(path)
    together, alone = NetworkPolicy(path), [NetworkPolicy(path) for _ in range(3)]
    seen = np.random.default_rng(3).uniform(-1.0, 1.0, (5, 3, 44)).astype(np.float32)
    for policy in (together, *alone):
        policy.reset(0)
    for rows in seen:
        np.testing.assert_allclose(
            together.logits(rows), [one.logits(row[None])[0] for one, row in zip(alone, rows, strict=True)], atol=1e-6
        )


def test_network_that_failed_on_all_goes_on_with_each_as_if_nothing_had_happened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "policy.zip"
    make_model(RecurrentPPO, net_arch=[16]).save(path)
    smooth, broken = NetworkPolicy(path), NetworkPolicy(path)
    outputs = broken._outputs

    def fail_for_many(observations: Any, places: Any) -> Any:
        found = outputs(observations, places)
        if len(places) > 1:
            raise MemoryError("too many")
        return found

    seen = np.random.default_rng(3).uniform(-1.0, 1.0, (5, 3, 44)).astype(np.float32)
    for number, rows in enumerate(seen):
        known = smooth.logits(rows)
        if number % 2:  # also at the first decision, and where places joined
            np.testing.assert_allclose(broken.logits(rows), known, atol=1e-6)
            continue
        monkeypatch.setattr(broken, "_outputs", fail_for_many)
        with pytest.raises(MemoryError):
            broken.logits(rows)
        alone = [broken.logits(rows[[place]], np.array([place]))[0] for place in (2, 0, 1)]
        monkeypatch.setattr(broken, "_outputs", outputs)
        np.testing.assert_allclose(alone, known[[2, 0, 1]], atol=1e-6)


class Fickle:
    """Thinks of all vehicles at once, and breaks down over the second one at its third decision."""

    def reset(self, seed: int) -> None:
        self._count = 0

    def logits(self, observations: Any, places: Any) -> Any:
        self._count += 1
        return places[:, None]

    def decide(self, logits: Any) -> Any:
        if self._count == 3 and logits[0] == 1:
            raise RuntimeError("a bad day")
        return np.array([1, 1, 2])

    def act(self, observation: Any) -> Any:
        raise AssertionError("a batch asks for all vehicles at once")


def test_failing_policy_costs_its_episode_only(run: Run, tmp_path: Path) -> None:
    def load(name: str) -> LoadedPolicy:
        return LoadedPolicy(Fickle(), name, None, "full", "multidiscrete")

    table = run("broken", tmp_path / "eval", load=load, episodes=3, max_decisions=6)
    outcomes = [(episode["outcome"], episode["reason"]) for episode in table["episodes"]]
    assert outcomes[1][0] == "failed"
    assert outcomes[1][1].startswith("RuntimeError: a bad day (test_batch_runner.py, line ")
    assert {outcomes[0], outcomes[2]} == {("infeasible", "")}


class Stumbling(Fickle):
    """Cannot think about the second vehicle from its third decision on, nor about any others together with it."""

    def __init__(self, stumble: Callable[[], Any]) -> None:
        self._stumble = stumble

    def logits(self, observations: Any, places: Any) -> Any:
        logits = super().logits(observations, places)
        return self._stumble() if self._count >= 3 and 1 in places else logits

    def decide(self, logits: Any) -> Any:
        return np.array([1, 1, 2])


def _fail() -> None:
    raise RuntimeError("a bad day")


@pytest.mark.parametrize(
    ("stumble", "reason"),
    [
        (_fail, f"RuntimeError: a bad day (test_batch_runner.py, line {_fail.__code__.co_firstlineno + 1})"),
        (lambda: np.zeros((0, 1)), "ValueError: it gave 0 rows of logits for 1 vehicles"),
        (lambda: time.sleep(3600.0), "gave no action within 2 s"),
    ],
)
def test_network_that_fails_costs_those_episodes_only(
    run: Run, tmp_path: Path, stumble: Callable[[], Any], reason: str
) -> None:
    def load(name: str) -> LoadedPolicy:
        return LoadedPolicy(Stumbling(stumble), name, None, "full", "multidiscrete")

    table = run("broken", tmp_path / "eval", load=load, episodes=3, max_decisions=6, action_time_limit=2.0)
    outcomes = [(episode["outcome"], episode["reason"]) for episode in table["episodes"]]
    assert outcomes == [("infeasible", ""), ("failed", reason), ("infeasible", "")]
    assert [round(episode["time"], 6) for episode in table["episodes"]] == [0.6, 0.2, 0.6]


@pytest.mark.parametrize(
    ("policy", "options", "message"),
    [
        ("shield:baseline:reactive", {}, "looks at its own vehicle or at the map"),
        ("baseline:random", {"workers": 2}, "Leave out --workers"),
    ],
)
def test_what_a_batch_cannot_run_is_refused_before_anything_runs(
    run: Run, tmp_path: Path, policy: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        run(policy, tmp_path / "eval", episodes=1, **options)
    assert not (tmp_path / "eval").exists()
