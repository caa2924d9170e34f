"""A policy's own file says what it observes."""

from __future__ import annotations

import json
import shutil
import zipfile
from pathlib import Path
from typing import Any

import onnx
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.evaluation import evaluate
from aquanav_tools.evaluate.options import EvaluateOptions, SequentialOptions
from aquanav_tools.evaluate.paired_run import compare_pair_by_pair
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.water_impact import measure_water_impact
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.train.training import train
from tests.train.runs import tiny_pipeline, tiny_tube

SEEN: dict[str, Any] = {"observation": "full", "sensors": ("echosounders", "depth"), "history": (3, 7)}
NUM_VALUES = (44 + 16 + 1) * 3


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run whose policy observes sensors and earlier decisions."""
    folder = tmp_path_factory.mktemp("observed")
    train(tiny_pipeline(tiny_tube(folder / "tube"), steps=128, **SEEN), 0, folder / "run")
    return folder


def with_observed(learned: Path, to: Path, observed: object) -> Path:
    """Return a copy of the policy in `to` whose file says something else."""
    copy = Path(shutil.copy(learned / "run" / "policy.zip", to / "policy.zip"))
    with zipfile.ZipFile(copy) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    members["data"] = json.dumps(json.loads(members["data"]) | {"observed": observed}).encode()
    with zipfile.ZipFile(copy, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return copy


@pytest.mark.parametrize("suffix", [".zip", ".onnx"])
def test_a_policy_is_let_observe_what_it_learned_with_unasked(learned: Path, tmp_path: Path, suffix: str) -> None:
    policy, tube = learned / "run" / f"policy{suffix}", learned / "tube"
    loaded = load_policy(str(policy))
    assert loaded.size == NUM_VALUES
    results = [
        evaluate(
            EvaluateOptions(policies=(str(policy),), scenario=(tube,), episodes=4, record="none", **options),
            lambda done, total: None,
            output=tmp_path / name,
        )
        for name, options in {"unasked": {}, "named": SEEN}.items()
    ]
    unasked, named = (json.loads(result.results.read_text()) for result in results)
    assert {name: unasked["protocol"][name] for name in SEEN} == json.loads(json.dumps(SEEN)), "results say so"
    assert unasked["episodes"] == named["episodes"]


@pytest.mark.parametrize(
    ("observed", "message"),
    [
        ({**SEEN, "sensors": ["os:getcwd"]}, r"names? presets and sensors of aquanav's, no code"),
        ({**SEEN, "observation": "os:getcwd"}, r"no code, and at most 32"),
        ({**SEEN, "history": [1] * 33}, "no code, and at most 32"),
        ({**SEEN, "history": ["1"]}, "no code"),
        ({"observation": "full"}, "in another form than aquanav's what it observes"),
        (["full"], "in another form than aquanav's"),
    ],
)
def test_a_file_chooses_no_code_and_no_odd_form(learned: Path, tmp_path: Path, observed: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_policy(str(with_observed(learned, tmp_path, observed)))


def test_policies_that_observe_different_things_are_compared(learned: Path, tmp_path: Path) -> None:
    policies = (str(learned / "run" / "policy.zip"), "baseline:reactive")
    options = SequentialOptions(policies=policies, scenario=(learned / "tube",), episodes=2, output=tmp_path / "out")
    found = compare_pair_by_pair(options, lambda done, total: None)
    seen = [method.tables[0]["protocol"]["sensors"] for method in found.methods]
    assert seen == [list(SEEN["sensors"]), []]
    assert "different rules" not in found.report.read_text()


def test_the_water_is_tried_on_a_policy_with_what_it_observes(learned: Path) -> None:
    scenario, policy = read_scenario(learned / "tube"), load_policy(str(learned / "run" / "policy.zip"))
    with pytest.raises(InputError, match="goal"):  # it flies, and its 40 decisions are too few
        measure_water_impact(scenario, policy, ("full",), 1, 0, lambda done, total: None)


def test_a_sensor_that_there_is_not_gets_the_nearest_name(learned: Path, tmp_path: Path) -> None:
    policy = with_observed(learned, tmp_path, {**SEEN, "sensors": ["echosounder", "depth"]})
    options = EvaluateOptions(policies=(str(policy),), scenario=(learned / "tube",), episodes=1, record="none")
    with pytest.raises(InputError, match="Did you mean 'echosounders'"):
        evaluate(options, lambda done, total: None, output=tmp_path / "out")


def test_an_exported_file_chooses_no_code_either(learned: Path, tmp_path: Path) -> None:
    model = onnx.load(learned / "run" / "policy.onnx")
    for text, message in ((json.dumps({**SEEN, "sensors": ["os:getcwd"]}), "no code"), ("{", "another form than JSON")):
        onnx.helper.set_model_props(model, {"observed": text})
        onnx.save(model, tmp_path / "policy.onnx")
        with pytest.raises(InputError, match=message):
            load_policy(str(tmp_path / "policy.onnx"))
