"""The functions do what the commands do, and take what is in memory as well."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import aquanav
from aquanav_tools.cli.evaluate import main as evaluate_command
from aquanav_tools.cli.train import main as train_command
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.folder import write_scenario
from tests.caves import TUBE_LENGTH, tube_scenario
from tests.commands import run_here

RULES: dict[str, Any] = {"episodes": 2, "max_decisions": 20, "record": "none"}


@pytest.fixture(scope="module")
def tube_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("api") / "tube"
    write_scenario(tube_scenario(), folder)
    return folder


def flags(rules: dict[str, Any]) -> list[str]:
    return [word for name, value in rules.items() for word in (f"--{name.replace('_', '-')}", str(value))]


def ahead(observation: np.ndarray) -> list[int]:
    return [1, 1, 2]


def test_evaluate_leaves_the_bytes_that_the_command_leaves(tube_folder: Path, tmp_path: Path) -> None:
    found = aquanav.evaluate("baseline:random", tube_folder, output=tmp_path / "api", **RULES)
    done = run_here(
        evaluate_command, "baseline:random", "--scenario", tube_folder, "-o", tmp_path / "cli", *flags(RULES)
    )
    assert done.returncode == 0, done.stderr
    assert found.results.read_bytes() == (tmp_path / "cli" / "results.json").read_bytes()
    assert found.summary.episodes == len(found.episodes) == 2


def test_train_leaves_the_policy_that_the_command_leaves(tube_folder: Path, tmp_path: Path) -> None:
    settings: dict[str, Any] = {"steps": 64, "num_envs": 2, "final_episodes": 0}
    trained = aquanav.train(tube_folder, output=tmp_path / "api", **settings)
    done = run_here(train_command, "--scenario", tube_folder, "-o", tmp_path / "cli", *flags(settings))
    assert done.returncode == 0, done.stderr
    one, two = ((tmp_path / name / "policy.onnx").read_bytes() for name in ("api", "cli"))
    assert one == two and len(one) > 100_000  # 3 layers of 128 by 128 weights, 4 bytes each
    assert trained.point.steps >= 64 and not trained.was_finished
    assert aquanav.train(tube_folder, output=tmp_path / "api", **settings).was_finished


def test_a_scenario_in_memory_is_learned_in(tube_folder: Path, tmp_path: Path) -> None:
    cave = aquanav.load_scenario(tube_folder)
    assert np.ptp(cave.cavity.mesh.vertices[:, 0]) == pytest.approx(TUBE_LENGTH)
    trained = aquanav.train(cave, steps=64, num_envs=2, final_episodes=0, output=tmp_path / "run")
    assert trained.point.steps >= 64 and (tmp_path / "run" / "policy.zip").is_file()


def test_a_function_is_scored_and_repeats(tube_folder: Path, tmp_path: Path) -> None:
    found = aquanav.evaluate(ahead, tube_folder, output=tmp_path, **RULES)
    assert found.episodes[0].path_length > 0.5 and found.episodes[0].control_effort > 0.3
    again = aquanav.replay(tmp_path, 1, policy=ahead, track=tmp_path / "track.csv")
    assert again.track is not None
    *_, last = again.track.read_text(encoding="utf-8").splitlines()
    assert float(last.partition(",")[0]) == pytest.approx(again.episode.time)
    assert again.episode == found.episodes[1] and again.recording.is_file() and again.film is None
    with pytest.raises(InputError, match="ahead"):
        aquanav.replay(tmp_path, 1)  # it is no file that could be loaded again


def test_options_win_over_the_protocol(tube_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("episodes = 3\nmax_decisions = 7\n")
    found = aquanav.evaluate(
        "baseline:random", tube_folder, protocol=tmp_path / "mine.toml", episodes=1, record="none", output=tmp_path
    )
    assert found.summary.episodes == 1 and found.episodes[0].time == pytest.approx(0.7)


def test_compare_gives_the_difference_of_two_policies(tube_folder: Path, tmp_path: Path) -> None:
    for name, policy in (("ahead", ahead), ("random", "baseline:random")):
        aquanav.evaluate(policy, tube_folder, output=tmp_path / name, **RULES)
    found = aquanav.compare(tmp_path / "ahead", tmp_path / "random", output=tmp_path / "both")
    (pair,) = found.comparisons
    first, second = (method.summary.means["time"].mean for method in found.methods)
    assert pair.num_pairs == 2 and pair.differences["time"].mean == pytest.approx(first - second)
    assert found.numbers.is_file() and found.report.is_file()


@pytest.mark.parametrize("kind", ["gymnasium", "sb3"])
def test_a_vector_environment_of_either_kind_has_a_row_per_vehicle(tube_folder: Path, kind: Any) -> None:
    envs: Any = aquanav.make_vec_env([tube_folder, tube_folder], 4, kind=kind, observation="paper")
    observations = envs.reset(seed=0)[0] if kind == "gymnasium" else envs.reset()
    assert observations.shape == (4, 31)
    assert np.shape(envs.step(np.tile([1, 1, 2], (4, 1)))[1]) == (4,)
    envs.close()


def test_an_environment_takes_another_vehicle_and_the_rules_of_the_task(tube_folder: Path) -> None:
    env: Any = aquanav.make_env(tube_folder, vehicle="bluerov2-heavy", reward="sparse", action="continuous")
    assert env.vehicle.name != aquanav.make_env(tube_folder).vehicle.name and env.task.reward == "sparse"
    observation, _ = env.reset(seed=0)
    assert observation.shape == (44,) and env.action_space.shape == (3,)


def test_an_environment_with_an_unknown_option_names_the_nearest(tube_folder: Path) -> None:
    with pytest.raises(InputError, match="Did you mean 'sensor_noise'"):
        aquanav.make_env(tube_folder, sensor_nois=0.1)
