"""What episodes draw of their vehicles' dynamics: in results, recordings and reports, and as a condition."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pyarrow.parquet
import pytest

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.factory import make_env, read_any_scenario
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.dynamics_table import dynamics_tables
from aquanav_tools.evaluate.episode_table import DYNAMICS, EpisodeTable
from aquanav_tools.evaluate.evaluation import evaluate
from aquanav_tools.evaluate.options import EvaluateOptions, Grid, ReplayOptions
from aquanav_tools.evaluate.protocol import conditions_of, task_under
from aquanav_tools.evaluate.replaying import replay
from aquanav_tools.evaluate.results import check_results, episodes_of, read_results
from aquanav_tools.report.dynamics import FACTOR, UNITS, dynamics_document
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.contacts import default_backend
from aquanav_tools.sim.randomisation import DELAYS, FACTORS, read_randomisation
from aquanav_tools.sim.vehicle import load_vehicle
from tests.evaluate.test_bays import BAY
from tests.evaluate.test_metrics import episode

EPISODES, SEED = 4, 11
HALF_A_MICRO = 0.5e-6
"""results.json has six decimals."""


def run(folder: Path, output: Path, **options: Any) -> dict[str, Any]:
    """Return the results of episodes of three decisions."""
    rules: dict[str, Any] = {"episodes": EPISODES, "seed": SEED, "max_decisions": 3, "record": "none", **options}
    found = evaluate(EvaluateOptions(("baseline:random",), (folder,), output, **rules), lambda done, total: None)
    return json.loads(found.results.read_text())  # type: ignore[no-any-return]


def drawn_alone(tube: Scenario, randomisation: str, seed: int) -> dict[str, float]:
    """Return what an environment of one vehicle says that it drew."""
    env = CaveEnv(tube, randomisation=randomisation)
    _, info = env.reset(seed=seed)
    env.close()
    return {name.removeprefix("dynamics/"): value for name, value in info.items() if name.startswith("dynamics/")}


@pytest.mark.parametrize(
    "options", [{"workers": 1}, pytest.param({"workers": 2}, marks=pytest.mark.slow), {"backend": "batch"}]
)
def test_results_hold_what_the_environment_of_the_seed_draws(
    folder: Path, tmp_path: Path, tube: Scenario, options: dict[str, Any]
) -> None:
    table = run(folder, tmp_path, randomisation="wide", **options)
    for row in table["episodes"]:
        expected = drawn_alone(tube, "wide", row["seed"])
        assert row["dynamics"].keys() == expected.keys()
        assert all(abs(row["dynamics"][name] - expected[name]) <= HALF_A_MICRO for name in expected)
    assert len({row["dynamics"]["mass"] for row in table["episodes"]}) == EPISODES


def test_without_ranges_no_row_has_dynamics(folder: Path, tmp_path: Path) -> None:
    assert not any("dynamics" in row for row in run(folder, tmp_path)["episodes"])


@pytest.mark.parametrize("options", [{"workers": 1}, {"backend": "batch"}])
def test_a_stopped_evaluation_goes_on_to_the_same_bytes(folder: Path, tmp_path: Path, options: dict[str, Any]) -> None:
    options = options | {"grid": Grid(randomisation=("none", "mild", "wide"))}
    run(folder, tmp_path / "whole", **options)
    run(folder, tmp_path / "stopped", **options)
    journal = tmp_path / "stopped" / "episodes.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join([lines[0], *lines[:1:-2]]))  # every second one, the last first
    run(folder, tmp_path / "stopped", resume=True, **options)
    for name in ("results.json", "episodes.parquet"):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "stopped" / name).read_bytes()


def test_parquet_has_a_column_for_each_number_that_any_episode_drew(folder: Path, tmp_path: Path) -> None:
    table = run(folder, tmp_path, grid=Grid(randomisation=("none", "mild", "wide")))
    rows = pyarrow.parquet.read_table(tmp_path / "episodes.parquet").to_pylist()
    for row, told in zip(rows, table["episodes"], strict=True):
        drawn = {name.removeprefix(DYNAMICS): row[name] for name in row if name.startswith(DYNAMICS)}
        assert {name: value for name, value in drawn.items() if value is not None} == told.get("dynamics", {})
        assert "payload" in drawn


@pytest.mark.parametrize("options", [{"workers": 1}, {"backend": "batch"}])
def test_a_replayed_episode_draws_the_same(folder: Path, tmp_path: Path, options: dict[str, Any]) -> None:
    table = run(folder, tmp_path, grid=Grid(randomisation=("none", "wide")), **options)
    again = replay(ReplayOptions(tmp_path, EPISODES + 1)).episode
    told = table["episodes"][EPISODES + 1]["dynamics"]
    assert {name: round(value, 6) for name, value in again.dynamics.items()} == told


def document_of(path: Path) -> str:
    """Return the text of a recording that tells what was drawn, as rerun's own reader has it."""
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    (store,) = reader.recordings()
    (chunk,) = [item for item in reader.stream(store=store).to_chunks() if item.entity_path == "/dynamics"]
    return str(chunk.to_record_batch().column("TextDocument:text").to_pylist()[0][0])


def test_a_recording_tells_what_its_episode_drew_and_shows_it(folder: Path, tmp_path: Path, tube: Scenario) -> None:
    run(folder, tmp_path, randomisation="wide", record="all")
    names: set[str] = set()
    for index in range(EPISODES):
        drawn = drawn_alone(tube, "wide", SEED + index)
        assert document_of(tmp_path / f"episode-{index:05d}.rrd") == dynamics_document(drawn)
        assert f"| mass | {drawn['mass']:.3g} | {FACTOR} |" in dynamics_document(drawn)
        names |= drawn.keys()
    assert views_of(tmp_path / "episode-00000.rrd") == views_of(tmp_path / "episode-00003.rrd")
    assert "TextDocument" in views_of(tmp_path / "episode-00000.rrd")
    run(folder, tmp_path, record="all")
    assert "TextDocument" not in views_of(tmp_path / "episode-00000.rrd")


def views_of(path: Path) -> list[str]:
    """Return the kinds of views in a recording's layout, sorted."""
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    (layout,) = reader.blueprints()
    kinds = []
    for chunk in reader.stream(store=layout).to_chunks():
        batch = chunk.to_record_batch()
        if "ViewBlueprint:class_identifier" in batch.schema.names:
            kinds += [kind for row in batch.column("ViewBlueprint:class_identifier").to_pylist() for kind in row]
    return sorted(kinds)


def test_every_number_that_is_no_factor_has_a_unit() -> None:
    vehicle = load_vehicle("bluerov2-heavy")
    names = {*read_randomisation("mild").names(vehicle), *read_randomisation("wide").names(vehicle)}
    factors = {name for name in names if name in FACTORS or name.startswith("thruster_")} - {"ray_gain"}
    assert names - factors == UNITS.keys()


def test_results_of_format_4_are_read(folder: Path, tmp_path: Path) -> None:
    table = run(folder, tmp_path)
    old = {**table, "format": 4}
    del old["own_files"], old["protocol"]["grid"]["randomisation"]
    (tmp_path / "results.json").write_text(json.dumps(old))
    assert [one.dynamics for one in episodes_of(read_results(tmp_path / "results.json"))] == [{}] * EPISODES
    assert replay(ReplayOptions(tmp_path, 1)).episode.digest == table["episodes"][1]["digest"]


@pytest.mark.parametrize("dynamics", [{}, {"mass": "heavy"}, [1.0]])
def test_the_schema_refuses_what_are_no_numbers_by_name(folder: Path, tmp_path: Path, dynamics: object) -> None:
    table = run(folder, tmp_path, randomisation="mild")
    check_results(table)
    table["episodes"][0]["dynamics"] = dynamics
    with pytest.raises(jsonschema.ValidationError):
        check_results(table)


def test_a_table_of_episodes_keeps_what_each_of_them_drew() -> None:
    drawn: list[dict[str, float]] = [{}, {"b": 2.0, "a": 1.0}, {"c": 3.0}, {}]
    episodes = [episode(index=index, dynamics=dict(sorted(one.items()))) for index, one in enumerate(drawn)]
    table = EpisodeTable(episodes)
    assert list(table) == episodes
    assert list(table.rows(np.array([2, 1]))) == [episodes[2], episodes[1]]
    assert table.drawn == ["a", "b", "c"]
    np.testing.assert_array_equal(table.column(DYNAMICS + "a"), [np.nan, 1.0, np.nan, np.nan])


def test_the_reports_table_shows_success_by_thirds_of_the_range() -> None:
    """Episodes succeed where the mass is below 1.1, of 0.9 to 1.2 in steps of 0.01: the thirds end at 1.0 and 1.1."""
    masses = 0.9 + 0.01 * np.arange(31)
    episodes = [
        episode(
            digest=str(index), collisions=0, outcome="success" if mass < 1.095 else "timeout",
            dynamics={"action_delay": float(index % 2), "mass": float(mass)},
        )
        for index, mass in enumerate(masses)
    ]  # fmt: skip
    (table,) = dynamics_tables(EpisodeTable(episodes))
    (delay, mass) = table.rows
    assert mass[:4] == ("mass", "0.9", "1.2", FACTOR)
    assert [cell.split(" %")[0] for cell in mass[4:]] == ["100", "100", "0"]
    assert sum(int(cell.split(" of ")[1]) for cell in mass[4:]) == 31
    assert delay[3:] == ("decisions", "0: 62 % of 16", "1: 67 % of 15", "")  # 20 successes, evenly over even and odd
    assert "what 31 episodes drew" in table.title and "31 different vehicles" in table.title
    (twice,) = dynamics_tables(EpisodeTable(episodes * 2))  # as under two conditions
    assert "what 62 episodes drew" in twice.title and "31 different vehicles" in twice.title
    assert twice.title.split("Differences")[1] == table.title.split("Differences")[1]
    assert not dynamics_tables(EpisodeTable([episode()] * 40))


def test_the_reports_table_stands_in_the_report(folder: Path, tmp_path: Path) -> None:
    run(folder, tmp_path, episodes=10, randomisation="mild", max_decisions=400, backend="batch")
    assert "by what 10 episodes drew" in (tmp_path / "report.html").read_text()


def test_a_grid_sets_ranges_beside_the_other_conditions() -> None:
    options = EvaluateOptions(("p",), (Path("s"),), randomisation="wide")
    grid = Grid(sensor_noise=(0.0, 0.1), action_delay=(0, 3), randomisation=("none", "mild", "wide"))
    conditions = conditions_of(grid)
    tasks = [task_under(condition, options) for condition in conditions]
    assert [(task.sensor_noise, task.action_delay, task.randomisation) for task in tasks] == [
        (noise, delay, name)
        for noise in (0.0, 0.1)
        for delay, name in ((0, None), (0, "mild"), (0, "wide"), (3, None), (3, "mild"))
    ]  # wide draws the delay itself
    assert "action_delay" in DELAYS and read_randomisation("wide").action_delay is not None
    assert [condition.name for condition in conditions[:3]] == [
        "noise 0 m, delay 0", "noise 0 m, delay 0, mild dynamics", "noise 0 m, wide dynamics",
    ]  # fmt: skip
    assert conditions_of(Grid(randomisation=("none",)))[0].name == "the file's dynamics"


def test_ranges_that_there_are_not_are_refused_before_anything_runs(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no randomisation 'mildd'\. Did you mean 'mild'"):
        run(folder, tmp_path / "out", grid=Grid(randomisation=("mildd",)))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("backend", [default_backend(), "batch"])
def test_results_of_boats_have_what_their_environment_draws(backend: str, tmp_path: Path) -> None:
    bay = tmp_path / "small.toml"
    bay.write_text(BAY)
    table = run(bay, tmp_path / "out", randomisation="mild", backend=backend)
    for row in table["episodes"]:
        env = make_env(read_any_scenario(bay), randomisation="mild")
        _, info = env.reset(seed=row["seed"])
        env.close()
        drawn = {name.removeprefix("dynamics/"): value for name, value in info.items() if name.startswith("dynamics/")}
        assert len(drawn) > 5
        assert row["dynamics"] == pytest.approx(drawn, abs=1e-6)


def test_two_seeds_differ_in_what_they_draw_and_conditions_share_it(folder: Path, tmp_path: Path) -> None:
    table = run(folder, tmp_path, randomisation="mild", grid=Grid(sensor_noise=(0.0, 0.1)))
    first, second = table["episodes"][:EPISODES], table["episodes"][EPISODES:]
    assert [one["dynamics"] for one in first] == [one["dynamics"] for one in second]
    assert dataclasses.replace(episode(), dynamics={"a": 1.0}) != episode()
