"""Stable-Baselines3's PPO, as it comes, on aquanav's vector environment.

    python examples/sb3_vec.py --scenario cave-test-1

`--save policy.zip` writes a zip that aquanav-eval takes.
"""

from __future__ import annotations

import argparse
from typing import Any

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecNormalize

import aquanav


def parse_arguments(arguments: list[str] | None = None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    add = parser.add_argument
    add("--scenario", default="cave-test-1", help="folder or name of a cave, or name of a bay")
    add("--reward", default="careful", help="name of a reward")
    add("--seed", type=int, default=0)
    add("--steps", type=int, default=1_000_000, help="decisions to learn from, over all vehicles")
    add("--num-envs", type=int, default=128, help="vehicles")
    add("--num-steps", type=int, default=64, help="decisions of each vehicle before an update")
    add("--max-decisions", type=int, help="episode limit; the scenario's if not given")
    add("--eval-episodes", type=int, default=50, help="with the most likely actions, after learning")
    add("--save", help="file for the policy, a zip")
    return parser.parse_args(arguments)


class Progress(BaseCallback):
    """Prints a line before each update."""

    def _on_training_start(self) -> None:
        self._ended: list[dict[str, Any]] = []

    def _on_step(self) -> bool:
        self._ended += [info for info in self.locals["infos"] if "episode" in info]
        return True

    def _on_rollout_end(self) -> None:
        print(f"{self.num_timesteps:>9} decisions; {summary(self._ended)}", flush=True)
        self._ended.clear()


def summary(ended: list[dict[str, Any]]) -> str:
    """Return what is to be said of episodes, from the infos of their last steps."""
    if not ended:
        return "no episode ended"
    successes = [info for info in ended if info["outcome"] == "success"]
    free = sum(info["num_collisions"] == 0 for info in successes)
    mean = sum(info["episode"]["r"] for info in ended) / len(ended)
    return (
        f"{len(ended)} episodes: success {len(successes) / len(ended):.0%}, without a collision "
        f"{free / len(ended):.0%}, mean return {mean:.1f}"
    )


def make_envs(args: argparse.Namespace, num_envs: int, seed: int) -> Any:
    """Return so many vehicles in the scenario, as a `VecEnv`."""
    return aquanav.make_vec_env(
        args.scenario, num_envs, kind="sb3", seed=seed, reward=args.reward, max_decisions=args.max_decisions
    )


def learn(args: argparse.Namespace) -> PPO:
    """Return what PPO has learned from about `args.steps` decisions."""
    envs = VecNormalize(make_envs(args, args.num_envs, args.seed), norm_obs=False)  # observations are in [-1, 1]
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=args.num_steps,
        batch_size=args.num_envs * args.num_steps // 8,
        n_epochs=4,
        learning_rate=lambda share_left: 5e-4 * share_left,
        ent_coef=0.005,
        policy_kwargs={"net_arch": [128, 128]},
        seed=args.seed,
        device="cpu",
    )
    model.set_logger(Logger(None, []))  # SB3's default makes a folder under /tmp
    model.learn(args.steps, callback=Progress())
    envs.close()
    return model


def evaluate(model: PPO, args: argparse.Namespace) -> list[dict[str, Any]]:
    """Return the last info of one whole episode of each of `args.eval_episodes` vehicles."""
    envs = make_envs(args, args.eval_episodes, args.seed + 1_000_000)
    observations = envs.reset()
    last: dict[int, dict[str, Any]] = {}
    while len(last) < args.eval_episodes:
        actions, _ = model.predict(observations, deterministic=True)
        observations, _, dones, infos = envs.step(actions)
        last = {n: infos[n] for n in dones.nonzero()[0].tolist()} | last  # the first episode of each vehicle
    envs.close()
    return list(last.values())


def main(arguments: list[str] | None = None) -> None:
    """Learn, save the policy if asked, and evaluate."""
    args = parse_arguments(arguments)
    torch.set_num_threads(1)  # networks this small take longer on several
    model = learn(args)
    if args.save:
        model.save(args.save)
    print(f"After learning, {summary(evaluate(model, args))}.")


if __name__ == "__main__":
    main()
