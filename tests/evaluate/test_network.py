from __future__ import annotations

import base64
import io
import json
import pickle
import resource
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_baselines3
import torch
from gymnasium import spaces
from stable_baselines3 import A2C, DQN, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.network import NetworkPolicy
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.policy import archive
from aquanav_tools.policy.architecture import ExoticPolicyError
from aquanav_tools.policy.normaliser import NormalisedObservations
from aquanav_tools.scenario.schema import Scenario
from tests.evaluate.models import make_model, model_for

ROUNDING = 2.0**-21
"""Of an action in [-1, 1], in float32: the library scales it to the space's bounds and back, and adds up in another
order than layers whose widths are filled up (measured: 1.5 * 2^-23)."""


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


def assert_acts_alike(model: BaseAlgorithm, path: Path, rng: np.random.Generator) -> None:
    """Hold a rebuilt policy against the library's, over two episodes of observations."""
    model.save(path)
    policy = NetworkPolicy(path)
    for seed in range(2):
        policy.reset(seed)
        state, is_first = None, np.ones(1, dtype=bool)
        for observation in rng.uniform(-1.0, 1.0, (50, 44)).astype(np.float32):
            expected, state = model.predict(observation, state=state, episode_start=is_first, deterministic=True)
            np.testing.assert_allclose(policy.act(observation), expected, rtol=0.0, atol=ROUNDING)
            is_first = np.zeros(1, dtype=bool)


SWISH: dict[str, Any] = {"net_arch": [24, 16], "activation_fn": torch.nn.SiLU}
TRAINED = [
    (PPO, "multidiscrete", SWISH),
    (PPO, "continuous", {"net_arch": {"pi": [16, 8], "vf": [32]}}),
    (A2C, "discrete", {}),
    (DQN, "discrete", {}),
    (DQN, "discrete", SWISH),
    (SAC, "continuous", {}),
    (SAC, "continuous", {"net_arch": {"pi": [16], "qf": [32]}, "activation_fn": torch.nn.ELU}),
    (TD3, "continuous", {}),
    (TD3, "continuous", SWISH),
]


@pytest.mark.parametrize(
    ("kind", "action", "kwargs"), TRAINED, ids=lambda value: getattr(value, "__name__", str(value)[:20])
)
def test_rebuilt_policy_acts_as_the_trained_one(
    kind: type[BaseAlgorithm],
    action: str,
    kwargs: dict[str, Any],
    tube: Scenario,
    tmp_path: Path,
    rng: np.random.Generator,
) -> None:
    env = CaveEnv(tube, action=action)
    model = model_for(kind, env, **kwargs).learn(24)
    env.close()
    assert_acts_alike(model, tmp_path / "policy.zip", rng)


SHARED: dict[str, Any] = {"n_lstm_layers": 2, "shared_lstm": True, "enable_critic_lstm": False, **SWISH}


@pytest.mark.parametrize("kwargs", [{}, SHARED])
def test_rebuilt_recurrent_policy_acts_as_the_trained_one_and_forgets_between_episodes(
    kwargs: dict[str, Any], tube: Scenario, tmp_path: Path, rng: np.random.Generator
) -> None:
    contrib = pytest.importorskip("sb3_contrib", reason="RecurrentPPO is sb3-contrib's: pip install -e '.[dev]'")
    env = CaveEnv(tube)
    model = model_for(contrib.RecurrentPPO, env, **{"lstm_hidden_size": 16, **kwargs}).learn(16)
    env.close()
    assert_acts_alike(model, tmp_path / "policy.zip", rng)


@pytest.mark.parametrize(
    ("kind", "action"), [("PPO", "multidiscrete"), ("SAC", "continuous"), ("TD3", "continuous"), ("RecurrentPPO", "")]
)
def test_rebuilt_policy_scales_observations_as_the_trained_one(
    kind: str, action: str, tube: Scenario, tmp_path: Path, rng: np.random.Generator
) -> None:
    library = stable_baselines3 if hasattr(stable_baselines3, kind) else pytest.importorskip("sb3_contrib")
    env = CaveEnv(tube, action=action or "multidiscrete")
    model = model_for(getattr(library, kind), env, net_arch=[16], features_extractor_class=NormalisedObservations)
    env.close()
    normalisers = [part for part in model.policy.modules() if isinstance(part, NormalisedObservations)]
    assert normalisers
    for normaliser in normalisers:
        normaliser.take_in(rng.normal(0.3, 0.2, (100, 44)).astype(np.float32))
    assert_acts_alike(model, tmp_path / "policy.zip", rng)


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


def test_hostile_pickle_in_the_settings_is_not_run_unless_trusted(
    edit_zip: Callable[..., Path], saved_zip: Path, tmp_path: Path
) -> None:
    witness = tmp_path / "witness"
    payload = base64.b64encode(pickle.dumps(WritesFile(witness))).decode()
    entry = {":type:": "<class 'mine'>", ":serialized:": payload, "__module__": "mine"}
    path = edit_zip(data=edited_settings(saved_zip, policy_class=entry))
    with pytest.raises(InputError, match="--trust"):
        load_policy(str(path))
    assert not witness.exists()
    with pytest.raises(InputError, match="cannot load"):
        load_policy(str(path), is_trusted=True)
    assert witness.exists()  # the attack is real: the library does run it


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
        ({"policy_kwargs": {"net_arch": [10**9]}}, "layers"),
        ({"observation_space": {":type:": "<class 'gymnasium.spaces.graph.Graph'>"}}, "observation space is a Graph"),
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


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"policy_class": {"__module__": "mine", "__init__": "<function ActorCriticPolicy.__init__ at 0x1>"}},
            r"class mine\.ActorCriticPolicy.*RecurrentPPO.*--trust",
        ),
        ({"policy_class": "MlpPolicy"}, r"nothing readable.*--trust"),
        ({"use_sde": True}, r"use_sde.*--trust"),
        ({"policy_kwargs": {"features_extractor_class": "x"}}, r"features_extractor_class.*--trust"),
        ({"policy_kwargs": {"activation_fn": "<class 'mine.Tanh'>"}}, r"activation <class 'mine\.Tanh'>.*--trust"),
        (
            {"policy_kwargs": {"activation_fn": "<class 'torch.nn.modules.activation.Tahn'>"}},
            r"Did you mean 'Tanh'\? .*--trust",
        ),
    ],
)
def test_exotic_policy_is_told_what_was_found_and_how_to_trust_it(
    edit_zip: Callable[..., Path], saved_zip: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ExoticPolicyError, match=message):
        NetworkPolicy(edit_zip(data=edited_settings(saved_zip, **changes)))


def test_levels_in_other_bounds_are_refused(tmp_path: Path) -> None:
    make_model(action=spaces.Box(-2.0, 2.0, (3,))).save(tmp_path / "policy.zip")
    with pytest.raises(InputError, match=r"low is \[-2\. -2\. -2\.\].*from -1 to 1"):
        NetworkPolicy(tmp_path / "policy.zip")


def test_widths_that_only_the_settings_claim_take_no_memory(edit_zip: Callable[..., Path], saved_zip: Path) -> None:
    claimed = edited_settings(saved_zip, policy_kwargs={"net_arch": [8192] * 16})  # 4 GB of weights
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match="do not fit its own settings"):
        NetworkPolicy(edit_zip(data=claimed))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before + 200_000  # kB


def test_file_that_is_no_zip_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.zip"
    shutil.copyfile(__file__, path)
    with pytest.raises(InputError, match="not a readable zip"):
        NetworkPolicy(path)


def test_what_is_not_finite_is_no_choice(tmp_path: Path) -> None:
    make_model().save(tmp_path / "policy.zip")
    policy = NetworkPolicy(tmp_path / "policy.zip")
    with pytest.raises(ValueError, match="not finite"):
        policy.decide(np.array([0.0] * 8 + [np.nan], dtype=np.float32))
