from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass

import pytest

from aquanav_tools.cli.command import run_command
from aquanav_tools.errors import InputError, MeshError


@dataclass(frozen=True)
class Options:
    """Test options."""

    count: int = 1
    """How many."""

    def __post_init__(self) -> None:
        if self.count < 0:
            raise InputError(f"count is {self.count}.")


def run(*arguments: str, function=lambda options: None) -> int:  # type: ignore[no-untyped-def]
    """Return the exit code; 0 when the command just returns."""
    try:
        run_command(Options, function, "test", "A test.", arguments=arguments)
    except SystemExit as ending:
        return int(ending.code or 0)
    return 0


def fail(options: Options) -> None:
    raise MeshError(f"{options.count} holes.")


def interrupt(options: Options) -> None:
    raise KeyboardInterrupt


def test_options_reach_the_function() -> None:
    seen: list[Options] = []
    assert run("--count", "7", function=seen.append) == 0
    assert seen == [Options(7)]


def test_aquanav_errors_end_with_a_sentence_and_their_code(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--count", "3", function=fail) == 4
    assert capsys.readouterr().err == "error: 3 holes.\n"


def test_errors_of_the_options_themselves_end_the_same_way(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--count", "-1") == 2
    assert capsys.readouterr().err == "error: count is -1.\n"


def test_debug_keeps_the_traceback() -> None:
    with pytest.raises(MeshError):
        run("--debug", function=fail)


def test_ctrl_c_ends_like_in_a_shell(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(function=interrupt) == 130
    assert "Ctrl-C" in capsys.readouterr().err


def test_our_own_mistakes_keep_their_traceback() -> None:
    with pytest.raises(ZeroDivisionError):
        run(function=lambda options: 1 / 0)


def test_help_and_unknown_options_have_their_codes(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--help") == 0
    assert "How many." in capsys.readouterr().out
    assert run("--cuont", "3") == 2


def test_defaults_replace_those_of_the_class() -> None:
    seen: list[Options] = []
    run_command(Options, seen.append, "test", "A test.", defaults=lambda arguments: Options(5), arguments=[])
    assert seen == [Options(5)]


@pytest.mark.parametrize("argument", ["list", "--help"])
def test_a_reader_that_stops_early_gets_no_traceback(argument: str) -> None:
    unread, output = os.pipe()
    os.close(unread)
    program = f"from aquanav_tools.cli.info import main; main([{argument!r}])"
    done = subprocess.run([sys.executable, "-c", program], stdout=output, stderr=subprocess.PIPE, text=True)
    os.close(output)
    assert (done.stderr, done.returncode) == ("", 1)
