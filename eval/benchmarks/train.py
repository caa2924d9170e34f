"""Measure training: decisions per second with one and two torch threads, and with the environments in several places.

    python eval/benchmarks/train.py [--scenario cave-train-1] [--rollouts 3] [--num-envs 16] [--places here batch]

Each row trains PPO with the original's network and settings (3 x 128 swish, buffer 20480, batch 1024, 5 epochs) for
some updates and tells its two halves apart: collecting decisions, and learning from them. "here" are PyBullet's
environments in the process that learns, "workers" in two further processes (aquanav-train --workers 2), "subproc"
SB3's SubprocVecEnv with a process each, "batch" the Warp batch (envs/sb3_env.py), in still water.

Rates are per second of wall time and per second of processor time, that of child processes included. The machine's load
is told too: on a busy one, wall time says little.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from contextlib import closing
from typing import Any

import numpy as np
import psutil
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import SubprocVecEnv, VecNormalize

from aquanav_tools.envs.sb3_env import CaveVecEnv
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.train.crew import make_env
from aquanav_tools.train.environments import TrainingEnvs
from aquanav_tools.train.learners import make_learner
from aquanav_tools.train.settings import TrainSettings

BATCHED = 512


class Halves(BaseCallback):
    """Times collecting and learning apart; the first rollout, in which functions are compiled, does not count."""

    def __init__(self) -> None:
        super().__init__()
        self.spent = {"collect": np.zeros(2), "learn": np.zeros(2)}
        """Wall and processor time, s."""
        self.rollouts = -1
        self._began = clocks()

    def _on_rollout_start(self) -> None:
        self._count("learn")

    def _on_rollout_end(self) -> None:
        self.rollouts += 1
        self._count("collect")

    def _on_training_end(self) -> None:
        self._count("learn")

    def _on_step(self) -> bool:
        return True

    def _count(self, half: str) -> None:
        now = clocks()
        if self.rollouts > 0:
            self.spent[half] += now - self._began
        self._began = now


def clocks() -> np.ndarray:
    """Return wall time and the processor time of this process and its children, s."""
    own = psutil.Process()
    processes = [own, *own.children(recursive=True)]
    return np.array([time.perf_counter(), sum(sum(process.cpu_times()[:2]) for process in processes)])


def measure(envs: Any, settings: TrainSettings, num_threads: int) -> str:
    torch.set_num_threads(num_threads)
    halves = Halves()
    learner: Any = make_learner(VecNormalize(envs, norm_obs=False), settings, seed=0)
    learner.learn(settings.steps, callback=halves, log_interval=None)
    decisions = halves.rollouts * settings.buffer
    spent = [halves.spent["collect"], halves.spent["learn"], halves.spent["collect"] + halves.spent["learn"]]
    return " ".join(f"{decisions / seconds[clock]:>11,.0f}" for clock in (0, 1) for seconds in spent)


def places(scenario: Scenario, settings: TrainSettings, batch: TrainSettings) -> dict[str, Callable[[], Any]]:
    return {
        "here": lambda: TrainingEnvs(scenario, settings, 0),
        "workers": lambda: TrainingEnvs(scenario, settings, 2),
        "subproc": lambda: SubprocVecEnv([lambda: make_env(scenario, settings)] * settings.num_envs),
        "batch": lambda: CaveVecEnv(scenario, batch.num_envs, observation="paper", reward="dense", current=(0, 0, 0)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="cave-train-1")
    parser.add_argument("--rollouts", type=int, default=3)
    parser.add_argument("--num-envs", type=int, default=16)
    parser.add_argument("--places", nargs="+", default=["here", "workers", "subproc", "batch"])
    options = parser.parse_args()
    scenario = read_scenario(options.scenario)
    common: dict[str, Any] = {"observation": "paper", "reward": "dense", "current": "still"}
    steps = 20_480 * (options.rollouts + 1)
    settings = TrainSettings(steps=steps, num_envs=options.num_envs, **common)
    batch = TrainSettings(steps=steps, num_envs=BATCHED, **common)
    print(f"{scenario.name}, {options.num_envs} environments ({BATCHED} in the batch), {os.cpu_count()} processors")
    names = [f"{half}/{unit}" for unit in ("s", "CPU-s") for half in ("collect", "learn", "both")]
    print(f"{'environments':<13}{'threads':>7} {' '.join(f'{name:>11}' for name in names)}  load")
    known = places(scenario, settings, batch)
    for place in options.places:
        for num_threads in (1, 2) if place in ("here", "batch") else (1,):
            with closing(known[place]()) as envs:
                row = measure(envs, batch if place == "batch" else settings, num_threads)
            print(f"{place:<13}{num_threads:>7} {row}  {os.getloadavg()[0]:.1f}", flush=True)


if __name__ == "__main__":
    main()
