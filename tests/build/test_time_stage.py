"""What a build says of the time that a way takes."""

from __future__ import annotations

import dataclasses
import functools
import json
from pathlib import Path

import pytest

from aquanav_tools.build.journal import Journal
from aquanav_tools.build.time_stage import note_time, time_facts
from aquanav_tools.cli.build_cave import main
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import LimitSettings, Scenario, WaterSettings
from aquanav_tools.sim.vehicle import VEHICLE_DIR
from aquanav_tools.synthetic.caves import tube
from aquanav_tools.types import silent
from tests import caves
from tests.caves import tube_scenario
from tests.commands import run_here
from tests.lighter import lighten_builds


def told(scenario: Scenario) -> tuple[list[tuple[str, str]], list[str]]:
    """Return the warnings, and what is announced."""
    said: list[str] = []
    journal = Journal(silent, said.append)
    note_time(with_vehicle_file(scenario), journal)
    return journal.notices, said


def with_vehicle_file(scenario: Scenario) -> Scenario:
    return dataclasses.replace(scenario, vehicle_toml=(VEHICLE_DIR / "bluerov2.toml").read_text())


def test_enough_time_needs_no_word() -> None:
    assert told(tube_scenario()) == ([], [])


def test_a_long_way_is_announced_with_the_limit_that_follows(monkeypatch: pytest.MonkeyPatch) -> None:
    field, cavity = caves.tube_field(), caves.tube_cavity()
    monkeypatch.setattr(caves, "tube_field", lambda: field)
    monkeypatch.setattr(caves, "tube_cavity", lambda: cavity)
    monkeypatch.setattr(caves, "TUBE_LENGTH", 300.0)
    warnings, (sentence,) = told(tube_scenario())
    assert not warnings
    decisions = time_facts(with_vehicle_file(tube_scenario()))["decisions"]
    assert "The way of 298 m takes 299 s at top speed" in sentence and f"{decisions} decisions" in sentence


def test_an_explicit_limit_that_is_too_short_is_a_warning() -> None:
    ((code, sentence),), _ = told(tube_scenario(limits=LimitSettings(decisions=100)))
    assert code == "too-little-time"
    assert "The way of 18 m takes 18 s" in sentence and "ends after 10 s (100 decisions)" in sentence
    assert "Leave out --decisions" in sentence


def test_a_current_that_is_faster_than_the_vehicle_is_a_warning() -> None:
    ((code, sentence),), _ = told(tube_scenario(water=WaterSettings(current=(-1.2, 0.0, 0.0))))
    assert code == "too-slow"
    assert "0.99 m/s" in sentence and "--water.current" in sentence


def test_the_command_takes_a_limit_and_warns_on_the_terminal_and_in_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lighten_builds(monkeypatch)
    tube(1.0, 6.0, sections=32, rings=31).mesh.to_trimesh().export(tmp_path / "tube.stl")
    run = functools.partial(run_here, main, tmp_path / "tube.stl", "--starts.count", 4)
    done = run("-o", tmp_path / "cave", "--decisions", 20)
    assert done.returncode == 0, done.stderr
    assert "warning (too-little-time): " in done.stderr
    report = json.loads((tmp_path / "cave" / "report.json").read_text())
    assert "too-little-time" in {warning["code"] for warning in report["warnings"]}
    assert report["time"]["decisions"] == read_scenario(tmp_path / "cave").settings.limits.decisions == 20
    refused = run("-o", tmp_path / "other", "--decisions", 0)
    assert refused.returncode == 2
    assert "--decisions is 0" in refused.stderr
