"""`import aquanav` is quick, has nine functions and always has them, and says what the commands say."""

from __future__ import annotations

import importlib
import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import aquanav
import aquanav_tools
from aquanav_tools.cli.evaluate import main as evaluate_command
from aquanav_tools.cli.train import main as train_command
from aquanav_tools.errors import AquanavError, InputError, ScenarioError
from tests.commands import run_here
from tests.test_imports import HEAVY

NAMES = {
    "build_cave", "compare", "evaluate", "load_policy", "load_scenario", "make_env", "make_vec_env", "replay", "train",
}  # fmt: skip
MAX_SECONDS = 0.3


def in_a_new_process(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("package", ["aquanav", "aquanav_tools"])
def test_importing_the_package_loads_no_heavy_library(package: str) -> None:
    heavy = sorted({*HEAVY, "gymnasium", "stable_baselines3", "trimesh", "tyro", "tqdm"})
    assert in_a_new_process(f"import sys, {package}; print(*set({heavy}) & sys.modules.keys())").split() == []


@pytest.mark.parametrize("package", ["aquanav", "aquanav_tools"])
def test_importing_the_package_takes_under_a_third_of_a_second(package: str) -> None:
    code = f"import time; t = time.perf_counter(); import {package}; print(time.perf_counter() - t)"
    assert min(float(in_a_new_process(code)) for _ in range(3)) < MAX_SECONDS


def test_both_packages_have_the_nine_functions() -> None:
    for name in NAMES:
        found = getattr(aquanav, name)
        assert inspect.isfunction(found) and found is getattr(aquanav_tools, name)
    assert set(aquanav.__all__) == set(aquanav_tools.__all__) == NAMES
    assert set(dir(aquanav)) >= NAMES <= set(dir(aquanav_tools))


def test_train_and_evaluate_stay_functions_when_the_rooms_of_their_names_are_imported() -> None:
    code = (
        "import aquanav_tools.train.settings, aquanav_tools.evaluate.options, inspect;"
        "from aquanav_tools import evaluate, train;"
        " print(inspect.isfunction(train), inspect.isfunction(evaluate), inspect.isfunction("
        "aquanav_tools.train))"
    )
    assert in_a_new_process(code).split() == ["True"] * 3


def test_an_unknown_name_is_an_attribute_error() -> None:
    for package in (aquanav, aquanav_tools):
        with pytest.raises(AttributeError, match="no attribute 'trian'"):
            package.trian  # noqa: B018
    with pytest.raises(ImportError):
        importlib.import_module("aquanav_tools.trian")


@pytest.mark.parametrize("name", sorted(NAMES))
def test_a_signature_has_plain_keywords_and_the_docstring_tells_of_each(name: str) -> None:
    function = getattr(aquanav, name)
    documentation = inspect.getdoc(function) or ""
    assert "Raises:" in documentation
    for parameter in inspect.signature(function).parameters.values():
        assert "Options" not in str(parameter.annotation) and "Settings" not in str(parameter.annotation)
        assert f"{parameter.name}: " in documentation


WRONG: list[tuple[str, dict[str, Any], type[AquanavError], str]] = [
    ("train", {"scenario": "caves/none"}, ScenarioError, "is not a scenario"),
    ("train", {"scenario": "cave-test-1", "step": 5}, InputError, "unknown key 'step'. Did you mean 'steps'"),
    ("train", {"pipeline": "papre"}, InputError, "Did you mean 'paper'"),
    ("evaluate", {"policy": "baseline:orcale", "scenario": "x"}, InputError, "Did you mean 'oracle'"),
    ("evaluate", {"policy": "baseline:oracle", "scenario": "x", "episode": 5}, InputError, "Did you mean 'episodes'"),
    ("evaluate", {"policy": "baseline:oracle", "scenario": "x", "episodes": 0}, InputError, "--episodes is 0;"),
    ("evaluate", {"policy": "baseline:oracle", "scenario": "x", "protocol": "papr"}, InputError, "mean 'paper'"),
    ("evaluate", {"policy": max, "scenario": "x", "workers": 2}, InputError, "flies in this process"),
    ("make_vec_env", {"scenario": "x", "num_envs": 2, "kind": "sb4"}, InputError, "Did you mean 'sb3'"),
    ("build_cave", {"input": "none.stl", "output": "out"}, InputError, "There is no file or folder none.stl"),
    ("build_cave", {"input": "none.stl", "output": "out", "unti": "cm"}, InputError, "Did you mean 'unit'"),
    ("build_cave", {"input": "none.stl", "output": "out", "unit": "inch"}, InputError, "Did you mean 'in'"),
    ("load_scenario", {"scenario": "cave-tset-1"}, ScenarioError, "nearest names are cave-test-1"),
    ("compare", {"evaluations": "none"}, InputError, "holds no results.json"),
    ("replay", {"results": "none", "episode": 0}, InputError, "none"),
    ("load_policy", {"policy": 5}, InputError, "cannot be called"),
]


@pytest.mark.parametrize(("name", "arguments", "error", "sentence"), WRONG)
def test_a_wrong_argument_is_told_in_a_sentence(
    name: str, arguments: dict[str, Any], error: type[AquanavError], sentence: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=sentence):
        getattr(aquanav, name)(**arguments)
    assert list(tmp_path.glob("out/*/*")) == []


def test_the_commands_tell_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for call, command in (
        (lambda: aquanav.train("caves/none"), lambda: run_here(train_command, "--scenario", "caves/none")),
        (
            lambda: aquanav.evaluate("baseline:orcale", "x"),
            lambda: run_here(evaluate_command, "baseline:orcale", "--scenario", "x"),
        ),
    ):
        with pytest.raises(AquanavError) as told:
            call()
        assert str(told.value) in command().stderr
