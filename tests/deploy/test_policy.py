"""On a vehicle a policy sees and does what it saw and did in the environment, from sensors' readings alone."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from aquanav_tools.deploy import DeployedPolicy, Readings
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.errors import InputError
from aquanav_tools.sim.command import Command, command_of
from aquanav_tools.sim.vehicle import known_vehicles, load_vehicle
from aquanav_tools.train.actors import Actor
from aquanav_tools.train.export import onnx_bytes
from aquanav_tools.train.learners import make_policy
from aquanav_tools.train.settings import TrainSettings
from aquanav_tools.types import Array
from tests.caves import tube_scenario
from tests.conftest import REPOSITORY

POLICIES = REPOSITORY / "eval" / "policies"
PLAIN, WIDE, LED = (POLICIES / f"reference{name}.onnx" for name in ("", "-echosounders", "-waypoint"))
SIZES = {"echosounders": 16, "waypoint": 4}


def rotation_of(quaternion: Array) -> Array:
    """Return the matrix of (w, x, y, z), written out here so that nothing of the package's is in the test."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def readings_of(env: CaveEnv, info: dict[str, Any], sensors: dict[str, Any]) -> Readings:
    """Return what a vehicle at the place that `info` names would measure."""
    turn, offset = rotation_of(info["orientation"]), np.array(env.scenario.settings.goal.position) - info["position"]
    azimuth = np.arctan2(offset[1], offset[0]) - np.arctan2(turn[1, 0], turn[0, 0])
    goal = [np.linalg.norm(offset), azimuth, np.arctan2(offset[2], np.hypot(offset[0], offset[1]))]
    velocity, entrance = info["velocity"], env.scenario.guide.centres[0]
    depth = entrance[2] - info["position"][2]
    return Readings(info["rays"], goal, velocity[:3], velocity[3:], depth, turn[2, :2], sensors)


@pytest.mark.parametrize(
    ("path", "sensors"), [(PLAIN, ()), (WIDE, ("echosounders",)), (LED, ("echosounders", "waypoint"))]
)
def test_observations_and_commands_are_those_of_the_environment(path: Path, sensors: tuple[str, ...]) -> None:
    env = CaveEnv(tube_scenario(), sensors=sensors, current=(0.1, 0.05, 0.0))
    policy = DeployedPolicy(path)
    assert policy.sensors == sensors
    observation, info = env.reset(seed=1)
    kinds, rng = set(), np.random.default_rng(0)
    for _ in range(60):
        ends = 44 + np.cumsum([0, *(SIZES[name] for name in sensors)])
        readings = {name: observation[a:b] for name, a, b in zip(sensors, ends[:-1], ends[1:], strict=True)}
        seen = policy.observe(readings_of(env, info, readings))
        np.testing.assert_allclose(seen, observation, atol=2e-6)
        command = policy.choose(seen)
        kinds.add(command)
        if rng.random() < 0.5:  # also where the policy would not lead
            command = command_of(Command._fields, rng.integers(3, size=3).tolist())
        policy.take(command)
        choices = np.array([1 - command.ballast, 1 - command.steer, 1 + command.thrust])
        observation, _, terminated, truncated, info = env.step(choices.astype(int))
        if terminated or truncated:
            break
    env.close()
    assert len(kinds) > 3


def test_earlier_decisions_are_observed_as_the_environment_shows_them(tmp_path: Path) -> None:
    env = CaveEnv(tube_scenario(), observation="paper", history=(1, 3))
    path = tmp_path / "policy.onnx"
    path.write_bytes(onnx_bytes(untrained(31 * 3), {"observation": "paper", "sensors": [], "history": [1, 3]}))
    policy = DeployedPolicy(path)
    observation, info = env.reset(seed=2)
    for _ in range(8):
        given = readings_of(env, info, {})
        np.testing.assert_allclose(policy.observe(Readings(given.rays, given.goal)), observation, atol=2e-6)
        observation, _, _, _, info = env.step(np.array([0, 2, 2]))
    env.close()


def untrained(size: int) -> Actor:
    """Return a network that takes so many values and chooses among 3, 3 and 3."""
    settings = TrainSettings(hidden=(8,), normalise=False, n_steps=64)
    policy = make_policy(spaces.Box(-1.0, 1.0, (size,), np.float32), spaces.MultiDiscrete([3, 3, 3]), settings)
    return Actor(policy)


def test_a_demand_is_the_force_of_the_vehicles_own_actuators() -> None:
    policy = DeployedPolicy(PLAIN)
    actuators = load_vehicle("bluerov2").actuators
    policy.take(Command(1.0, -1.0, -1.0))
    reverse = -actuators.surge_force * actuators.reverse_fraction
    assert policy.demand() == pytest.approx(
        (reverse, 0.1 * actuators.trim_rate * actuators.heave_force, -actuators.yaw_rate)
    )
    for _ in range(100):
        policy.take(Command(1.0, 0.0, 1.0))
    assert policy.demand() == pytest.approx((actuators.surge_force, actuators.heave_force, 0.0))
    policy.reset()
    assert policy.demand() == (0.0, 0.0, 0.0)


def test_it_loads_nothing_but_numpy_and_onnxruntime() -> None:
    code = (
        "import sys; from aquanav_tools.deploy import DeployedPolicy; DeployedPolicy(sys.argv[1]); "
        "heavy = {'gymnasium', 'numba', 'warp', 'torch', 'scipy', 'trimesh', 'onnx', 'pyarrow', 'matplotlib'}; "
        "print(sorted(heavy & {name.partition('.')[0] for name in sys.modules}))"
    )
    done = subprocess.run([sys.executable, "-c", code, str(WIDE)], capture_output=True, text=True, cwd=REPOSITORY)
    assert done.stdout == "[]\n", done.stderr


def test_it_decides_in_less_than_a_twentieth_of_the_time_between_decisions() -> None:
    """The bar is 5 ms for 99 in 100; the median is asserted, as other processes may hold this one up."""
    policy = DeployedPolicy(WIDE)
    readings = Readings(
        np.ones(28), [5.0, 0.1, 0.0], np.zeros(3), np.zeros(3), 1.0, np.zeros(2), {"echosounders": np.ones(16)}
    )
    took = []
    for _ in range(300):
        began = time.perf_counter()
        policy.act(readings)
        took.append(time.perf_counter() - began)
    assert np.median(took) < 0.005


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rays": np.ones(27)}, "'rays' must be 28 finite numbers"),
        ({"goal": [1.0, np.nan, 0.0]}, "'goal' must be 3 finite numbers"),
        ({"depth": None}, "observes 'depth', and the readings have none"),
        ({"sensors": {}}, "observes 'echosounders', and the readings have none"),
        ({"sensors": {"echosounders": np.ones(15)}}, "come to 59 values, and the policy takes 60"),
    ],
)
def test_readings_that_do_not_fit_are_named(changes: dict[str, Any], message: str) -> None:
    good = Readings(
        np.ones(28), [5.0, 0.1, 0.0], np.zeros(3), np.zeros(3), 1.0, np.zeros(2), {"echosounders": np.ones(16)}
    )
    with pytest.raises(InputError, match=message):
        DeployedPolicy(WIDE).act(replace(good, **changes))


def test_files_that_are_no_policies_are_named(tmp_path: Path) -> None:
    path = tmp_path / "policy.onnx"
    path.write_bytes(b"no model")
    with pytest.raises(InputError, match="cannot be read as an ONNX file"):
        DeployedPolicy(path)
    path.write_bytes(onnx_bytes(untrained(50), None))
    with pytest.raises(InputError, match="does not say what it observes"):
        DeployedPolicy(path)
    path.write_bytes(onnx_bytes(untrained(120), {"observation": "original", "sensors": [], "history": []}))
    with pytest.raises(InputError, match="observes 'original', which no vehicle measures"):
        DeployedPolicy(path)
    with pytest.raises(InputError, match="of the original's model"):
        DeployedPolicy(PLAIN, vehicle=next(iter(name for name in known_vehicles() if "original" in name)))
