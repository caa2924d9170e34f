from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from aquanav_tools.cli.train import main
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import LimitSettings
from aquanav_tools.sim.contacts import default_backend
from aquanav_tools.train import training
from aquanav_tools.train.pipeline import Pipeline
from tests.caves import tube_scenario
from tests.vehicles import write_vehicle


def exit_code(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ending:
        main(arguments)
    return int(ending.value.code or 0)


def test_command_trains_and_says_what_to_do_next(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_scenario(tube_scenario(), tmp_path / "tube")
    pipeline = tmp_path / "small.toml"
    pipeline.write_text('n_steps = 128\nbatch = 64\nnum_envs = 2\nhidden = [8]\nobservation = "paper"\nsteps = 9999\n')
    folders = ["--scenario", str(tmp_path / "tube"), "-o", str(tmp_path / "run")]
    main([*folders, "--pipeline", str(pipeline), "--steps", "256", "--final-episodes", "3"])
    said = capsys.readouterr().out
    assert (
        "Learns from 256 decisions in 1 update of 256 (128 of each environment: n_steps). So few updates teach little"
        in said
    )
    assert "Learned from 256 decisions" in said
    where = rf"in \S+tube \(backend {default_backend()}"
    assert re.search(rf"The last policy reached the goal in \d+% of 3 whole episodes {where}", said)
    assert "There is no best.zip: it needs scenarios to try the policy in while it learns (--validation)." in said
    assert f"aquanav-eval {tmp_path / 'run' / 'policy.zip'}" in said
    assert (tmp_path / "run" / "policy.zip").is_file()


def test_missing_scenario_ends_with_a_sentence_and_its_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("--scenario", str(tmp_path / "none")) == 5
    assert "is not a scenario" in capsys.readouterr().err


def test_pipeline_with_an_unknown_key_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "wrong.toml").write_text("step = 5\n")
    assert exit_code("--scenario", ".", "--pipeline", str(tmp_path / "wrong.toml")) == 2
    assert "unknown key 'step'. Did you mean 'steps'" in capsys.readouterr().err


def test_what_the_command_line_says_counts_above_the_pipeline(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pipelines = []

    def keep(pipeline: Pipeline, *_: object, **__: object) -> None:
        pipelines.append(pipeline)
        raise InputError("enough")

    monkeypatch.setattr(training, "train", keep)
    # 0.2 is the default, and said all the same; 0.1 is what lessons 2 and 3 of the file have.
    assert exit_code("--pipeline", "paper", "--clip", "0.2", "--workers=2", "--no-normalise") == 2
    assert exit_code("--pipeline", "paper", "--backend", "batch") == 2
    assert [lesson.clip for lesson in pipelines[0].lessons] == [0.2, 0.2, 0.2]
    assert [lesson.learning_rate for lesson in pipelines[0].lessons] == [3e-4, 3e-4, 1.5e-4]
    # "batch" is a backend there, and no option of that name.
    assert [lesson.batch for lesson in pipelines[1].lessons] == [1024, 1024, 1024]
    assert pipelines[0].run.workers == 2 and not pipelines[0].lessons[0].normalise


@pytest.mark.parametrize("flag", [["--trace", "0.9"], ["--trace=0.9"]])
def test_setting_by_its_old_name_is_refused_with_the_new_one(
    flag: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code("--scenario", "cave-train-1", *flag) == InputError.exit_code
    assert "--trace is called --gae-lambda now" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("flags", "advice"),
    [
        (["--buffer", "20480", "--num-envs=16"], "Use --n-steps 1280 (20480 / 16 environments)."),
        (["--buffer=4096"], "Use --n-steps 4096 / num_envs."),
        (["--num-envs", "3", "--buffer", "128"], "Use --n-steps 128 / 3."),
    ],
)
def test_a_buffer_is_refused_with_the_steps_of_each_environment(
    flags: list[str], advice: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code("--scenario", "cave-train-1", *flags) == InputError.exit_code
    said = " ".join(capsys.readouterr().err.split())
    assert "--n-steps counts those of each" in said and advice in said


def test_neither_pipeline_nor_scenario_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("-o", "nowhere") == 2
    assert "names no scenario" in capsys.readouterr().err


def test_senseless_setting_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("--scenario", ".", "--num-envs", "3", "--n-steps", "32", "--batch", "64") == 2
    told = " ".join(capsys.readouterr().err.replace("│", " ").split())  # older versions of tyro draw a box around it
    assert "A rollout has 96 decisions (n_steps 32 x num_envs 3), which batch (64) must divide" in told


def test_another_vehicle_learns_and_belongs_to_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    long = write_vehicle(tmp_path / "long.toml", 0.2, 5.0)
    write_scenario(tube_scenario(limits=LimitSettings(decisions=40)), tmp_path / "tube")
    small = ["--n-steps", "64", "--batch", "64", "--num-envs", "2", "--hidden", "8", "--steps", "128"]
    run = ["--scenario", str(tmp_path / "tube"), "-o", str(tmp_path / "run"), *small]
    main([*run, "--vehicle", str(long)])
    assert f"--scenario {tmp_path / 'tube'} --vehicle {long}" in capsys.readouterr().out
    record = json.loads((tmp_path / "run" / "train.json").read_text())
    assert record["run"]["vehicle"] == str(long)
    assert record["scenarios"][0]["vehicle"]["left_out"] == [0, 1, 2, 3]
    assert exit_code(*run) == 2
    assert "holds another training run, with run.vehicle" in capsys.readouterr().err.replace("\n", " ")
    write_vehicle(long, 0.2, 5.5)
    assert exit_code(*run, "--vehicle", str(long)) == 2
    assert "vehicle.sha256" in capsys.readouterr().err.replace("\n", " ")


def test_a_vehicle_that_does_not_fit_does_not_learn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_scenario(tube_scenario(), tmp_path / "tube")
    assert exit_code("--scenario", str(tmp_path / "tube"), "-o", str(tmp_path / "run"), "--vehicle", "boat") == 2
    assert "9.40 m long, 3.09 m wide" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
