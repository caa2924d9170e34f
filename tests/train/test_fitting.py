from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.train import training
from aquanav_tools.train.fitting import MIN_UPDATES, decisions_of, described, fitted, num_updates
from aquanav_tools.train.pipeline import read_pipeline
from aquanav_tools.train.settings import TrainSettings
from aquanav_tools.train.training import train
from tests.train.runs import tiny_pipeline, tiny_tube


@pytest.fixture(scope="module")
def tube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_tube(tmp_path_factory.mktemp("scenario") / "tube")


@pytest.fixture(autouse=True)
def no_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare a second for each run."""
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)


def rates(folder: Path) -> list[float]:
    """Return the learning rate of each update of a run."""
    with (folder / "curve.csv").open() as stream:
        return [float(row["train/learning_rate"]) for row in csv.DictReader(stream)]


def test_chosen_rollout_gives_enough_updates_and_ends_near_the_steps(rng: np.random.Generator) -> None:
    for _ in range(300):
        num_envs, steps = int(rng.integers(1, 600)), int(10 ** rng.uniform(1.0, 7.0))
        lesson = fitted(TrainSettings(steps=steps, num_envs=num_envs))
        least = np.lcm(num_envs, 16)
        assert lesson.rollout_size % lesson.batch == 0
        assert lesson.rollout_size <= max(20_480, least)
        assert num_updates(lesson) >= min(MIN_UPDATES, steps // least)
        # Whole updates: never less than was asked for, and never an update more.
        assert steps <= decisions_of(lesson) < steps + lesson.rollout_size


@pytest.mark.parametrize(
    ("steps", "learned", "updates"), [(100, 112, 7), (60_000, 60_000, 30), (300_000, 300_000, 30), (10**6, 10**6, 50)]
)
def test_a_short_run_learns_from_what_was_asked_for(steps: int, learned: int, updates: int) -> None:
    lesson = fitted(TrainSettings(steps=steps))
    assert (decisions_of(lesson), num_updates(lesson)) == (learned, updates)
    assert described(lesson).startswith(f"{learned:,} decisions") and f"in {updates} updates" in described(lesson)


def test_n_steps_that_are_given_are_kept_and_told_with_what_it_makes_of_the_steps() -> None:
    lesson = fitted(TrainSettings(steps=60_000, n_steps=2560, batch=1024))
    assert (lesson.n_steps, lesson.rollout_size, lesson.batch) == (2560, 20_480, 1024)
    said = described(lesson)
    assert (
        "61,440 decisions (60,000 were asked for) in 3 updates of 20,480 (2,560 of each environment: n_steps)" in said
    )
    assert "So few updates teach little" in said and "--n-steps 0" in said
    for shipped in read_pipeline("paper", {}).lessons:
        assert fitted(shipped) == TrainSettings(**{**vars(shipped), "learning_starts": 10_000})


def test_a_batch_that_is_given_divides_the_rollout() -> None:
    assert fitted(TrainSettings(steps=10_000, batch=48)).rollout_size % 48 == 0


def test_learning_of_a_short_run_starts_in_time(tube: Path, tmp_path: Path) -> None:
    settings = {
        "algorithm": "sac",
        "action": "continuous",
        "n_steps": 0,
        "batch": 0,
        "learning_starts": 0,
        "steps": 160,
    }
    pipeline = tiny_pipeline(tube, **settings)
    lesson = fitted(pipeline.lessons[0])
    assert lesson.learning_starts == 8 and "the first 8 are taken at random" in described(lesson)
    assert fitted(TrainSettings(algorithm="sac", action="continuous")).learning_starts == 10_000
    train(pipeline, 0, tmp_path)
    # 4 environments: 40 decisions each, so that the last is learned from at a fortieth of the rate.
    assert rates(tmp_path)[-1] == pytest.approx(3e-4 / 40)


@pytest.mark.parametrize("schedule", ["linear", "original"])
def test_learning_rate_falls_by_its_law(schedule: str, tube: Path, tmp_path: Path) -> None:
    train(tiny_pipeline(tube, steps=600, schedule=schedule), 0, tmp_path)
    if schedule == "linear":  # five updates, of 128 decisions each; each learns
        expected = [3e-4 * (1.0 - n / 5) for n in range(5)]
    else:  # ML-Agents' law: the decisions of an update count already, and beyond the last it is nothing
        expected = [3e-4 * max(0.0, 1.0 - 128 * (n + 1) / 600) for n in range(5)]
    assert rates(tmp_path) == pytest.approx(expected, abs=1e-12)
