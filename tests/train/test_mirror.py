from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import LimitSettings, Scenario
from aquanav_tools.sim.batch.sensors import fan_spec
from aquanav_tools.sim.batch.sensors.fan import RangeFan
from aquanav_tools.train import training
from aquanav_tools.train.environments import TrainingEnvs
from aquanav_tools.train.learners import make_learner, update_normalisers
from aquanav_tools.train.mirror import MirroredEnvs, mirror_image
from aquanav_tools.train.pipeline import Pipeline
from aquanav_tools.train.settings import RunSettings
from aquanav_tools.types import Pose, yaw_quaternion
from tests.caves import tube_scenario
from tests.train.runs import TINY

ERRORS = fan_spec.RangeErrors()
"""None: they would differ on either side."""


def starting(position: tuple[float, float, float], yaw: float) -> Scenario:
    """The tube with one start, and episodes of 25 decisions: too few to reach its wall."""
    tube = tube_scenario(limits=LimitSettings(decisions=25))
    pose = Pose(np.array(position), yaw_quaternion(yaw))
    return dataclasses.replace(tube, starts=(dataclasses.replace(tube.starts[0], pose=pose),))


@pytest.mark.parametrize(
    ("observation", "action", "sensors"),
    [
        ("full", "multidiscrete", ()),
        ("full", "continuous", ()),
        ("paper", "discrete", ()),
        ("full", "multidiscrete", ("echosounders",)),
    ],
)
def test_a_mirrored_vehicle_swims_as_one_that_starts_and_steers_the_other_way(
    observation: str, action: str, sensors: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    # The tube is its own mirror image, so a start on the other side, seen in a mirror, is the same task.
    monkeypatch.setitem(
        fan_spec.PRESET_FANS, "echosounders", dataclasses.replace(fan_spec.echo_sounders(), noise=ERRORS)
    )
    caves = [starting((4.0, 0.6, 0.3), 0.3), starting((4.0, -0.6, 0.3), -0.3)]
    form = {"observation": observation, "action": action, "sensors": sensors}
    settings = dataclasses.replace(TINY, num_envs=2, batch=2, n_steps=1, mirrored=True, **form)
    envs = MirroredEnvs(TrainingEnvs(caves, settings, 0), settings)
    envs.seed(0)
    envs.action_space.seed(0)
    seen = envs.reset()
    rewards = np.zeros(2)
    for _ in range(25):
        # Rounding: 3e-5 were seen, where a value not mirrored is off by 0.1.
        np.testing.assert_allclose(seen[0], seen[1], atol=1e-3)
        np.testing.assert_allclose(rewards[0], rewards[1], atol=2e-2)
        chosen = envs.action_space.sample() if action == "continuous" else np.array(envs.action_space.sample())
        seen, rewards, dones, infos = envs.step(np.stack([chosen, chosen]))
    assert dones.all()
    last = [info["terminal_observation"] for info in infos]
    np.testing.assert_allclose(last[0], last[1], atol=1e-3)
    assert abs(last[0][29]) > 0.01, "it swam in the middle, where nothing is to be mirrored"
    envs.close()


def test_a_sensor_that_is_lopsided_or_of_unknown_kind_has_no_mirror_image() -> None:
    with pytest.raises(InputError, match=r"Ray 1 of the fan points to \[0.0, 1.0, 0.0\]"):
        RangeFan({"lengths": [4.0], "azimuths_deg": [0.0, 90.0]}).mirror_image()
    with pytest.raises(InputError, match="sonar has no mirror image"):
        mirror_image("full", ("sonar",))


class Ears:
    """A sensor of the user's own: what is heard on the left and on the right."""

    def mirror_image(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([1, 0]), np.ones(2, dtype=np.float32)


def test_a_sensor_of_the_users_own_has_the_mirror_image_that_it_says() -> None:
    order, signs = mirror_image("paper", (f"{__name__}:Ears",))
    assert order[-2:].tolist() == [32, 31] and signs[-2:].tolist() == [1.0, 1.0]


def test_what_has_no_mirror_image_is_refused_before_caves_are_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def draw(*_: object) -> None:
        raise AssertionError("it drew caves first, which takes minutes")

    monkeypatch.setattr(training, "drawn_caves", draw)
    lesson = dataclasses.replace(TINY, scenario="generated/mixed", mirrored=True, sensors=("sonar",))
    with pytest.raises(InputError, match="sonar has no mirror image"):
        training.train(Pipeline((lesson,), RunSettings(backend="batch")), 0, tmp_path)


def test_a_network_acts_the_same_whatever_it_is_masked_observations(rng: np.random.Generator) -> None:
    settings = dataclasses.replace(
        TINY, num_envs=2, batch=2, n_steps=1, observation="full", masked_observations=("distance", "depth")
    )
    envs = TrainingEnvs([starting((4.0, 0.0, 0.0), 0.0)], settings, 0)
    learner = make_learner(envs, settings, 0)
    for _ in range(2):  # before anything was seen, and after
        seen = rng.uniform(-1.0, 1.0, (50, 44)).astype(np.float32)
        other = seen.copy()
        other[:, [28, 37]] = rng.uniform(-1.0, 1.0, (50, 2))  # distance and depth in "full"
        shown = [
            learner.policy.extract_features(learner.policy.obs_to_tensor(part)[0]).numpy() for part in (seen, other)
        ]  # type: ignore[attr-defined]
        np.testing.assert_allclose(shown[0], shown[1], atol=1e-4)
        assert np.abs(np.delete(shown[0], [28, 37], axis=1)).mean() > 0.1
        update_normalisers(learner, seen, settings)
    envs.close()
