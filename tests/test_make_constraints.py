"""The pins that .ci/make_constraints.py writes are, under each Python, those that it was given."""

from __future__ import annotations

import runpy
from collections.abc import Callable, Iterator, Mapping

from packaging.requirements import Requirement

from tests.conftest import REPOSITORY
from tests.test_repository import PYTHONS, pins

merged: Callable[[Mapping[str, Mapping[str, str]]], Iterator[str]] = runpy.run_path(
    str(REPOSITORY / ".ci" / "make_constraints.py"), run_name="make_constraints"
)["merged"]


def holding(lines: list[str], python: str) -> dict[str, str]:
    """Return what pip makes of pins under a version of Python."""
    found = [Requirement(line) for line in lines]
    active = [pin for pin in found if pin.marker is None or pin.marker.evaluate({"python_version": python})]
    assert len(active) == len({pin.name for pin in active}), "a package is pinned twice"
    return {pin.name: str(pin.specifier) for pin in active}


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
