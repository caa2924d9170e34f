"""Beginning with the weights of another run's policy."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import pickle
import shutil
import zipfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

from aquanav_tools.envs.observation import layout
from aquanav_tools.errors import InputError
from aquanav_tools.policy.observed import OBSERVED
from aquanav_tools.train import training
from aquanav_tools.train.checkpoint import read_checkpoint
from aquanav_tools.train.settings import RunSettings
from aquanav_tools.train.training import train
from tests.train.runs import learned, tiny_pipeline, tiny_tube

STILL = {"learning_rate": 1e-30, "steps": 128}
"""A run of one update, which moves no weight."""


@pytest.fixture(scope="module")
def tube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_tube(tmp_path_factory.mktemp("scenario") / "tube")


@pytest.fixture(autouse=True)
def no_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare a second for each run."""
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)


@pytest.fixture(scope="module")
def old(tube: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two updates, of 256 decisions."""
    folder = tmp_path_factory.mktemp("old")
    train(tiny_pipeline(tube, steps=256, learning_rate=1e-2), 0, folder)
    return folder


def beginning_with(policy: Path | str, **changes: Any) -> RunSettings:
    return RunSettings(checkpoint_every=128, final_episodes=0, init=str(policy), **changes)


def state_of(folder: Path) -> dict[str, Any]:
    checkpoint = read_checkpoint(folder)
    assert checkpoint is not None
    parameters: dict[str, Any] = checkpoint.learner["parameters"]
    return parameters


@pytest.mark.parametrize("algorithm", ["ppo", "recurrent-ppo", "sac", "td3"])
def test_run_begins_with_weights_and_statistics_and_a_fresh_optimiser(
    algorithm: str, tube: Path, tmp_path: Path
) -> None:
    if algorithm == "recurrent-ppo":
        pytest.importorskip("sb3_contrib")
    form = {"algorithm": algorithm, "action": "continuous" if algorithm in ("sac", "td3") else "multidiscrete"}
    train(tiny_pipeline(tube, steps=256, learning_rate=1e-2, **form), 0, tmp_path / "old")
    run = beginning_with(tmp_path / "old" / "policy.zip")
    train(tiny_pipeline(tube, run=run, **STILL, **form), 7, tmp_path / "new")
    train(tiny_pipeline(tube, **STILL, **form), 7, tmp_path / "fresh")
    weights, begun, fresh = (state_of(tmp_path / name)["policy"] for name in ("old", "new", "fresh"))
    moved = [name for name in weights if "target" not in name and "features_extractor" not in name]
    assert moved and all(torch.equal(weights[name], begun[name]) for name in moved)
    assert not all(torch.equal(weights[name], fresh[name]) for name in moved)
    counts = [name for name in weights if name.endswith("features_extractor.count")]
    assert {int(begun[name]) - int(weights[name]) for name in counts} == {128}  # what the new run saw
    optimisers = [table for name, table in state_of(tmp_path / "new").items() if name.endswith("optimizer")]
    alone = [table for name, table in state_of(tmp_path / "fresh").items() if name.endswith("optimizer")]
    assert [_steps(one) for one in optimisers] == [_steps(one) for one in alone]


def _steps(optimiser: dict[str, Any]) -> list[int]:
    return [int(state["step"]) for state in optimiser["state"].values()]


def test_record_names_the_policy_by_its_hash_and_another_policy_is_another_run(
    old: Path, tube: Path, tmp_path: Path
) -> None:
    policy = tmp_path / "begin.zip"
    shutil.copy(old / "policy.zip", policy)
    train(tiny_pipeline(tube, run=beginning_with(policy), steps=128), 0, tmp_path / "run")
    record = json.loads((tmp_path / "run" / "train.json").read_text())
    digest = hashlib.sha256(policy.read_bytes()).hexdigest()
    assert record["init"] == {"file": "begin.zip", "sha256": digest}
    assert train(tiny_pipeline(tube, run=beginning_with(policy), steps=128), 0, tmp_path / "run").was_finished
    with pytest.raises(InputError, match="holds another training run, with init"):
        train(tiny_pipeline(tube, steps=128), 0, tmp_path / "run")
    train(tiny_pipeline(tube, steps=128), 1, tmp_path / "other")
    shutil.copy(tmp_path / "other" / "policy.zip", policy)
    with pytest.raises(InputError, match=r"holds another training run, with init.sha256"):
        train(tiny_pipeline(tube, run=beginning_with(policy), steps=128), 0, tmp_path / "run")


def test_folder_of_a_run_stands_for_its_best_policy(old: Path, tube: Path, tmp_path: Path) -> None:
    shutil.copytree(old, tmp_path / "old")
    train(tiny_pipeline(tube, run=beginning_with(tmp_path / "old"), steps=128), 0, tmp_path / "last")
    (tmp_path / "old" / "policy.zip").rename(tmp_path / "old" / "best.zip")
    train(tiny_pipeline(tube, run=beginning_with(tmp_path / "old"), steps=128), 0, tmp_path / "best")
    records = [json.loads((tmp_path / name / "train.json").read_text()) for name in ("last", "best")]
    assert [record["init"]["file"] for record in records] == ["policy.zip", "best.zip"]
    assert learned(tmp_path / "last") == learned(tmp_path / "best")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"hidden": (16,)}, r"made with net_arch \[8\], and this run makes \[16\]. Choose --hidden"),
        ({"observation": "full"}, r"observation space Box of 31 values, and this run Box of 44 values"),
        ({"action": "discrete"}, r"action space MultiDiscrete\(\[3, 3, 3\]\), and this run Discrete\(27\)"),
        ({"normalise": False}, r"made with is_normalised True, and this run makes False"),
        (
            {"algorithm": "sac", "action": "continuous"},
            r"action space MultiDiscrete\(\[3, 3, 3\]\), and this run Box of 3 values",
        ),
    ],
)
def test_policy_that_does_not_fit_is_refused_with_both_forms_before_anything_is_lost(
    changes: dict[str, Any], message: str, old: Path, tube: Path, tmp_path: Path
) -> None:
    train(tiny_pipeline(tube, steps=128), 0, tmp_path)
    before = learned(tmp_path)
    with pytest.raises(InputError, match=message):
        train(tiny_pipeline(tube, run=beginning_with(old), **changes), 0, tmp_path, overwrite=True)
    assert learned(tmp_path) == before


def test_policy_with_fewer_sensors_acts_as_before_until_it_has_learned(tube: Path, tmp_path: Path) -> None:
    form = {"observation": "full", "masked_observations": ("depth",)}
    train(tiny_pipeline(tube, steps=256, learning_rate=1e-2, **form), 0, tmp_path / "old")
    run, wider = beginning_with(tmp_path / "old"), form | {"sensors": ("echosounders",)}
    train(tiny_pipeline(tube, run=run, **STILL, **wider), 7, tmp_path / "new")
    weights, begun = (state_of(tmp_path / name)["policy"] for name in ("old", "new"))
    for name in ("mlp_extractor.policy_net.0.weight", "mlp_extractor.value_net.0.weight"):
        assert torch.equal(begun[name][:, :44], weights[name]) and begun[name][:, 44:].abs().max() < 1e-20
    assert torch.equal(begun["action_net.weight"], weights["action_net.weight"])
    assert int(begun["features_extractor.count"]) == 128  # all of them what the new run saw
    ranges = begun["features_extractor.mean"][44:]
    assert ((ranges > 0.1) & (ranges < 4.0)).all()
    with pytest.raises(InputError, match=r"action space MultiDiscrete\(\[3, 3, 3\]\), and this run Discrete\(27\)"):
        train(tiny_pipeline(tube, run=run, **STILL, **wider, action="discrete"), 7, tmp_path / "otherwise")
    with pytest.raises(InputError, match=r"observation space Box of 60 values, and this run Box of 44 values"):
        train(tiny_pipeline(tube, run=beginning_with(tmp_path / "new"), **STILL, **form), 7, tmp_path / "narrower")


def test_an_older_file_that_names_nothing_is_known_by_its_size(tube: Path, tmp_path: Path) -> None:
    form = {"observation": "full", "masked_observations": ("depth",)}
    train(tiny_pipeline(tube, steps=128, **form), 0, tmp_path / "old")
    with (
        zipfile.ZipFile(tmp_path / "old" / "policy.zip") as source,
        zipfile.ZipFile(tmp_path / "older.zip", "w") as target,
    ):
        for name in source.namelist():
            content = source.read(name)
            if name == "data":
                settings = json.loads(content)
                del settings[OBSERVED]
                content = json.dumps(settings).encode()
            target.writestr(name, content)
    wider = form | {"sensors": ("echosounders",)}
    for name in ("old/policy.zip", "older.zip"):
        folder = tmp_path / name.replace("/policy.zip", "-new").replace(".zip", "-new")
        train(tiny_pipeline(tube, run=beginning_with(tmp_path / name), **STILL, **wider), 7, folder)
    weights, begun = (state_of(tmp_path / name)["policy"] for name in ("old-new", "older-new"))
    assert all(torch.equal(weights[name], begun[name]) for name in weights)


def test_a_waypoint_in_the_goals_place_begins_with_its_weights(tube: Path, tmp_path: Path) -> None:
    """The policy was kept from seeing the distance: its weights for that mean nothing, and are not handed over."""
    form = {"observation": "full", "masked_observations": ("distance", "depth")}
    train(tiny_pipeline(tube, steps=256, learning_rate=1e-2, **form), 0, tmp_path / "old")
    hidden = ("distance", "azimuth", "elevation", "depth")
    run, wider = beginning_with(tmp_path / "old"), form | {"sensors": ("waypoint",), "masked_observations": hidden}
    pipeline = tiny_pipeline(tube, run=dataclasses.replace(run, backend="batch"), **STILL, **wider)
    train(pipeline, 7, tmp_path / "new")
    weights, begun = (state_of(tmp_path / name)["policy"] for name in ("old", "new"))
    goal = layout("full")["goal"].start
    for name in ("mlp_extractor.policy_net.0.weight", "mlp_extractor.value_net.0.weight"):
        assert torch.equal(begun[name][:, 45:47], weights[name][:, goal + 1 : goal + 3])
        assert begun[name][:, [44, 47]].abs().max() < 1e-20
    visible = wider | {"masked_observations": ("distance", "depth")}
    pipeline = tiny_pipeline(tube, run=dataclasses.replace(run, backend="batch"), **STILL, **visible)
    train(pipeline, 7, tmp_path / "both")
    assert state_of(tmp_path / "both")["policy"]["mlp_extractor.policy_net.0.weight"][:, 44:].abs().max() < 1e-20


class Task(gymnasium.Env[Any, Any]):
    """Has the spaces of the tiny runs, and nothing else."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (31,), np.float32)
    action_space = gymnasium.spaces.MultiDiscrete([3, 3, 3])


@pytest.mark.parametrize(
    ("network", "message"),
    [
        ({"net_arch": [8]}, "made with activation_fn Tanh, and this run makes SiLU"),
        (
            {"net_arch": {"pi": [8], "vf": [9]}, "activation_fn": torch.nn.SiLU},
            r"has 9 float32 as mlp_extractor.value_net.0.bias, and this run's network 8 float32",
        ),
    ],
)
def test_policy_of_another_make_is_not_taken_for_one_of_ours(
    network: dict[str, Any], message: str, tube: Path, tmp_path: Path
) -> None:
    PPO("MlpPolicy", Task(), policy_kwargs=network, device="cpu").save(tmp_path / "theirs.zip")
    run = beginning_with(tmp_path / "theirs.zip")
    with pytest.raises(InputError, match=message):
        train(tiny_pipeline(tube, run=run, normalise=False), 0, tmp_path / "run")


def test_policy_that_was_kept_from_seeing_is_not_shown_more(tube: Path, tmp_path: Path) -> None:
    train(tiny_pipeline(tube, steps=128, masked_observations=("distance",)), 0, tmp_path / "blind")
    run = beginning_with(tmp_path / "blind")
    with pytest.raises(InputError, match=r"distance, and this run shows it. Add --masked-observations distance"):
        train(tiny_pipeline(tube, run=run, steps=128), 0, tmp_path / "run")
    train(tiny_pipeline(tube, run=run, steps=128, masked_observations=("distance",)), 0, tmp_path / "run")


class Bomb:
    """Makes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self.path,)


def test_hostile_weights_are_not_run(old: Path, tube: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(old / "policy.zip") as source, zipfile.ZipFile(tmp_path / "bad.zip", "w") as target:
        for name in source.namelist():
            bomb = pickle.dumps(Bomb(tmp_path / "ran"))
            target.writestr(name, bomb if name == "policy.pth" else source.read(name))
    with pytest.raises(InputError, match=r"bad.zip are not plain tensors"):
        train(tiny_pipeline(tube, run=beginning_with(tmp_path / "bad.zip")), 0, tmp_path / "run")
    assert not (tmp_path / "ran").exists() and not (tmp_path / "run").exists()


def test_missing_policy_is_told_with_what_to_name(tube: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no policy at .*none.zip to begin with. Give --init a policy.zip"):
        train(tiny_pipeline(tube, run=beginning_with(tmp_path / "none.zip")), 0, tmp_path / "run")
    with pytest.raises(InputError, match=r"is a folder without best.zip or policy.zip"):
        train(tiny_pipeline(tube, run=beginning_with(tube)), 0, tmp_path / "run")
    with pytest.raises(InputError, match="Did you mean 'reference'"):
        train(tiny_pipeline(tube, run=beginning_with("baseline:referense")), 0, tmp_path / "run")
