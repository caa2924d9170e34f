"""Measure training: what collecting decisions costs in several places, and what learning from them costs.

    python eval/benchmarks/train.py [--scenario cave-train-1] [--rounds 3] [--only sb3 ours batch512] [--keep] [--smoke]

Settings are those of the paper's curriculum (31 values, 3 x 128 swish, twice; rollouts of 20480, batch 1024, 5 epochs),
or with --settings reference those of that pipeline (44 values, rollouts of 24576, batch 2048). Collecting: "here" are
PyBullet's environments in the process that learns, "workers" in two further processes (aquanav-train --workers 2),
"subproc" SB3's SubprocVecEnv with a process each, "batchN" the Warp batch with N vehicles (aquanav-train --backend
batch). Learning, from one rollout: "sb3" is Stable-Baselines3's own update, "ours" that of train/ppo.py, "ours-plain"
the same without `fast_products`, "ours-bf16" with the precision bfloat16, "sb3-4096" and "ours-4096" with minibatches
of 4096, "sbx" the update of sbx (JAX; pip install sbx-rl), without scaling of observations, where that is installed.

All take turns, round by round, so that a busy machine is as busy for each of them; the first round, in which functions
are compiled, does not count. CPU time is that of this process, its threads and its children, and the fair measure where
others use the machine too.
"""

from __future__ import annotations

import copy
import dataclasses
import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import SubprocVecEnv, VecNormalize

sys.path.insert(0, str(Path(__file__).parents[2]))  # eval and the tiny caves are no part of the package

from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.train.batched import BatchedEnvs
from aquanav_tools.train.environment_group import training_env
from aquanav_tools.train.environments import TrainingEnvs
from aquanav_tools.train.learners import make_learner
from aquanav_tools.train.ppo import ParallelPPO
from aquanav_tools.train.products import fast_products
from aquanav_tools.train.settings import TrainSettings
from eval.pages import RESULTS, Record
from eval.smoke import parser_of
from tests.caves import tube_scenario

Action = Callable[[], None]
PLACES = ("here", "workers", "subproc", "batch256", "batch512", "batch2048")
LEARNERS = ("sb3", "ours", "ours-plain", "ours-bf16", "sb3-4096", "ours-4096", "sbx")
PAPER = TrainSettings(observation="paper", reward="dense", current="still", num_envs=16, n_steps=1280, batch=1024)
REFERENCE = dataclasses.replace(PAPER, observation="full", reward="careful", n_steps=1536, batch=2048)
SETTINGS = {"paper": PAPER, "reference": REFERENCE}
SMOKE = dataclasses.replace(PAPER, num_envs=2, n_steps=2048, batch=1024, epochs=1)
"""The largest batch has 2048 environments, of two decisions each at least."""


class Watch(BaseCallback):
    """Lets SB3 collect; nothing else happens."""

    def _on_step(self) -> bool:
        return True


def cpu_seconds() -> float:
    own = psutil.Process()
    return sum(sum(process.cpu_times()[:2]) for process in [own, *own.children(recursive=True)])


def collecting(place: str, scenario: Scenario, settings: TrainSettings) -> tuple[Any, Action]:
    """Return a learner with environments in a place, and what collects a rollout with it."""
    if place.startswith("batch"):
        num_envs = int(place.removeprefix("batch"))
        settings = dataclasses.replace(settings, num_envs=num_envs, n_steps=settings.rollout_size // num_envs)
        envs: Any = BatchedEnvs([scenario], settings)
    elif place == "subproc":
        envs = SubprocVecEnv([lambda: training_env(scenario, settings)] * settings.num_envs)
    else:
        envs = TrainingEnvs([scenario], settings, 2 if place == "workers" else 0)
    learner: Any = make_learner(VecNormalize(envs, norm_obs=False), settings, seed=0)
    _, callback = learner._setup_learn(settings.rollout_size, Watch(), True, "", False)

    def collect() -> None:
        torch.set_num_threads(1)
        learner.collect_rollouts(learner.env, callback, learner.rollout_buffer, learner.n_steps)

    return learner, collect


def learning(name: str, full: Any) -> Action:
    """Return what learns once from a full rollout, which is kept as it is."""
    learner: Any = copy.copy(full)
    learner.__class__ = PPO if name.startswith("sb3") else ParallelPPO
    learner.precision = "bfloat16" if name.endswith("bf16") else "float32"
    learner.policy = copy.deepcopy(full.policy)
    learner.policy.optimizer = torch.optim.Adam(learner.policy.parameters(), lr=3e-4, eps=1e-5)
    learner.batch_size = 4096 if name.endswith("4096") else full.batch_size

    def learn() -> None:
        torch.set_num_threads(1)
        learner.rollout_buffer = copy.deepcopy(full.rollout_buffer)  # SB3's update turns the arrays around
        with fast_products() if name in ("ours", "ours-4096") else nullcontext():
            learner.train()

    return learn


def learning_in_jax(full: Any) -> Action:
    """Return what learns once from a full rollout, as sbx does it; its imports are not the project's."""
    import sbx
    from flax import linen

    learner: Any = sbx.PPO(
        "MlpPolicy", full.env, n_steps=full.n_steps, batch_size=full.batch_size, n_epochs=full.n_epochs,
        ent_coef=full.ent_coef, policy_kwargs={"net_arch": [128, 128, 128], "activation_fn": linen.swish},
    )  # fmt: skip
    learner.set_logger(full.logger)

    def learn() -> None:
        learner.rollout_buffer = copy.deepcopy(full.rollout_buffer)
        learner.train()

    return learn


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--scenario", default="cave-train-1")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", nargs="+", choices=PLACES + LEARNERS, default=PLACES + LEARNERS, metavar="NAME")
    parser.add_argument("--settings", choices=SETTINGS, default="paper")
    parser.add_argument("--keep", action="store_true", help="put the table into eval/results/train.md")
    options = parser.parse_args()
    record = Record("eval/benchmarks/train.py")
    scenario = tube_scenario() if options.smoke else read_scenario(options.scenario)
    settings, num_rounds = (SMOKE, 1) if options.smoke else (SETTINGS[options.settings], options.rounds)
    actions: dict[str, Action] = {}
    learners = []
    for place in (place for place in PLACES if place in options.only):
        learner, actions[f"collect {place}"] = collecting(place, scenario, settings)
        learners.append(learner)
    names = [name for name in LEARNERS if name in options.only]
    if names:
        full, collect = collecting("batch512", scenario, settings)
        learners.append(full)
        collect()
        for name in names:
            if name != "sbx":
                actions[f"learn {name}"] = learning(name, full)
            elif find_spec("sbx"):
                actions["learn sbx"] = learning_in_jax(full)
            else:
                print("sbx is left out: it is not installed (pip install sbx-rl).")
    record.say(f"{scenario.name}, settings of `{options.settings}`, {num_rounds} rounds.\n")
    spent = {name: np.zeros(2) for name in actions}
    for turn in range(num_rounds + 1):
        for name, act in actions.items():
            before = np.array([time.perf_counter(), cpu_seconds()])
            act()
            if turn > 0:
                spent[name] += np.array([time.perf_counter(), cpu_seconds()]) - before
    record.say("| | decisions/CPU-s | CPU-us/decision | decisions/s |\n|---|---|---|---|")
    for name, (wall, cpu) in spent.items():
        num = num_rounds * settings.rollout_size
        record.say(f"| {name} | {num / cpu:,.0f} | {1e6 * cpu / num:.1f} | {num / wall:,.0f} |")
    if options.keep:
        record.keep(RESULTS / "train.md", "train")
    for learner in learners:
        learner.env.close()


if __name__ == "__main__":
    main()
