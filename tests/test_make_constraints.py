"""The pins that .ci/make_constraints.py writes are, under each Python, those that it was given."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.conftest import REPOSITORY
from tests.test_repository import PYTHONS, pins

SCRIPT = runpy.run_path(str(REPOSITORY / ".ci" / "make_constraints.py"), run_name="make_constraints")
merged: Callable[[Mapping[str, Mapping[str, str]]], Iterator[str]] = SCRIPT["merged"]
newest: Callable[[str], tuple[str, dict[str, str]]] = SCRIPT["newest"]
INTERPRETER = f"""#!{sys.executable}
import json, os, sys
assert os.environ["PIP_CONSTRAINT"] == "" and "--dry-run" in sys.argv
versions = {{"aquanav": "0.1.0", "Jinja2": "3.1.6", "torch": "2.14.1+cpu", "nvidia-nvtx": "13.0", "triton": "3.8.0"}}
installed = [{{"metadata": {{"name": name, "version": version}}}} for name, version in versions.items()]
report = {{"environment": {{"python_full_version": "3.13.0"}}, "install": installed}}
with open(sys.argv[sys.argv.index("--report") + 1], "w") as stream:
    json.dump(report, stream)
print("Collecting Jinja2")
"""
"""Stands for one whose pip asks no network, and writes the report that pip's manual describes."""


def holding(lines: list[str], python: str) -> dict[str, str]:
    """Return what pip makes of pins under a version of Python."""
    found = [Requirement(line) for line in lines]
    active = [pin for pin in found if pin.marker is None or pin.marker.evaluate({"python_version": python})]
    assert len(active) == len({pin.name for pin in active}), "a package is pinned twice"
    return {pin.name: str(pin.specifier) for pin in active}


def test_pins_are_what_pip_would_install_and_what_it_tells_goes_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    python = tmp_path / "python"
    python.write_text(INTERPRETER, encoding="utf-8")
    python.chmod(0o755)
    monkeypatch.setenv("PIP_CONSTRAINT", "constraints.txt")
    assert newest(str(python)) == ("3.13", {"jinja2": "3.1.6", "torch": "2.14.1"})
    told = capfd.readouterr()
    assert not told.out and "Collecting Jinja2" in told.err  # a resolution takes minutes: silence looks like hanging


def test_a_version_that_all_pythons_have_needs_no_marker() -> None:
    found = {python: {"numpy": "2.1.0"} for python in PYTHONS}
    assert list(merged(found)) == ["numpy==2.1.0"]


def test_pythons_that_differ_get_markers_in_their_order() -> None:
    found = {"3.9": {"numpy": "1"}, "3.10": {"numpy": "2"}, "3.11": {"numpy": "2"}, "3.13": {"numpy": "3", "six": "1"}}
    assert list(merged(found)) == [
        "numpy==1; python_version < '3.10'",
        "numpy==2; python_version >= '3.10' and python_version < '3.13'",
        "numpy==3; python_version >= '3.13'",
        "six==1",
    ]


def test_merging_what_constraints_pin_under_each_python_loses_nothing() -> None:
    found = {python: {name: pin.removeprefix("==") for name, pin in pins(python).items()} for python in PYTHONS}
    lines = list(merged(found))
    assert len(lines) > 100
    for python in PYTHONS:
        assert pins(python).items() <= holding(lines, python).items()
