from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from aquanav_tools.cli.train import main
from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import LimitSettings
from aquanav_tools.train import training
from aquanav_tools.train.checkpoint import CHECKPOINT_FILE, read_checkpoint
from aquanav_tools.train.record import RunRecord
from aquanav_tools.train.training import train
from tests.caves import tube_scenario
from tests.disks import fill, small_disk
from tests.train.runs import learned, tiny_pipeline, tiny_tube


@pytest.fixture(scope="module")
def tube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_tube(tmp_path_factory.mktemp("scenario") / "tube")


@pytest.fixture(autouse=True)
def no_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare a second for each run."""
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)


def after_checkpoint(monkeypatch: pytest.MonkeyPatch, number: int, act: Callable[[], None]) -> None:
    """Do something right after the checkpoint of a number, from 1, was written."""
    write, written = RunRecord.write, []

    def write_and_act(*args: Any, **kwargs: Any) -> None:
        write(*args, **kwargs)
        written.append(None)
        if len(written) == number:
            act()

    monkeypatch.setattr(RunRecord, "write", write_and_act)


def stop() -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("algorithm", "precision", "checkpoint"),
    [
        ("ppo", "float32", 1),
        ("ppo", "float32", 2),
        ("ppo", "bfloat16", 1),
        ("sac", "float32", 1),
        ("td3", "float32", 1),
        ("recurrent-ppo", "float32", 1),
    ],
)
def test_stopped_run_ends_as_one_that_never_stopped(
    algorithm: str, precision: str, checkpoint: int, tube: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if algorithm == "recurrent-ppo":
        pytest.importorskip("sb3_contrib")
    action = "continuous" if algorithm in ("sac", "td3") else "multidiscrete"
    choices = {"algorithm": algorithm, "precision": precision, "action": action}
    # Each lesson writes two checkpoints: the second is at its end.
    pipeline = tiny_pipeline(tube, 2, steps=256, current=(0.0, 0.4, 0.0), **choices)
    train(pipeline, 3, tmp_path / "whole")
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        after_checkpoint(patch, checkpoint, stop)
        train(pipeline, 3, tmp_path / "stopped")
    train(pipeline, 3, tmp_path / "stopped")
    assert learned(tmp_path / "stopped") == learned(tmp_path / "whole")


def test_killed_command_goes_on_to_the_same_policy(
    tube: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pipeline = tmp_path / "mine.toml"
    pipeline.write_text(
        f'scenario = "{tube}"\nsteps = 256\nobservation = "paper"\nnum_envs = 4\nhidden = [8]\nn_steps = 32\n'
        f'batch = 32\nepochs = 2\ncheckpoint_every = 128\nvalidation = ["{tube}"]\nvalidation_episodes = 2\n'
        "validate_every = 256\nfinal_episodes = 2\n[[lessons]]\n[[lessons]]\ncurrent = [0.0, 0.4, 0.0]\n"
    )
    killed, flags = tmp_path / "killed", ["--pipeline", str(pipeline), "-o"]
    command = [sys.executable, "-c", "from aquanav_tools.cli.train import main; main()", *flags, str(killed)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not (killed / CHECKPOINT_FILE).is_file() and process.poll() is None:
        time.sleep(0.005)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    found = read_checkpoint(killed)
    assert found is not None and not found.journal["is_finished"]
    main([*flags, str(killed)])
    assert "Learned from 512 decisions" in capsys.readouterr().out
    main([*flags, str(tmp_path / "whole")])
    assert learned(killed) == learned(tmp_path / "whole")
    for name in ("curve.csv", "validation.csv"):  # all but the seconds
        rows = [(folder / name).read_text().splitlines() for folder in (killed, tmp_path / "whole")]
        assert len(rows[0]) == len(rows[1])


def test_full_disk_costs_nothing_once_there_is_room(
    tube: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pipeline = tiny_pipeline(tube, steps=384)
    train(pipeline, 0, tmp_path / "whole")
    with small_disk(tmp_path / "disk", 130) as disk:
        with monkeypatch.context() as patch, pytest.raises(ResourceError, match="is full"):
            after_checkpoint(patch, 1, lambda: fill(disk, 1))  # type: ignore[arg-type, return-value]
            train(pipeline, 0, disk / "run")
        (disk / "filler").unlink()
        train(pipeline, 0, disk / "run")
        assert learned(disk / "run") == learned(tmp_path / "whole")


def test_changed_scenario_is_refused_and_nothing_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, run = tiny_tube(tmp_path / "tube"), tmp_path / "run"
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        after_checkpoint(patch, 1, stop)
        train(tiny_pipeline(folder), 0, run)
    before = {path.name: path.read_bytes() for path in run.glob("*.*")}
    write_scenario(tube_scenario(limits=LimitSettings(decisions=41)), folder)
    with pytest.raises(InputError, match=r"another training run, with scenarios 1.content_hash .* instead of"):
        train(tiny_pipeline(folder), 0, run)
    assert {path.name: path.read_bytes() for path in run.glob("*.*")} == before


def test_other_settings_are_refused_by_name_unless_the_run_is_to_be_lost(tube: Path, tmp_path: Path) -> None:
    train(tiny_pipeline(tube, steps=128), 0, tmp_path)
    other = tiny_pipeline(tube, steps=128, clip=0.3)
    with pytest.raises(InputError, match=r"lessons 1.clip 0.2 instead of 0.3. Nothing was changed there"):
        train(other, 0, tmp_path)
    with pytest.raises(InputError, match="seed 0 instead of 1"):
        train(tiny_pipeline(tube, steps=128), 1, tmp_path)
    assert not train(other, 0, tmp_path, overwrite=True).was_finished
    assert train(other, 0, tmp_path).was_finished


def test_damaged_checkpoint_is_told_and_kept(tube: Path, tmp_path: Path) -> None:
    train(tiny_pipeline(tube, steps=128), 0, tmp_path)
    cut = (tmp_path / CHECKPOINT_FILE).read_bytes()[:-100]
    (tmp_path / CHECKPOINT_FILE).write_bytes(cut)
    with pytest.raises(InputError, match=r"checkpoint.pt .* cannot be read.*or begin anew with --overwrite"):
        train(tiny_pipeline(tube, steps=128), 0, tmp_path)
    assert (tmp_path / CHECKPOINT_FILE).read_bytes() == cut
