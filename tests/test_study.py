"""The study of training runs: what it counts, on episodes and runs with known answers, and that it repeats nothing."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from aquanav_tools.evaluate.statistics import Estimate
from aquanav_tools.train.pipeline import read_pipeline
from eval.study import run as study_run
from eval.study.again import interval, section
from eval.study.page import improvement, markdown, verdict
from eval.study.places import built_places
from eval.study.studies import CAVES, ORIGINAL, STUDIES, Question, Study

SMALL = dataclasses.replace(
    CAVES,
    variants={"curriculum": {"extends": "paper"}, "sparse": {"extends": "paper-sparse"}},
    places=("wide", "narrow"),
    currents={"still": 0.0, "full": 1.0},
    questions=(Question("Dense or sparse", "curriculum", "sparse", "dense is better"),),
    safety_place="narrow",
)


def episode(place: str, share: float, outcome: str, collisions: int) -> dict[str, Any]:
    means = dict.fromkeys(("mean_clearance", "min_clearance", "time", "spl"), 1.0)
    return {
        "scenario": place,
        "condition": f"current x{share:g}",
        "outcome": outcome,
        "collisions": collisions,
        **means,
    }


def made_up(variant: str, seed: int, share: float, collisions: float = 0.0) -> dict[str, Any]:
    """A run that did equally well everywhere."""
    score = {"success": share, "collision_free_success": share, "collisions": collisions, "mean_clearance": 1.0}
    scores = {place: dict.fromkeys(SMALL.currents, score) for place in SMALL.places}
    curve = [[0.0, 0.0, 0.0], [3e6, share, share]]
    return {"variant": variant, "seed": seed, "scores": scores, "curve": curve, "training_cpu_s": 1}


def test_rates_are_counted_by_place_and_current() -> None:
    flown = [
        episode("wide", 0.0, "success", 0),
        episode("wide", 0.0, "success", 3),
        episode("wide", 0.0, "timeout", 0),
        episode("wide", 0.0, "timeout", 1),
        episode("wide", 1.0, "success", 0),
        episode("narrow", 0.0, "collision", 1),
        episode("narrow", 1.0, "success", 2),
    ]
    found = study_run.scores(SMALL, flown)
    rates = {
        (p, c): (s["success"], s["collision_free_success"], s["collisions"])
        for p, at in found.items()
        for c, s in at.items()
    }
    assert rates == {
        ("wide", "still"): (0.5, 0.25, 1.0),
        ("wide", "full"): (1.0, 1.0, 0.0),
        ("narrow", "still"): (0.0, 0.0, 1.0),
        ("narrow", "full"): (1.0, 0.0, 2.0),
    }


def test_improvement_counts_pairs_of_runs_and_ties_as_halves() -> None:
    # Of the four pairs of the first column 1 > 0 twice, 0 = 0 twice; in the second the first is always worse.
    first, second = np.array([[1.0, 0.0], [0.0, 0.0]]), np.array([[0.0, 1.0], [0.0, 1.0]])
    assert improvement(first, second).mean == pytest.approx(np.mean([0.75, 0.0]))


def test_the_interval_of_improvement_comes_from_drawing_runs_anew() -> None:
    # One of the first's two runs beats all of the second's: 0, 1 or 2 such runs are drawn, with 1/4, 1/2, 1/4.
    better = improvement(np.array([[1.0], [0.0]]), np.full((3, 1), 0.5))
    assert (better.mean, better.low, better.high) == (0.5, 0.0, 1.0)
    # Where all of its runs do, nothing that is drawn says otherwise.
    better = improvement(np.ones((2, 1)), np.zeros((3, 1)))
    assert (better.low, better.high) == (1.0, 1.0)


def test_a_conclusion_holds_where_the_interval_leaves_no_other() -> None:
    better = {"goals": Estimate(0.9, 0.6, 1.0), "time": Estimate(0.3, 0.1, 0.49), "contacts": Estimate(0.9, 0.5, 1.0)}
    assert verdict(better) == "It holds here by goals. The contrary holds by time. Nothing is shown by contacts."


def test_the_page_gives_the_interquartile_mean_and_the_spread_over_runs() -> None:
    # The middle half of 0, 40, 60, 100 % is 40 and 60 %; the standard deviation of 0, 40, 60, 100 is 41.6.
    runs = [made_up("curriculum", seed, share) for seed, share in enumerate((0.0, 0.4, 0.6, 1.0))]
    page = markdown("small", SMALL, [*runs, made_up("sparse", 0, 0.0, collisions=2.5)])
    assert "curriculum 4, sparse 1" in page
    assert "| collision-free success, IQM | 50 % [" in page
    assert "| collisions per episode, narrow | 0.00 ± 0.00 | 2.50 ± 0.00 | 1.00 [1.00, 1.00] |" in page
    assert "| wide, full | 50 ± 42 | 0 ± 0 |" in page
    assert "Nothing is concluded from fewer than 3 runs: sparse." in page
    assert "holds" not in page.split("## Answers")[1]


def test_more_runs_of_a_normal_variant_lie_within_the_interval_as_often_as_it_says(
    rng: np.random.Generator,
) -> None:
    runs = rng.normal(3.0, 2.0, (1000, 11))
    inside = [low <= run[10] <= high for run in runs for low, high in [interval(run[:10], 0.0)]]
    # 1000 draws of 95 % have a standard deviation of 0.69 %.
    assert np.mean(inside) == pytest.approx(0.95, abs=0.028)
    several = [low <= run[6:].mean() <= high for run in runs for low, high in [interval(run[:6], 0.0, 5)]]
    assert np.mean(several) == pytest.approx(0.95, abs=0.028)


def test_runs_done_again_are_held_against_those_that_are_kept() -> None:
    runs = [made_up("curriculum", seed, share) for seed, share in enumerate((0.8, 0.9, 1.0))]
    runs += [made_up("sparse", seed, share, 2.0) for seed, share in enumerate((0.1, 0.2, 0.3))]
    again = [made_up("curriculum", 0, 0.2), made_up("sparse", 0, 0.2, 2.02)]
    # With t = 4.30 of two degrees of freedom and a spread of 10 %, the interval reaches 50 % to both sides.
    page = "\n".join(section("small", SMALL, runs, again))
    assert (
        "| curriculum | 1 | **20 %** [40, 100] | **20 %** [40, 100] | 0.00 [0.00, 0.03] | 1.00 [0.99, 1.00] | 8 of 16 |"
        in page
    )
    assert "| sparse | 1 | 20 % [0, 70] | 20 % [0, 70] | 2.02 [1.98, 2.02] | 1.00 [0.99, 1.00] | 16 of 16 |" in page
    assert "Within: 24 of 32." in page
    # One run below three others is the first of four places, of both sides: 2 / 4.
    assert "Outside, of curriculum, success: runs now 0.20, before 0.80, 0.90, 1.00; Mann-Whitney's p is 0.50." in page
    assert "the same as before by collisions per episode; neither by collision-free success, success, mean" in page
    assert "Not run again: curriculum." in "\n".join(section("small", SMALL, runs, again[1:]))
    assert section("small", SMALL, runs, []) == []
    # The mean of three more lies within 4.30 x 10 % x sqrt(1/3 + 1/3), 35 %.
    more = [made_up("curriculum", seed, share) for seed, share in enumerate((0.2, 0.7, 0.9))]
    assert "| curriculum | 3 | 60 % [55, 100] |" in "\n".join(section("small", SMALL, runs, more))


def test_a_place_that_one_run_lacks_is_left_out() -> None:
    runs = [made_up("curriculum", 0, 1.0), made_up("sparse", 0, 0.5)]
    del runs[1]["scores"]["wide"]
    page = markdown("small", SMALL, runs)
    assert "wide" not in page
    assert "| narrow, full | 100 ± 0 | 50 ± 0 |" in page


@pytest.mark.parametrize(("study", "name"), [(study, name) for study in STUDIES.values() for name in study.variants])
def test_a_variant_learns_as_its_pipeline_says_but_for_the_studys_settings_and_caves(
    study: Study, name: str, tmp_path: Path
) -> None:
    places = {cave: f"built/{cave}" for cave in study.caves.values()}
    path = tmp_path / "pipeline.toml"
    path.write_text(tomli_w.dumps(study_run.pipeline_table(study, name, places)))
    said = {**study.variants[name], **study.settings}
    written, shipped = read_pipeline(path, {}), read_pipeline(said.pop("extends"), said)
    assert written.run == shipped.run
    caves = [places[study.caves[lesson.scenario]] if study.caves else lesson.scenario for lesson in shipped.lessons]
    assert [lesson.scenario for lesson in written.lessons] == caves
    alike = [dataclasses.replace(a, scenario=b.scenario) for a, b in zip(shipped.lessons, written.lessons, strict=True)]
    assert tuple(alike) == written.lessons


def test_a_study_of_caves_that_are_not_there_says_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="There is no"):
        built_places(ORIGINAL.places, tmp_path, tmp_path / "out")
    assert built_places(("cave-test-1", "han"), tmp_path, tmp_path / "out") == {"cave-test-1": "cave-test-1"}


@pytest.fixture
def results(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder for what the small study finds."""
    monkeypatch.setattr(study_run, "STUDIES", {"caves": SMALL})
    monkeypatch.setattr(study_run, "RESULTS", tmp_path)
    monkeypatch.setattr("eval.study.page.DPI", 20)
    return tmp_path


def test_runs_that_are_kept_are_not_repeated(
    results: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[tuple[str, int]] = []

    def run_variant(study: Study, name: str, seed: int, places: dict[str, str], output: Path) -> dict[str, Any]:
        asked.append((name, seed))
        if (name, seed) == ("sparse", 1) and len(asked) == 4:
            raise RuntimeError("the machine went down")
        return made_up(name, seed, 0.5)

    monkeypatch.setattr(study_run, "run_variant", run_variant)
    monkeypatch.setattr(
        "sys.argv", ["run.py", "caves", "--seeds", "2", "--jobs", "1", "--output", str(results / "out")]
    )
    with pytest.raises(RuntimeError, match="went down"):
        study_run.main()
    # All variants with one seed come before any with the next.
    assert asked == [("curriculum", 0), ("sparse", 0), ("curriculum", 1), ("sparse", 1)]
    study_run.main()
    assert asked[4:] == [("sparse", 1)]
    assert "3 runs are kept, 1 are to do." in capsys.readouterr().out
    kept = [json.loads(line) for line in (results / "study-caves.jsonl").read_text().splitlines()]
    assert sorted((run["variant"], run["seed"]) for run in kept) == sorted(asked[:4])
    pictures = {"study-caves-curves.png", "study-caves-scores.png"}
    assert {path.name for path in results.iterdir()} == {"study-caves.jsonl", "study-caves.md", *pictures}
    monkeypatch.setattr("sys.argv", ["run.py", "caves", "--again", "--jobs", "1", "--output", str(results / "out")])
    study_run.main()
    assert asked[5:] == [("curriculum", 0), ("sparse", 0)]
    monkeypatch.setattr(
        "sys.argv", ["run.py", "caves", "--again", "--only", "sparse", "--seeds", "2", "--output", str(results / "out")]
    )
    study_run.main()
    assert asked[7:] == [("sparse", 1)]
    assert len((results / "study-caves-again.jsonl").read_text().splitlines()) == 3
    assert len((results / "study-caves.jsonl").read_text().splitlines()) == 4
    assert "Within: 32 of 32." in (results / "study-caves.md").read_text()
