"""One sequence of actions in still water and in currents."""

from __future__ import annotations

import dataclasses
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.cave.water.flow import find_flow
from aquanav_tools.cli.water_impact import WaterImpact as Options
from aquanav_tools.cli.water_impact import run_water_impact
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.water_impact import WaterImpact, measure_water_impact
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import PRESETS, Scenario
from tests.caves import tube_scenario


@cache
def flowing() -> Scenario:
    scenario = tube_scenario()
    flow = find_flow(scenario.cavity, scenario.field, scenario.guide.centres, 2.0, spacing=0.5)
    return dataclasses.replace(scenario, flow=flow)


@cache
def impact() -> WaterImpact:
    currents = ("still", "half", "flood")
    return measure_water_impact(flowing(), load_policy("baseline:reactive"), currents, 2, 3, lambda done, total: None)


def test_the_sequence_repeats_itself_exactly_in_still_water() -> None:
    for replay in impact().replays[:2]:
        assert replay.current == "still"
        np.testing.assert_array_equal(replay.trajectory.positions, impact().ideal.positions)
        assert replay.trajectory.outcome == "success"
        assert not replay.deviation.any()


def test_currents_carry_it_off_the_farther_the_stronger_they_are() -> None:
    _, half, flood = (impact().replays[2 * n : 2 * n + 2] for n in range(3))
    for weak, strong in zip(half, flood, strict=True):
        # Water that comes towards it at the preset's speed carries it back by that speed times the time, but for the
        # time until it is caught, gusts of 10 % and turns of its head.
        seconds = weak.trajectory.times[len(weak.deviation) - 1]
        assert 0.4 * PRESETS["half"] * seconds < weak.deviation[-1] < 1.6 * PRESETS["half"] * seconds
        assert strong.deviation.mean() > weak.deviation.mean()
        assert weak.trajectory.outcome == "timeout"


def test_the_command_writes_numbers_picture_and_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_scenario(flowing(), tmp_path / "tube")
    run_water_impact(Options(tmp_path / "tube", tmp_path / "out", currents=("half",), seeds=1))
    table = json.loads((tmp_path / "out" / "impact.json").read_text())
    assert [row["current"] for row in table["replays"]] == ["half"]
    assert table["replays"][0]["max_deviation"] >= table["replays"][0]["mean_deviation"] > 0.0
    assert all((tmp_path / "out" / name).stat().st_size > 1000 for name in ("impact.png", "impact.svg", "impact.rrd"))
    assert "half" in capsys.readouterr().out


def test_a_policy_that_never_arrives_has_no_ideal_sequence() -> None:
    few = dataclasses.replace(flowing(), starts=flowing().starts[:1])
    limits = dataclasses.replace(few.settings.limits, decisions=20)
    short = dataclasses.replace(few, settings=dataclasses.replace(few.settings, limits=limits))
    with pytest.raises(InputError, match="no ideal sequence of actions"):
        measure_water_impact(short, load_policy("baseline:reactive"), ("half",), 1, 0, lambda done, total: None)
