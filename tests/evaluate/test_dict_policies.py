"""Policies that observe a dictionary of parts: rebuilt from zips as the library has them, named, and refused."""

from __future__ import annotations

import base64
import json
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, DQN, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm

import aquanav
from aquanav_tools.envs.sb3_env import BatchedVecEnv
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.episode_counts import usual_episodes
from aquanav_tools.evaluate.evaluation import Evaluation
from aquanav_tools.evaluate.network import NetworkPolicy
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.policy.spaces import parse_space, shapes_of
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.sim.contacts import default_backend
from aquanav_tools.task import TaskOptions
from tests.caves import tube_scenario
from tests.evaluate.models import ACTIONS, Still, make_model
from tests.evaluate.test_network import ROUNDING
from tests.own_modules import WriteModule, own_module

__all__ = ["own_module"]

PARTS = {"the state": "paper", "imu": "imu", "speed": "dvl"}
NAMED: dict[str, Any] = {"observation": "the state=paper", "sensors": ("imu", "speed=dvl")}
SPACE = spaces.Dict(
    {
        "b": spaces.Box(-np.inf, np.inf, (3,)),
        "a": spaces.Box(np.array([-1.0, 0.0], np.float32), np.array([2.5, 1e9], np.float32)),
        'it\'s "one"': spaces.Box(0.0, 1.0, (4, 5)),
    }
)
BACKENDS = (default_backend(), "batch")
OWN = """
IMAGE = Box(0, 255, (40, 36, 1), np.uint8)

class Camera:
    def spec(self, scenario, vehicle):
        return IMAGE

    def measure(self, batch):
        shade = 255 * np.clip(batch.rays[:, :1] / batch.ray_lengths[0], 0.0, 1.0)
        return np.broadcast_to(shade[:, :, None, None], (batch.num, *IMAGE.shape))

PARTS = {"the state": "paper", "imu": "imu", "speed": "dvl"}

def parts():
    return dict(PARTS)

def camera():
    return {"camera": Camera(), "depth": "depth"}

def wrong():
    return [1]

def ahead(observation):
    assert sorted(observation) == ["imu", "speed", "the state"] and observation["speed"].shape == (5,)
    return [1, 1, 2]
"""


class StillParts(Still):
    """An environment in which nothing happens, with a dictionary for an observation."""

    def __init__(self, action: str, observation: spaces.Dict = SPACE) -> None:
        super().__init__(ACTIONS[action])
        self.observation_space = observation  # type: ignore[assignment]


def untrained(kind: type[BaseAlgorithm], action: str, observation: spaces.Dict = SPACE, **kwargs: Any) -> BaseAlgorithm:
    few: dict[str, Any] = {"buffer_size": 64} if kind in (DQN, SAC, TD3) else {"n_steps": 16}
    name = "MultiInputLstmPolicy" if kind is RecurrentPPO else "MultiInputPolicy"
    env = StillParts(action, observation)
    return kind(name, env, policy_kwargs=kwargs, seed=0, device="cpu", **few)


def drawn(rng: np.random.Generator, num: int) -> dict[str, Any]:
    shapes = shapes_of(SPACE)
    return {name: rng.normal(size=(num, *shape)).astype(np.float32) for name, shape in shapes.items()}


KINDS = [
    (PPO, "multidiscrete"), (PPO, "discrete"), (PPO, "continuous"), (A2C, "multidiscrete"), (DQN, "discrete"),
    (SAC, "continuous"), (TD3, "continuous"), (RecurrentPPO, "multidiscrete"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "action"), KINDS)
def test_a_rebuilt_policy_acts_as_the_library_has_it(
    kind: type[BaseAlgorithm], action: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    model = untrained(kind, action)
    model.save(tmp_path / "policy.zip")
    policy = NetworkPolicy(tmp_path / "policy.zip")
    seen, state, is_first = drawn(rng, 40), None, np.ones(1, dtype=bool)
    for row in range(40):
        one = {name: part[row] for name, part in seen.items()}
        expected, state = model.predict(one, state=state, episode_start=is_first, deterministic=True)
        np.testing.assert_allclose(policy.act(dict(reversed(one.items()))), expected, rtol=0.0, atol=ROUNDING)
        is_first = np.zeros(1, dtype=bool)


@pytest.mark.parametrize("kind", [PPO, RecurrentPPO])
def test_many_are_computed_as_each_alone_to_the_bit(
    kind: type[BaseAlgorithm], tmp_path: Path, rng: np.random.Generator
) -> None:
    untrained(kind, "continuous").save(tmp_path / "policy.zip")
    policy, alone = NetworkPolicy(tmp_path / "policy.zip"), NetworkPolicy(tmp_path / "policy.zip")
    seen = drawn(rng, 70)
    together = policy.logits(seen, np.arange(70))
    for row in (0, 63, 64, 69):
        one = alone.logits({name: part[row : row + 1] for name, part in seen.items()}, np.array([0]))
        alone.reset(0)
        assert np.array_equal(one[0], together[row])


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a policy of the library that learned a little from the parts in the tube."""
    env = BatchedVecEnv(tube_scenario(), 4, observation=dict(PARTS), max_decisions=20)
    model = PPO("MultiInputPolicy", env, n_steps=16, batch_size=16, seed=0, device="cpu")
    model.learn(128)
    env.close()
    path = tmp_path_factory.mktemp("learned") / "policy.zip"
    model.save(path)
    return path


@pytest.fixture
def cave(tmp_path: Path) -> Path:
    write_scenario(tube_scenario(), tmp_path / "tube")
    return tmp_path / "tube"


def score(policy: Any, cave: Path, output: str, backend: str = "batch", **options: Any) -> Evaluation:
    given = {"episodes": 3, "max_decisions": 40, "record": "none", "backend": backend, **options}
    given |= {} if backend == "batch" else {"workers": 1}
    return aquanav.evaluate(policy, cave, output=output, **given)


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_evaluated_zip_flies_as_the_library_would_fly_it(
    learned: Path, cave: Path, own_module: WriteModule, backend: str
) -> None:
    """The library's own model, called by a function that brings its dictionary, has the same episodes to the bit."""
    model = PPO.load(learned, device="cpu")

    def predict(observation: dict[str, Any]) -> Any:
        return model.predict(observation, deterministic=True)[0]

    predict.observation = dict(PARTS)  # type: ignore[attr-defined]
    expected = [one.digest for one in score(predict, cave, "library", backend).episodes]
    own = own_module(OWN)
    for number, named in enumerate((NAMED, {"observation": f"{own}:parts"}, {"observation": f"{own}:PARTS"})):
        found = score(str(learned), cave, f"zip{number}", backend, **named)
        assert [one.digest for one in found.episodes] == expected
        assert not any(one.reason for one in found.episodes)


@pytest.mark.parametrize("backend", BACKENDS)
def test_code_of_the_users_own_gets_the_dictionary(cave: Path, own_module: WriteModule, backend: str) -> None:
    own = own_module(OWN)
    for named in (NAMED, {"observation": f"{own}:parts"}):
        found = score(f"{own}:ahead", cave, "out", backend, **named).episodes
        assert [one.reason for one in found] == [""] * 3


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_episode_with_a_dictionary_is_replayed_and_its_code_only_if_trusted(
    learned: Path, cave: Path, own_module: WriteModule, backend: str
) -> None:
    score(str(learned), cave, "named", backend, **NAMED)
    assert aquanav.replay("named", 1).episode.index == 1
    own = own_module(OWN)
    score(str(learned), cave, "own", backend, observation=f"{own}:parts")
    with pytest.raises(InputError, match=f"names code: {own}:parts. A file runs none"):
        aquanav.replay("own", 1)
    assert aquanav.replay("own", 1, trust=True).episode.index == 1


@pytest.mark.parametrize("line", ['sensors = ["x={own}:Camera"]', 'observation = "x={own}:Camera"'])
def test_code_behind_a_name_is_refused_in_protocols(
    learned: Path, cave: Path, own_module: WriteModule, line: str
) -> None:
    own = own_module("open('imported', 'w')")
    Path("rules.toml").write_text(line.format(own=own) + "\n")
    with pytest.raises(InputError, match=f"rules.toml names code: x={own}:Camera. A file runs none"):
        score(str(learned), cave, "out", protocol="rules.toml")
    assert not Path("imported").exists()


@pytest.mark.parametrize(
    ("named", "words"),
    [
        ({}, r"a dictionary of 'imu' \(6\), 'speed' \(5\), 'the state' \(31\), and its file does not say what me"),
        ({"sensors": ("imu",)}, r"'the state' \(31\), and what is named is one of 'imu' \(6\). Name what it was tr"),
        (
            {"observation": "the state=full", "sensors": ("imu", "speed=dvl")},
            r"'the state' \(31\), and what is named is one of 'imu' \(6\), 'speed' \(5\), 'the state' \(44\). Name",
        ),
        ({"observation": "none", "sensors": ("imu", "imu=dvl")}, "Two parts of the observation are called 'imu'"),
        ({"observation": "{own}:wrong"}, "wrong returned a list, and a dictionary of parts is asked for"),
        ({"observation": "{own}:ahead"}, "asking it for the parts of an observation failed: TypeError"),
        ({"observation": "{own}:parts", "sensors": ("imu",)}, "has a part 'imu', and --sensors names one as well"),
    ],
)  # fmt: skip
def test_parts_that_do_not_fit_are_refused_with_both(
    learned: Path, cave: Path, own_module: WriteModule, named: dict[str, Any], words: str
) -> None:
    own = own_module(OWN)
    given = {name: text.format(own=own) if isinstance(text, str) else text for name, text in named.items()}
    with pytest.raises(InputError, match=words):
        score(str(learned), cave, "out", **given)


def test_a_dictionary_is_refused_for_a_policy_of_one_array_and_by_the_shield(
    learned: Path, cave: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    make_model().save("flat.zip")
    for flat in ("flat.zip", "baseline:reference", "baseline:reactive"):
        with pytest.raises(InputError, match=r"observes one array of values, .* Leave out NAME=: the values of --sens"):
            score(flat, cave, "out", sensors=("x=imu",))
    with pytest.raises(InputError, match=r"observes a dictionary of parts\. Leave out shield:"):
        score(f"shield:{learned}", cave, "out", **NAMED)


def image_zip(path: Path) -> BaseAlgorithm:
    observation = spaces.Dict({
        "camera": spaces.Box(0, 255, (40, 36, 1), np.uint8), "depth": spaces.Box(-300.0, 300.0, (1,)),
    })  # fmt: skip
    model = untrained(PPO, "multidiscrete", observation)
    model.save(path)
    return model


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_image_is_looked_at_with_trust_alone(
    tmp_path: Path, cave: Path, own_module: WriteModule, backend: str
) -> None:
    own, path = own_module(OWN), tmp_path / "image.zip"
    model = image_zip(path)
    with pytest.raises(InputError, match=r"looks at 'camera' through convolutions.* add --trust: then Stable-Basel"):
        score(str(path), cave, "out", backend, observation=f"{own}:camera")
    found = score(str(path), cave, "out", backend, observation=f"{own}:camera", trust=True).episodes

    def predict(observation: dict[str, Any]) -> Any:
        return model.predict(observation, deterministic=True)[0]

    expected = score(predict, cave, "library", backend, observation=f"{own}:camera").episodes
    assert [one.digest for one in found] == [one.digest for one in expected]
    assert not any(one.reason for one in found)


def test_pickles_beside_a_dictionarys_text_are_not_run(learned: Path, tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path(tmp_path / "ran").write_text, ("",))

    text = base64.b64encode(pickle.dumps(Bomb())).decode()
    with zipfile.ZipFile(learned) as source, zipfile.ZipFile(tmp_path / "evil.zip", "w") as target:
        settings = json.loads(source.read("data"))
        for entry in settings.values():
            if isinstance(entry, dict) and ":serialized:" in entry:
                entry[":serialized:"] = text
        target.writestr("data", json.dumps(settings))
        target.writestr("policy.pth", source.read("policy.pth"))
    assert load_policy(str(tmp_path / "evil.zip"), **NAMED).takes == {"imu": (6,), "speed": (5,), "the state": (31,)}
    assert not (tmp_path / "ran").exists()


def test_a_dictionary_is_read_from_its_text_in_its_order() -> None:
    entry = {":type:": "<class 'gymnasium.spaces.dict.Dict'>", "spaces": str(SPACE.spaces)}
    found = parse_space(entry, "observation space")
    assert isinstance(found, spaces.Dict)
    assert list(shapes_of(found).items()) == list(shapes_of(SPACE).items())
    backwards = "{'z': Box(0.0, 1.0, (2, 3), float32), 'a': Box([0. 0. ...\n 1.], 1.0, (4,), uint8)}"
    found = parse_space(entry | {"spaces": backwards}, "observation space")
    assert isinstance(found, spaces.Dict)
    assert list(shapes_of(found).items()) == [("z", (2, 3)), ("a", (4,))]


@pytest.mark.parametrize(
    "text",
    [
        "", "{}", "{'a': Discrete(3)}", "{'a': Box(exit(), 1, (2,), float32)}", "{a: Box(0, 1, (2,), float32)}",
        "{'a': Box(0, 1, (0,), float32)}", "{'a': Box(0, 1, (2000000,), float32)}", "{'a': Box(0, 1, (2,), object)}",
        "{'a': Box(0, 1, (999, 999), float32)}", "{'a': Box(0, 1, (2,), float32)} + 1", "{'" + 10**6 * "a" + "': B",
        "{'a': Box(" * 10**5, "{" + 10**6 * "'",
    ],
)  # fmt: skip
def test_text_that_is_no_dictionary_of_numbers_is_refused(text: str) -> None:
    entry = {":type:": "<class 'gymnasium.spaces.dict.Dict'>", "spaces": text}
    with pytest.raises(InputError, match="observation space cannot be read from its zip"):
        parse_space(entry, "observation space")


def test_an_observation_of_the_users_own_may_draw(own_module: WriteModule) -> None:
    tube = tube_scenario()
    num = len(tube.starts)
    assert usual_episodes(tube, TaskOptions(), num, "state=paper") == num
    assert usual_episodes(tube, TaskOptions(), num, "own:parts") == 2 * num  # 40 at least, of 20 starts
