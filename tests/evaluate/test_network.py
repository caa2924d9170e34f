from __future__ import annotations

import io
import json
import pickle
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from stable_baselines3 import A2C, DQN, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate import archive
from aquanav_tools.evaluate.network import NetworkPolicy
from aquanav_tools.policy.normaliser import NormalisedObservations
from tests.evaluate.models import ACTIONS, Still, make_model


@pytest.fixture(scope="session")
def saved_zip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("policy") / "policy.zip"
    make_model().save(path)
    return path


@pytest.fixture
def edit_zip(saved_zip: Path, tmp_path: Path) -> Callable[..., Path]:
    """Return a function that copies the good zip with some members replaced; None leaves a member out."""

    def edit(**members: bytes | None) -> Path:
        path = tmp_path / "edited.zip"
        replaced = {{"data": "data", "weights": "policy.pth"}.get(name, name): text for name, text in members.items()}
        with zipfile.ZipFile(saved_zip) as source, zipfile.ZipFile(path, "w") as target:
            contents = {name: source.read(name) for name in source.namelist()} | replaced
            for name, text in contents.items():
                if text is not None:
                    target.writestr(name, text)
        return path

    return edit


def edited_settings(saved_zip: Path, **changes: Any) -> bytes:
    with zipfile.ZipFile(saved_zip) as source:
        return json.dumps(json.loads(source.read("data")) | changes).encode()


@pytest.mark.parametrize("action", list(ACTIONS))
@pytest.mark.parametrize("kind", [PPO, A2C])
def test_rebuilt_policy_acts_as_the_saved_one(
    kind: type[BaseAlgorithm], action: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    model = make_model(kind, action)
    model.save(tmp_path / "policy.zip")
    policy = NetworkPolicy(tmp_path / "policy.zip")
    for observation in rng.uniform(-1.0, 1.0, (20, 44)).astype(np.float32):
        np.testing.assert_array_equal(policy.act(observation), model.predict(observation, deterministic=True)[0])


def test_separate_networks_for_actor_and_critic_are_rebuilt(tmp_path: Path) -> None:
    make_model(net_arch={"pi": [16, 8], "vf": [32]}).save(tmp_path / "policy.zip")
    NetworkPolicy(tmp_path / "policy.zip")


class WritesFile:
    """Unpickling this runs code: it writes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return (Path.write_text, (self.path, "pwned"))


def test_hostile_pickle_in_the_weights_is_not_run(edit_zip: Callable[..., Path], tmp_path: Path) -> None:
    witness = tmp_path / "witness"
    weights = io.BytesIO()
    torch.save({"log_std": WritesFile(witness)}, weights)
    torch.load(io.BytesIO(weights.getvalue()), weights_only=False)
    assert witness.exists()  # the attack is real
    witness.unlink()
    with pytest.raises(InputError, match="never run"):
        NetworkPolicy(edit_zip(weights=weights.getvalue()))
    with pytest.raises(InputError, match="never run"):
        NetworkPolicy(edit_zip(weights=pickle.dumps(WritesFile(witness))))
    assert not witness.exists()


def test_pickles_in_the_settings_are_not_run(edit_zip: Callable[..., Path], saved_zip: Path) -> None:
    with zipfile.ZipFile(saved_zip) as source:
        settings = json.loads(source.read("data"))

    def spoil(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: "bm90IGEgcGlja2xl" if key == ":serialized:" else spoil(item) for key, item in value.items()}
        return value

    NetworkPolicy(edit_zip(data=json.dumps(spoil(settings)).encode()))  # would fail if any of them were read


def test_truncated_zip_says_so(saved_zip: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.zip"
    path.write_bytes(saved_zip.read_bytes()[:-2000])
    with pytest.raises(InputError, match=r"not a readable zip.*cut off"):
        NetworkPolicy(path)


def test_zip_with_damaged_bytes_says_so(saved_zip: Path, tmp_path: Path) -> None:
    content = bytearray(saved_zip.read_bytes())
    with zipfile.ZipFile(saved_zip) as source:
        middle = source.getinfo("policy.pth").header_offset + 5000
    content[middle : middle + 100] = bytes(100)
    path = tmp_path / "damaged.zip"
    path.write_bytes(content)
    with pytest.raises(InputError, match="not a readable zip"):
        NetworkPolicy(path)


def test_missing_file_names_the_baselines(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no policy at .*baseline:reactive"):
        NetworkPolicy(tmp_path / "none.zip")


@pytest.mark.parametrize(("member", "name"), [("weights", "policy.pth"), ("data", "data")])
def test_zip_without_a_member_names_it(edit_zip: Callable[..., Path], member: str, name: str) -> None:
    with pytest.raises(InputError, match=f"no member {name}"):
        NetworkPolicy(edit_zip(**{member: None}))


def test_member_that_would_leave_the_folder_is_refused(edit_zip: Callable[..., Path]) -> None:
    with pytest.raises(InputError, match="Do not use it"):
        NetworkPolicy(edit_zip(**{"../evil": b"x"}))


def test_zip_bomb_is_refused_before_it_unpacks(edit_zip: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_MEMBER_BYTES", 100_000)
    with pytest.raises(InputError, match="unpacks to"):
        NetworkPolicy(edit_zip())


def test_weights_that_are_not_finite_are_refused(edit_zip: Callable[..., Path]) -> None:
    weights = make_model().policy.state_dict()
    weights["action_net.bias"] = torch.full_like(weights["action_net.bias"], torch.nan)
    stream = io.BytesIO()
    torch.save(weights, stream)
    with pytest.raises(InputError, match=r"not finite in action_net\.bias"):
        NetworkPolicy(edit_zip(weights=stream.getvalue()))


def test_weights_of_another_network_are_refused(edit_zip: Callable[..., Path]) -> None:
    stream = io.BytesIO()
    torch.save(make_model(net_arch=[64]).policy.state_dict(), stream)
    with pytest.raises(InputError, match="do not fit its own settings"):
        NetworkPolicy(edit_zip(weights=stream.getvalue()))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"policy_kwargs": {"features_extractor_class": "x"}}, "features_extractor_class"),
        ({"policy_kwargs": {"net_arch": [10**9]}}, "layers"),
        ({"policy_kwargs": {"activation_fn": "<class 'os.system'>"}}, "activation system"),
        ({"use_sde": True}, "use_sde"),
        ({"observation_space": {":type:": "<class 'gymnasium.spaces.dict.Dict'>"}}, "observation space is a Dict"),
        ({"observation_space": {":type:": "<class 'gymnasium.spaces.box.Box'>"}}, "cannot be read"),
        ({"observation_space": None}, "cannot be read"),
    ],
)
def test_settings_that_cannot_be_rebuilt_are_named(
    edit_zip: Callable[..., Path], saved_zip: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        NetworkPolicy(edit_zip(data=edited_settings(saved_zip, **changes)))


@pytest.mark.parametrize("text", [b"{", b"[]", b"\xff\xfe", b"[" * 100_000])
def test_settings_that_are_no_json_table_are_refused(edit_zip: Callable[..., Path], text: bytes) -> None:
    with pytest.raises(InputError, match="settings in"):
        NetworkPolicy(edit_zip(data=text))


def test_policy_of_another_algorithm_is_named(tmp_path: Path) -> None:
    DQN("MlpPolicy", Still(ACTIONS["discrete"]), device="cpu", buffer_size=10).save(tmp_path / "dqn.zip")
    with pytest.raises(InputError, match="class DQNPolicy"):
        NetworkPolicy(tmp_path / "dqn.zip")


@pytest.mark.parametrize("kind", [SAC, TD3])
def test_off_policy_actor_is_rebuilt(kind: type[BaseAlgorithm], tmp_path: Path, rng: np.random.Generator) -> None:
    kwargs = {"net_arch": [16, 16], "features_extractor_class": NormalisedObservations}
    model: Any = kind("MlpPolicy", Still(ACTIONS["continuous"]), policy_kwargs=kwargs, buffer_size=10, device="cpu")
    model.save(tmp_path / "policy.zip")
    policy = NetworkPolicy(tmp_path / "policy.zip")
    for observation in rng.uniform(-1.0, 1.0, (5, 44)).astype(np.float32):
        np.testing.assert_array_equal(policy.act(observation), model.predict(observation, deterministic=True)[0])


def test_memory_is_kept_within_an_episode_and_forgotten_after_it(tmp_path: Path, rng: np.random.Generator) -> None:
    contrib = pytest.importorskip("sb3_contrib")
    kwargs = {"net_arch": [16], "lstm_hidden_size": 8, "features_extractor_class": NormalisedObservations}
    env = Still(ACTIONS["continuous"])
    model = contrib.RecurrentPPO("MlpLstmPolicy", env, policy_kwargs=kwargs, seed=0, device="cpu")
    model.save(tmp_path / "policy.zip")
    policy = NetworkPolicy(tmp_path / "policy.zip")
    observations = rng.uniform(-1.0, 1.0, (4, 44)).astype(np.float32)
    for _ in range(2):
        policy.reset(0)
        memory = None
        for observation in observations:
            action, memory = model.predict(observation, memory, deterministic=True)
            np.testing.assert_array_equal(policy.act(observation), action)


def test_policy_brings_its_observation_scaling_along(tmp_path: Path, rng: np.random.Generator) -> None:
    model = make_model(net_arch=[16], features_extractor_class=NormalisedObservations)
    seen = rng.normal(0.3, 0.05, (1000, 44)).astype(np.float32)
    model.policy.features_extractor.take_in(seen)
    model.save(tmp_path / "policy.zip")
    network = NetworkPolicy(tmp_path / "policy.zip")._network
    np.testing.assert_array_equal(network.features_extractor.mean, model.policy.features_extractor.mean)
    # 0.05 / sqrt(1000) is the standard error of the mean of what was seen; five of them.
    np.testing.assert_allclose(network.features_extractor.mean, 0.3, atol=5 * 0.05 / np.sqrt(1000))


def test_file_that_is_no_zip_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.zip"
    shutil.copyfile(__file__, path)
    with pytest.raises(InputError, match="not a readable zip"):
        NetworkPolicy(path)
