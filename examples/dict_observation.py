"""Learn from several sensors at once with Stable-Baselines3.

    cd examples
    python dict_observation.py --scenario cave-test-1 --save policy.zip
    aquanav-eval policy.zip --scenario cave-test-1 --observation dict_observation:observation

The observation is a dictionary: the preset "paper" (rays and goal), an inertial unit, a Doppler log, a depth cell, and
a small imaging sonar. SB3's MultiInputPolicy flattens them side by side. Readings are in SI units; VecNormalize brings
them to one size; what it has learned of their sizes is put into the network before that is saved, so that the zip is
all that an evaluation needs.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecNormalize

from aquanav_tools.envs.sb3_env import BatchedVecEnv
from aquanav_tools.sim.batch.sensors.sonar import ImagingSonar
from aquanav_tools.sim.batch.sensors.sonar_sheet import SonarSheet

SONAR = SonarSheet(num_beams=16, num_bins=16, max_range=8.0, num_sub_rays=8)
"""An image so small that it needs no convolutions."""
SMALLEST = 1e-6
"""Variance of a value that counts as one that changed."""


def observation() -> dict[str, Any]:
    """Return what the vehicles observe."""
    return {"rays and goal": "paper", "imu": "imu", "dvl": "dvl", "depth": "depth", "sonar": ImagingSonar(SONAR)}


def fold(policy: Any, env: VecNormalize) -> None:
    """Put the means and variances by which observations are scaled into the policy's first layers.

    From then on it takes readings as they are. What VecNormalize does beyond that is left out: readings are not clipped
    at ten standard deviations. A value that never changed counts for nothing.
    """
    statistics = [env.obs_rms[name] for name in policy.observation_space.spaces]
    mean = np.concatenate([one.mean.ravel() for one in statistics])
    variance = np.concatenate([one.var.ravel() for one in statistics])
    scale = np.where(variance > SMALLEST, 1.0 / np.sqrt(variance + env.epsilon), 0.0)
    with torch.no_grad():
        for network in (policy.mlp_extractor.policy_net, policy.mlp_extractor.value_net):
            weights = network[0].weight.double() * torch.from_numpy(scale)
            network[0].bias -= (weights @ torch.from_numpy(mean)).float()
            network[0].weight.copy_(weights)


def main() -> None:
    """Train, and say how it went."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="cave-test-1", help="a scenario folder, or the name of one that ships")
    parser.add_argument("--steps", type=int, default=500_000, help="decisions of all vehicles together")
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--save", type=Path, help="SB3's zip of the policy")
    options = parser.parse_args()
    torch.set_num_threads(1)  # the networks are small: threads would wait for each other
    batch = BatchedVecEnv(options.scenario, options.num_envs, observation=observation())
    env = VecNormalize(batch, norm_reward=True, gamma=0.99)
    model = PPO("MultiInputPolicy", env, n_steps=64, batch_size=1024, ent_coef=0.005, seed=0, device="cpu")
    model.set_logger(Logger(None, []))  # SB3's default makes a folder under /tmp for each call of learn
    for _ in range(10):
        model.learn(max(options.steps // 10, 1), reset_num_timesteps=False)
        episodes = list(model.ep_info_buffer or [])
        mean = sum(episode["r"] for episode in episodes) / max(len(episodes), 1)
        loss = model.logger.name_to_value["train/loss"]
        print(f"{model.num_timesteps:>9} decisions: mean return {mean:8.1f}, loss {loss:.3f}", flush=True)
    if options.save is not None:
        fold(model.policy, env)
        model.save(options.save)
    env.close()


if __name__ == "__main__":
    main()
