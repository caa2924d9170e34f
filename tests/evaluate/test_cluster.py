"""Evaluations on a Ray cluster of two nodes: the same results, whatever is killed on the way."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from aquanav_tools.errors import AquanavError, InputError, ResourceError
from aquanav_tools.evaluate.cluster import check_found, clear_left, code_here
from aquanav_tools.evaluate.episode_worker import EvaluationSpec, make_plan
from aquanav_tools.evaluate.evaluation import evaluate
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.store import locked
from aquanav_tools.workers import ray_cluster
from aquanav_tools.workers.ray_cluster import MakeAsAtHome, as_own_error
from tests.clusters import two_nodes
from tests.evaluate.policies import ONCE, PROCESSES, TROUBLE, drifting_options, load_drifting
from tests.evaluate.test_episode_runner import BAD, NUM_EPISODES, REASONS, assert_same_files
from tests.lighter import lighten_reports

Run = Callable[..., list[tuple[int, int]]]


@pytest.fixture(scope="module")
def calm(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An evaluation in this process."""
    output = tmp_path_factory.mktemp("calm")
    run(drifting_options(folder, output, episodes=NUM_EPISODES, workers=1))
    return output


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Any]:
    """Two nodes of one core each, on this machine, that know the policies and troubles of tests."""
    monkeypatch.setenv(ONCE, str(tmp_path / "once"))
    monkeypatch.setenv(PROCESSES, str(tmp_path / "processes"))
    with two_nodes(monkeypatch) as nodes:
        yield nodes


@pytest.fixture
def troubled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give the policies on the cluster their troubles; name it before the cluster."""
    monkeypatch.setenv(TROUBLE, ",".join(f"{seed} {kind}" for seed, kind in BAD.items()))


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the policies on the cluster slow, so that one runs when another ends; name it before the cluster."""
    monkeypatch.setenv(TROUBLE, ",".join(f"{seed} dawdles" for seed in range(NUM_EPISODES)))


def run(options: EvaluateOptions, after: Callable[[int], None] = lambda done: None) -> list[tuple[int, int]]:
    """Evaluate, and return what the progress bar heard, which is followed by a call of `after`."""
    told: list[tuple[int, int]] = []

    def hear(done: int, total: int) -> None:
        told.append((done, total))
        after(done)

    with pytest.MonkeyPatch.context() as patch:
        lighten_reports(patch)
        evaluate(options, hear, load=load_drifting)
    return told


def on(cluster: Any, folder: Path, output: Path, **options: Any) -> EvaluateOptions:
    return drifting_options(folder, output, episodes=NUM_EPISODES, workers=2, ray=cluster.address, **options)


def test_episodes_of_a_cluster_that_loses_an_actor_are_each_written_once_and_the_same(
    slow: None, cluster: Any, folder: Path, tmp_path: Path, calm: Path
) -> None:
    killed: list[int] = []

    def kill_an_actor(done: int) -> None:
        lines = (tmp_path / "episodes.jsonl").read_text().splitlines()[1:]
        seeds = {json.loads(line)["metrics"]["seed"] for line in lines}
        at_work = [row for row in running(tmp_path) if row["seed"] not in seeds] if done and not killed else []
        if at_work:
            killed.append(at_work[-1]["actor"])
            os.kill(killed[0], signal.SIGKILL)

    told = run(on(cluster, folder, tmp_path), kill_an_actor)
    assert_all_once(told, tmp_path, calm)
    processes = running(tmp_path)
    assert len({row["node"] for row in processes}) == 2
    assert processes[-1]["actor"] != killed[0]


def test_episodes_of_a_cluster_that_loses_a_node_are_each_written_once_and_the_same(
    cluster: Any, folder: Path, tmp_path: Path, calm: Path
) -> None:
    lost = cluster.worker_nodes.copy().pop()

    def kill_a_node(done: int) -> None:
        if done == 3:
            cluster.remove_node(lost, allow_graceful=False)

    told = run(on(cluster, folder, tmp_path), kill_a_node)
    assert not lost.any_processes_alive()
    assert_all_once(told, tmp_path, calm)


def test_bad_policy_fares_on_a_cluster_as_in_local_processes(
    troubled: None, cluster: Any, folder: Path, tmp_path: Path, calm: Path
) -> None:
    run(on(cluster, folder, tmp_path))
    found, wanted = (json.loads((output / "results.json").read_text())["episodes"] for output in (tmp_path, calm))
    assert {row["seed"]: row["reason"] for row in found if row["outcome"] == "failed"} == REASONS
    assert [row for row in found if row["seed"] not in BAD] == [row for row in wanted if row["seed"] not in BAD]


def test_evaluation_begun_here_and_stopped_goes_on_at_a_cluster(
    cluster: Any, folder: Path, tmp_path: Path, calm: Path
) -> None:
    def stop(done: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(drifting_options(folder, tmp_path, episodes=NUM_EPISODES, workers=1), stop)
    told = run(on(cluster, folder, tmp_path, resume=True))
    assert told[0] == (3, NUM_EPISODES)
    assert_same_files(tmp_path, calm)


def test_cluster_without_a_free_core_is_said_to_have_none(
    cluster: Any, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import ray

    monkeypatch.setattr(ray_cluster, "START_LIMIT", 3.0)
    ray.init(cluster.address)
    try:
        holders = [ray.remote(num_cpus=1)(Idler).remote() for _ in range(2)]
        ray.get([holder.__ray_ready__.remote() for holder in holders])
        with pytest.raises(ResourceError, match=r"within 3 s: of 2 cores 0 are free.*other work has them.*--resume"):
            run(on(cluster, folder, tmp_path))
    finally:
        ray.shutdown()


class Idler:
    """Holds a core."""


def test_address_at_which_nothing_answers_is_named_with_the_time_waited(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ray", reason="Ray is not installed: pip install -c constraints.txt 'aquanav[cluster]'.")
    monkeypatch.setattr(ray_cluster, "ANSWER_LIMIT", 6.0)
    options = drifting_options(folder, tmp_path, ray="127.0.0.1:9")  # the port of "discard", which nobody serves
    with pytest.raises(ResourceError, match=r"No Ray cluster answered at 127\.0\.0\.1:9 within 6 s\. .*ray status"):
        run(options)


def test_without_ray_the_message_says_what_to_install(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ResourceError, match=r"not installed.*pip install 'aquanav\[cluster\]'"):
        run(drifting_options(folder, tmp_path, ray="auto"))


@pytest.mark.parametrize(
    ("choices", "advice"),
    [
        ({"ray": "ray://head:10001"}, "start the evaluation on one of its nodes"),
        ({"ray": "head"}, "HOST:PORT"),
        ({"ray": "auto", "backend": "batch"}, "Leave out --ray"),
    ],
)
def test_addresses_and_backends_that_do_not_go_together_are_refused(choices: dict[str, Any], advice: str) -> None:
    with pytest.raises(InputError, match=advice):
        EvaluateOptions(("baseline:random",), (Path("tube"),), **choices)


def test_node_with_another_scenario_is_refused(folder: Path, tmp_path: Path) -> None:
    options = drifting_options(folder, tmp_path, episodes=1)
    spec = EvaluationSpec(
        options, "drifting", tmp_path, load_drifting, {"policy drifting": None, "scenario tube": "0" * 64}
    )
    with pytest.raises(AquanavError, match="The content of scenario tube is not that with which the evaluation began"):
        make_plan(spec)


def test_node_with_another_version_or_without_the_folder_is_refused(tmp_path: Path) -> None:
    other = {**code_here(), "numpy": "0.1"}
    with pytest.raises(InputError, match=r"The node \S+ cannot take part: It has numpy \S+, not 0\.1\. .*same version"):
        MakeAsAtHome(lambda clock: None, code_here, other, str(tmp_path))(None)
    with pytest.raises(InputError, match="cannot enter the working directory"):
        MakeAsAtHome(lambda clock: None, code_here, code_here(), str(tmp_path / "absent"))(None)


def assert_all_once(told: list[tuple[int, int]], output: Path, calm: Path) -> None:
    assert told == [(done, NUM_EPISODES) for done in range(NUM_EPISODES + 1)]
    rows = [json.loads(line) for line in (output / "episodes.jsonl").read_text().splitlines()[1:]]
    assert sorted(row["metrics"]["index"] for row in rows) == list(range(NUM_EPISODES))
    assert_same_files(output, calm)
    trails = sorted(path.name for path in (output / "trails").iterdir())
    assert trails == [f"{index:06d}.npz" for index in range(NUM_EPISODES)]


def running(output: Path) -> list[dict[str, Any]]:
    """Return which process ran episodes for which actor, episode by episode, as the policy wrote it down."""
    return [json.loads(line) for line in (output / "processes").read_text().splitlines()]


@pytest.mark.parametrize(
    ("index", "names", "recording"),
    [
        (7, ["trails/000007.npz", "../../home/.profile"], None),
        (7, ["trails/000007.npz", "/etc/passwd"], None),
        (7, ["trails/../../000007.npz"], None),
        (7, ["trails/000008.npz"], None),
        (7, ["results.json"], None),
        (7, [], "../episode-00007.rrd"),
        (8, [], None),
    ],
)
def test_what_a_node_sends_cannot_leave_the_folder_nor_replace_another_episode(
    index: int, names: list[str], recording: str | None
) -> None:
    row = {"metrics": {"index": index}, "recording": recording}
    with pytest.raises(ResourceError, match="does not belong to it"):
        check_found(7, row, dict.fromkeys(names, b""))


def test_what_belongs_to_an_episode_is_taken_from_a_node() -> None:
    names = ["trails/000007.npz", "episode-00007.rrd", "episode-00007.webm"]
    check_found(7, {"metrics": {"index": 7}, "recording": names[1]}, dict.fromkeys(names, b""))


def test_folder_of_a_killed_actor_is_removed_by_a_later_one_and_no_other_is(tmp_path: Path) -> None:
    names = ("aquanav-actor-left", "aquanav-actor-held", "aquanav-actor-young", "aquanav-other")
    left, held, young, other = (tmp_path / name for name in names)
    for folder in (left, held, young, other):
        (folder / "trails").mkdir(parents=True)
    with locked(held):
        for folder in (left, held, other):
            os.utime(folder, (1e9, 1e9))
        clear_left(tmp_path)
    assert [folder.is_dir() for folder in (left, held, young, other)] == [False, True, True, True]


@pytest.mark.parametrize(("cause", "told"), [(KeyError(), "KeyError"), (ValueError("first\nlast"), "last")])
def test_error_of_an_actor_is_told_by_its_last_line_or_its_type(cause: Exception, told: str) -> None:
    class TaskError(Exception):
        pass

    error = TaskError()
    error.cause = cause  # type: ignore[attr-defined]  # as Ray's RayTaskError has it
    assert str(as_own_error(error)).startswith(f"An actor of the cluster failed: {told} The likely cause")
