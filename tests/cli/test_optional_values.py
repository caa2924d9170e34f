from __future__ import annotations

from dataclasses import dataclass

import pytest
import tyro

from aquanav_tools.cli.command import run_command


@dataclass(frozen=True)
class Options:
    """Test options."""

    input: tyro.conf.Positional[str]
    """Where from."""
    rig: tuple[str, str, float] | None = None
    """Two names and a distance."""
    voxel: float | None = 0.5
    """Size."""


def parsed(*arguments: str) -> Options | int:
    """Return the options, or the exit code of a command line that is wrong."""
    seen: list[Options] = []
    try:
        run_command(Options, seen.append, "test", "A test.", arguments=arguments)
    except SystemExit as ending:
        return int(ending.code or 0)
    return seen[0]


def test_values_that_may_be_left_out_are_read() -> None:
    assert parsed("here", "--rig", "l*", "r*", "0.3", "--voxel", "0.2") == Options("here", ("l*", "r*", 0.3), 0.2)
    assert parsed("here") == Options("here")


def test_as_many_values_are_taken_as_there_must_be_and_no_more() -> None:
    assert parsed("--rig", "l*", "r*", "0.3", "here") == Options("here", ("l*", "r*", 0.3))


def test_none_takes_a_default_back() -> None:
    assert parsed("here", "--voxel", "None") == Options("here", voxel=None)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--rig", "l*", "r*"), "Expected 3 values"),
        (("--rig", "l*", "r*", "wide"), "Could not parse arguments"),
        (("--voxel", "fine"), "could not convert string to float: 'fine'"),
    ],
)
def test_mistakes_are_told_without_markup_and_types(
    arguments: tuple[str, ...], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert parsed("here", *arguments) == 2
    error = capsys.readouterr().err
    assert told in error
    for word in ("[bold]", "NoneType", "{None}"):
        assert word not in error
