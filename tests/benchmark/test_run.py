"""Running benchmarks in tubes: what comes out, and what does not depend on how it was run."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest
from PIL import Image

from aquanav_tools.benchmark import definition
from aquanav_tools.benchmark.definition import read_benchmark
from aquanav_tools.benchmark.leaderboard import make_leaderboard
from aquanav_tools.benchmark.options import BenchmarkOptions
from aquanav_tools.benchmark.run import BenchmarkRun, run_benchmark
from aquanav_tools.benchmark.submission import check_can_submit, read_submission, submission_of, write_submission
from aquanav_tools.benchmark.verify import VerificationError, verify
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.options import ReplayOptions, WorstOptions
from aquanav_tools.evaluate.replaying import replay
from aquanav_tools.evaluate.worst import show_worst
from aquanav_tools.policy.observed import OBSERVED, observed_table
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.sim.contacts import default_backend
from aquanav_tools.task import TaskOptions
from aquanav_tools.types import ignore_progress
from tests.caves import tube_scenario
from tests.evaluate.models import make_model

POLICY = "baseline:reactive"


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a benchmark of two tiers in three tubes."""
    folder = tmp_path_factory.mktemp("sets")
    for name in ("one", "two", "three"):
        write_scenario(tube_scenario(name=name), folder / name)
    (folder / "tubes.toml").write_text(
        f"""
        episodes = 2
        seed = 5
        [[tiers]]
        name = "easy"
        caves = [{{scenario = "{folder / "one"}"}}, {{scenario = "{folder / "two"}"}}]
        rules = {{current = "still"}}
        [[tiers]]
        name = "hard"
        caves = [{{scenario = "{folder / "three"}"}}]
        rules = {{randomisation = "wide", sensor_noise = 0.1, action_delay = 2}}
        """
    )
    return folder


@pytest.fixture(scope="module", autouse=True)
def shipped(sets: Path) -> object:
    """Let the benchmark be one that comes with aquanav."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(definition, "shipped_path", lambda folder, name: sets / f"{name}.toml")
        yield


def run(output: Path, **changes: object) -> BenchmarkRun:
    options = {"policy": POLICY, "benchmark": "tubes", "output": output, "workers": 1, **changes}
    return run_benchmark(BenchmarkOptions(**options), ignore_progress)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> BenchmarkRun:
    return run(tmp_path_factory.mktemp("run"))


@pytest.fixture
def submission(finished: BenchmarkRun, tmp_path: Path) -> Path:
    options = BenchmarkOptions(policy=POLICY, benchmark="tubes", submit="tubes")
    write_submission(submission_of(options, finished), tmp_path / "tubes.json")
    return tmp_path / "tubes.json"


def test_each_cave_is_dived_under_the_rules_of_its_tier(finished: BenchmarkRun) -> None:
    episodes = list(finished.episodes)
    assert [(one.scenario, one.condition, one.seed) for one in episodes] == [
        (name, tier, 5 + n) for name, tier in (("one", "easy"), ("two", "easy"), ("three", "hard")) for n in range(2)
    ]
    assert all(one.dynamics for one in episodes[4:]) and not any(one.dynamics for one in episodes[:4])
    # Two tubes alike, in still water, with the same seeds: the same dives.
    assert [one.digest for one in episodes[:2]] == [one.digest for one in episodes[2:4]]
    assert [tier.caves for tier in finished.score.tiers] == [2, 1]


def test_results_do_not_depend_on_workers_nor_on_a_stop(finished: BenchmarkRun, tmp_path: Path) -> None:
    run(tmp_path / "two", workers=2)
    run(tmp_path / "stopped")
    journal = tmp_path / "stopped" / "caves.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:2]) + lines[2][:100])  # killed in the middle of the second cave's line
    (tmp_path / "stopped" / "score.json").unlink()
    run(tmp_path / "stopped", resume=True)
    for name in ("score.json", "results.json"):
        expected = (finished.numbers.parent / name).read_bytes()
        assert (tmp_path / "two" / name).read_bytes() == expected
        assert (tmp_path / "stopped" / name).read_bytes() == expected


def test_an_episode_of_a_benchmark_is_replayed_alone(finished: BenchmarkRun, tmp_path: Path) -> None:
    found = replay(ReplayOptions(finished.numbers.parent, 5, tmp_path / "five.rrd"))
    assert found.episode.condition == "hard" and found.recording.stat().st_size > 1000


def test_the_worst_of_each_tier_are_shown(tmp_path: Path) -> None:
    finished = run(tmp_path / "random", policy="baseline:random")
    failed = {one.index for one in finished.episodes if not one.is_collision_free_success}
    found = show_worst(WorstOptions(tmp_path / "random", 1, seconds=0.5))
    shown = [one for rows in found.shown.values() for one in rows]
    assert {one.episode.condition for one in shown} == {"easy", "hard"}
    assert all(one.episode.index in failed and not one.difference for one in shown)
    for one in shown:
        assert one.film is not None and one.film.stat().st_size > 1000
        assert Image.open(one.still).size == (1600, 300)
    assert found.page.parent == tmp_path / "random" / "worst" and found.page.is_file()


def test_where_nothing_failed_there_is_nothing_to_look_at(finished: BenchmarkRun, tmp_path: Path) -> None:
    assert all(one.is_collision_free_success for one in finished.episodes)
    with pytest.raises(InputError, match="nothing to look at"):
        show_worst(WorstOptions(finished.numbers.parent, 1, tmp_path))


def test_other_policies_cannot_go_on_with_a_run(finished: BenchmarkRun) -> None:
    with pytest.raises(InputError, match="of another evaluation: policy"):
        run(finished.numbers.parent, policy="baseline:random", resume=True)


def test_a_submission_repeats_and_is_on_the_page(submission: Path, tmp_path: Path) -> None:
    found = verify(submission, None, 1, 0, ignore_progress)
    assert (found.identical, found.episodes, found.caves) == (6, 6, 3)
    assert "tubes holds: 6 of 6 dives" in found.text
    assert verify(submission, 1, 1, 0, ignore_progress).episodes == 2
    page = make_leaderboard(submission.parent, tmp_path / "page").read_text()
    assert "tubes" in page and "interquartile mean" in page
    assert "none: a program" in page


def change(path: Path, *keys: object, to: object) -> Path:
    table = json.loads(path.read_text())
    inner = table
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = to
    path.write_text(json.dumps(table))
    return path


@pytest.mark.parametrize(
    ("keys", "to", "message"),
    [
        (("mean",), 0.123, "tampered with: it says that the mean is 0.1230"),
        (("caves", 0, "episodes", 0, "collisions"), 1, "tampered with"),
        (("caves", 0, "episodes", 0, "seed"), 77, "are not the benchmark's"),
        (("caves", 0, "episodes", 0, "outcome"), "victory", "has an episode that is none"),
        (("caves", 0, "episodes"), [], "are not the benchmark's"),
        (("caves",), [], "does not have the caves of tubes: 3 are missing"),
        (("benchmark_sha256",), "0" * 64, "is of another tubes"),
        (("policy", "spec"), "file", "carries no policy"),
        (("policy", "content"), "!", "cannot be decoded"),
        (("format",), 99, "no submission of format 1"),
        (("caves", 0, "nonsense"), 1, "unknown key 'nonsense'"),
    ],
)
def test_a_changed_submission_is_refused(submission: Path, keys: tuple[object, ...], to: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_submission(change(submission, *keys, to=to))


def test_dives_that_never_were_are_found_out(submission: Path) -> None:
    """A file that agrees with itself, but not with the dives."""
    found = read_submission(submission)
    first = found.caves[0]
    invented = tuple(dataclasses.replace(one, digest="0" * 64, time=1.0) for one in first.episodes)
    caves = (dataclasses.replace(first, episodes=invented), *found.caves[1:])
    write_submission(dataclasses.replace(found, caves=caves), submission)
    with pytest.raises(VerificationError, match=r"4 of 6 dives repeat to the bit.*episode 0 in one"):
        verify(submission, None, 1, 0, ignore_progress)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"policy": "own:make"}, "code of your own"),
        ({"submit": "../up"}, "choose a name of letters"),
        ({"benchmark": "mine.toml"}, "caves that others do not have"),
    ],
)
def test_what_nobody_could_check_is_not_submitted(changes: dict[str, str], message: str) -> None:
    options = {"policy": POLICY, "benchmark": "tubes", "submit": "name", **changes}
    with pytest.raises(InputError, match=message):
        check_can_submit(BenchmarkOptions(**options))  # type: ignore[arg-type]


def test_the_oracle_knows_the_map_one_by_one_and_in_a_batch(tmp_path: Path) -> None:
    for backend in ("batch", default_backend()):
        folder = tmp_path / backend
        assert run(folder, policy="baseline:oracle", backend=backend).score.tiers[0].mean.mean == 1.0


def test_a_shield_does_not_run_in_a_batch(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"--backend {default_backend()}"):
        run(tmp_path, policy="shield:baseline:reactive")


def test_policies_for_boats_do_not_dive(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="made for the surface task"):
        run(tmp_path, policy="baseline:boat-safe")


def test_caves_of_ones_own_are_a_tier_apart(sets: Path, tmp_path: Path) -> None:
    benchmark = read_benchmark("tubes+real", [sets / "one-again"])
    assert [tier.name for tier in benchmark.tiers] == ["easy", "hard", "real caves"]
    with pytest.raises(InputError, match=r"whose name ends in \+real"):
        read_benchmark("tubes", [sets / "one"])


def test_a_cave_that_is_not_the_published_one_is_told(sets: Path, tmp_path: Path) -> None:
    path = tmp_path / "changed.toml"
    path.write_text(
        f'episodes = 1\nseed = 0\n[[tiers]]\nname = "t"\ncaves = [{{scenario = "{sets / "one"}", sha256 = "0"}}]\n'
    )
    assert run(tmp_path / "out", benchmark=str(path)).changed_caves == (str(sets / "one"),)


def test_a_policy_that_observes_what_no_vehicle_can_measure_is_not_scored(tmp_path: Path) -> None:
    model = make_model(num_observations=48)
    setattr(model, OBSERVED, observed_table("full", TaskOptions(sensors=("route",))))
    model.save(tmp_path / "cheat.zip")
    with pytest.raises(InputError, match=r"cheat.* observes route, which no vehicle can measure"):
        run(tmp_path / "run", policy=str(tmp_path / "cheat.zip"))
    setattr(model, OBSERVED, observed_table("full", TaskOptions(sensors=("waypoint",))))
    model.save(tmp_path / "fair.zip")
    assert run(tmp_path / "fair", policy=str(tmp_path / "fair.zip")).score.total.caves == 3
