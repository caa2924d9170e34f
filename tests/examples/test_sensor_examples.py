"""The examples of sensors run as they stand."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.cli.evaluate import main
from aquanav_tools.scenario.folder import write_scenario
from tests.caves import tube_scenario
from tests.commands import run_here
from tests.conftest import REPOSITORY


def run(name: str, folder: Path, *options: str) -> str:
    """Return what an example prints of the tube, run as a user runs it."""
    write_scenario(tube_scenario(), folder / "tube")
    command = [sys.executable, str(REPOSITORY / "examples" / name), "--scenario", str(folder / "tube"), *options]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_ping_is_drawn(tmp_path: Path) -> None:
    """Start 0 has the left wall 2.5 m away: brighter there than ahead, where the tube's end is out of reach."""
    run("sonar_ping.py", tmp_path, "--max-range", "5", "--width", "400")
    picture = np.array(Image.open(tmp_path / "sonar.png").convert("L")).astype(float)
    height, width = picture.shape
    per_metre = 0.45 * width / (5.0 * np.sin(np.radians(65.0)))
    column = round(width / 2 - 2.5 * per_metre)
    row = round(height - 10 - 2.5 * per_metre / np.tan(np.radians(60.0)))
    beside, ahead = (
        picture[row - 3 : row + 4, column - 3 : column + 4],
        picture[20:40, width // 2 - 10 : width // 2 + 10],
    )
    assert beside.mean() > 2.0 * ahead.mean()


def test_a_policy_learns_from_a_dictionary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    printed = run("dict_observation.py", tmp_path, "--steps", "1280", "--num-envs", "2", "--save", "policy.zip")
    losses = [float(loss) for loss in re.findall(r"loss (-?[\d.]+)", printed)]
    assert len(losses) == 10
    assert np.isfinite(losses).all()
    shutil.copy(REPOSITORY / "examples" / "dict_observation.py", tmp_path)
    words = ["--scenario", "tube", "--observation", "dict_observation:observation", "--episodes", "2", "-o", "out"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    done = run_here(main, "policy.zip", *words, "--max-decisions", "20")
    assert done.returncode == 0, done.stderr
    episodes = json.loads((tmp_path / "out" / "results.json").read_text())["episodes"]
    assert [one["reason"] for one in episodes] == ["", ""]


def test_scaled_observations_lead_to_the_same_as_readings_when_the_scales_are_in_the_network(
    rng: np.random.Generator,
) -> None:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    from examples import dict_observation
    from tests.evaluate.test_dict_policies import SPACE, StillParts, drawn

    env = VecNormalize(DummyVecEnv([lambda: StillParts("continuous")]))
    for name, statistics in env.obs_rms.items():
        statistics.mean = rng.normal(size=SPACE[name].shape)
        statistics.var = rng.uniform(0.1, 9.0, SPACE[name].shape)
    model = PPO("MultiInputPolicy", env, n_steps=2, batch_size=2, device="cpu", seed=0)
    seen = drawn(rng, 50)
    expected = model.predict(env.normalize_obs(seen), deterministic=True)[0]
    dict_observation.fold(model.policy, env)
    # Rounding of float32 in a first layer of 25 values of size 10, behind which tanh and weights do not enlarge it.
    np.testing.assert_allclose(model.predict(seen, deterministic=True)[0], expected, atol=2e-5)
