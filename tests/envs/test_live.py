"""render_mode="human": every state reaches rerun's viewer, which stands here for a file."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import aquanav_tools.envs  # noqa: F401  # registers aquanav/Cave-v0
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.errors import ResourceError
from aquanav_tools.report.recording import live
from aquanav_tools.scenario.schema import Scenario

RERUN = Path(sys.executable).with_name("rerun")
AHEAD = np.array([1, 1, 2])


def rerun(*arguments: str | Path) -> str:
    result = subprocess.run([RERUN, "rrd", *arguments], capture_output=True, text=True, check=True, timeout=60)
    return result.stdout + result.stderr


@pytest.fixture
def shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file that gets what a viewer would."""
    import rerun as rr

    path = tmp_path / "shown.rrd"

    def open_file(blueprint: Any) -> Any:
        stream = rr.RecordingStream(live.APPLICATION)
        stream.save(path, default_blueprint=blueprint)
        return stream

    monkeypatch.setattr(live, "_open_viewer", open_file)
    return path


def test_every_state_of_every_episode_is_shown_as_it_happens(tube: Scenario, shown: Path) -> None:
    env = gymnasium.make("aquanav/Cave-v0", scenario=tube, render_mode="human", max_decisions=3)
    for seed in range(2):
        env.reset(seed=seed)
        while not any(env.step(AHEAD)[2:4]):
            pass
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert env.render() is None  # as Gymnasium has it: nobody needs to ask
    env.close()
    assert "verified without error" in rerun("verify", shown)
    for entity in ("/vehicle", "/vehicle/rays", "/trail", "/plots/clearance", "/plots/reward/progress"):
        sent = re.findall(r"with (\d+) rows?", rerun("print", "--entity", entity, shown))
        assert sum(map(int, sent)) == 8  # two episodes of a start and three decisions
    for entity in ("/cave", "/route/centreline", "/vehicle/hull"):
        assert re.search(rf"{entity}\b", rerun("print", "-v", shown))
    assert rerun("print", "-vvv", "--entity", "/state", shown).count("timeout") >= 2


@pytest.fixture
def listener(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The file of another process that takes what a viewer takes, over the same gRPC, and needs no screen."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    path = tmp_path / "received.rrd"
    arguments = [RERUN, "--save", path, "--port", str(port)]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(arguments, stdout=quiet, stderr=quiet, start_new_session=True) as process:
        monkeypatch.setattr(live, "PORT", port)
        give_up = time.monotonic() + 60.0
        while not live._is_listening():
            assert process.poll() is None, "rerun ended before it listened"
            assert time.monotonic() < give_up, "rerun does not listen within a minute"
            time.sleep(0.1)
        yield path
        os.killpg(process.pid, signal.SIGTERM)  # the command runs the viewer in a process of its own


def test_a_viewer_in_another_process_receives_every_state(tube: Scenario, listener: Path) -> None:
    env = CaveEnv(tube, render_mode="human", max_decisions=3)
    for seed in range(2):
        env.reset(seed=seed)
        while not any(env.step(AHEAD)[2:4]):
            pass
    env.close()
    give_up, rows = time.monotonic() + 60.0, [0, 0]
    while rows != [8, 8] and time.monotonic() < give_up:  # the other process writes when it comes to it
        rows = [rows_of(entity, listener) for entity in ("/vehicle", "/plots/clearance")]
    assert rows == [8, 8]  # two episodes of a start and three decisions


def rows_of(entity: str, path: Path) -> int:
    """Return how many rows a file has of an entity; one that is being written has no end yet, which printing allows."""
    result = subprocess.run(
        [RERUN, "rrd", "print", "--entity", entity, path], capture_output=True, text=True, check=False, timeout=60
    )
    return sum(map(int, re.findall(r"with (\d+) rows?", result.stdout + result.stderr)))


def test_what_each_episode_draws_of_its_vehicle_is_told(tube: Scenario, shown: Path) -> None:
    env = gymnasium.make("aquanav/Cave-v0", scenario=tube, render_mode="human", max_decisions=1, randomisation="wide")
    masses = []
    for seed in range(2):
        masses.append(env.reset(seed=seed)[1]["dynamics/mass"])
        env.step(AHEAD)
    env.close()
    text = rerun("print", "-vvv", "--entity", "/dynamics", shown)
    assert all(f"| mass | {mass:.3g} |" in text for mass in masses)


def test_being_watched_changes_nothing_about_the_episode(tube: Scenario, shown: Path) -> None:
    seen, blind = CaveEnv(tube, render_mode="human"), CaveEnv(tube)
    np.testing.assert_array_equal(seen.reset(seed=3)[0], blind.reset(seed=3)[0])
    for _ in range(5):
        np.testing.assert_array_equal(seen.step(AHEAD)[0], blind.step(AHEAD)[0])
    seen.close()
    blind.close()


def test_without_screen_and_viewer_it_says_what_to_do(tube: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(live.sys, "platform", "linux")
    monkeypatch.setattr(live, "PORT", 1)  # where nobody listens
    with pytest.raises(ResourceError, match=r"no screen .*no viewer listens at port 1\. .*render_mode='rgb_array'"):
        CaveEnv(tube, render_mode="human")


def test_a_viewer_that_cannot_be_started_says_why(tube: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    import rerun as rr

    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("Failed to find Rerun Viewer executable in PATH")

    monkeypatch.setenv("DISPLAY", ":7")
    monkeypatch.setattr(live, "PORT", 1)
    monkeypatch.setattr(rr.RecordingStream, "spawn", fail)
    with pytest.raises(ResourceError, match=r"could not be started .*Failed to find.*Try the command rerun"):
        CaveEnv(tube, render_mode="human")
