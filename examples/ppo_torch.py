"""PPO in one file: torch on aquanav's vector environment, with nothing of aquanav's own training.

    python examples/ppo_torch.py --scenario cave-test-1

Proximal policy optimisation (Schulman et al., 2017) with generalised advantage estimation (Schulman et al., 2016).
Change what you like: the environment's side is `make_vec_env`, and `step` returns arrays with a row per vehicle.
"""

from __future__ import annotations

import argparse
import time
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.distributions import Categorical

import aquanav

CLIP, VF_COEF, MAX_GRAD_NORM = 0.2, 0.5, 0.5
"""Range of the ratio of probabilities; weight of the value's error; longest gradient."""


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
    add("--learning-rate", type=float, default=5e-4, help="of the first update; it falls to zero in a straight line")
    add("--discount", type=float, default=0.99)
    add("--gae-lambda", type=float, default=0.95)
    add("--epochs", type=int, default=4, help="passes over the rollout in each update")
    add("--minibatches", type=int, default=8, help="gradient steps of each pass")
    add("--ent-coef", type=float, default=0.005, help="weight of the entropy")
    add("--eval-episodes", type=int, default=50, help="with the most likely actions, after learning")
    add("--save", help="file for the weights")
    return parser.parse_args(arguments)


class ActorCritic(nn.Module):
    """Logits of each part of a MultiDiscrete action, and the value, from one observation (O,)."""

    def __init__(self, observation_size: int, num_choices: list[int], width: int = 128) -> None:
        super().__init__()
        self.num_choices = num_choices
        self.actor = _mlp(observation_size, width, sum(num_choices), last_gain=0.01)
        self.critic = _mlp(observation_size, width, 1, last_gain=1.0)

    def distributions(self, observations: Tensor) -> list[Categorical]:
        """Return the distribution of each part of the actions for (..., O) observations."""
        return [Categorical(logits=part) for part in self.actor(observations).split(self.num_choices, dim=-1)]

    def value(self, observations: Tensor) -> Tensor:
        """Return (...) values of (..., O) observations."""
        return self.critic(observations).squeeze(-1)


def _mlp(num_inputs: int, width: int, num_outputs: int, last_gain: float) -> nn.Sequential:
    """Return two hidden layers; a small last gain makes the first actions even."""
    layers = [nn.Linear(num_inputs, width), nn.Linear(width, width), nn.Linear(width, num_outputs)]
    for layer, gain in zip(layers, (2**0.5, 2**0.5, last_gain), strict=True):
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(layers[0], nn.Tanh(), layers[1], nn.Tanh(), layers[2])


class Rollout(NamedTuple):
    """What N vehicles did for T decisions, (T, N, ...)."""

    observations: Tensor
    actions: Tensor
    log_probs: Tensor
    rewards: Tensor
    values: Tensor
    next_values: Tensor
    """Of where each decision led, also where time ran out; 0 where the episode ended by itself."""
    ended: Tensor
    """Whether the next row is of another episode."""


class Ended(NamedTuple):
    """An episode that ended."""

    total: float
    """Sum of its rewards."""
    length: int
    outcome: str
    num_collisions: int


def ended_in(infos: dict[str, Any]) -> dict[int, Ended]:
    """Return the episodes that ended in a step of the vector environment (autoreset "SameStep"), by vehicle."""
    final = infos.get("final_info", {})
    rows = infos["_final_info"].nonzero()[0].tolist() if final else []
    names = ("return", "length", "outcome", "num_collisions")
    return {n: Ended(*(final[name][n].item() for name in names)) for n in rows}


def summary(episodes: list[Ended]) -> str:
    """Return what is to be said of episodes."""
    if not episodes:
        return "no episode ended"
    successes = [one for one in episodes if one.outcome == "success"]
    free = sum(one.num_collisions == 0 for one in successes)
    mean = sum(one.total for one in episodes) / len(episodes)
    return (
        f"{len(episodes)} episodes: success {len(successes) / len(episodes):.0%}, without a collision "
        f"{free / len(episodes):.0%}, mean return {mean:.1f}"
    )


class ReturnScale:
    """Divides rewards by the running standard deviation of the discounted return."""

    def __init__(self, num_envs: int, discount: float) -> None:
        self.discount, self.returns = discount, np.zeros(num_envs)
        self.count, self.mean, self.m2 = 0, 0.0, 0.0

    def __call__(self, rewards: np.ndarray, ended: np.ndarray) -> np.ndarray:
        """Return scaled (N,) rewards."""
        self.returns = self.returns * self.discount + rewards
        count, mean = len(self.returns), float(self.returns.mean())  # Chan et al. (1979): joining two samples
        total, difference = self.count + count, mean - self.mean
        self.m2 += float(((self.returns - mean) ** 2).sum()) + difference**2 * self.count * count / total
        self.mean, self.count = self.mean + difference * count / total, total
        self.returns[ended] = 0.0
        return rewards / (np.sqrt(self.m2 / self.count) + 1e-8)


@torch.no_grad()
def collect(
    envs: Any, network: ActorCritic, observations: np.ndarray, scale: ReturnScale, num_steps: int
) -> tuple[Rollout, np.ndarray, list[Ended]]:
    """Return T decisions of each vehicle, the observations after them, and the episodes that ended meanwhile."""
    rows, finished = [], list[Ended]()
    for _ in range(num_steps):
        seen = torch.from_numpy(observations)
        distributions = network.distributions(seen)
        actions = torch.stack([part.sample() for part in distributions], dim=-1)
        observations, rewards, terminated, truncated, infos = envs.step(actions.numpy())
        ended, after = terminated | truncated, observations
        if ended.any():
            after = observations.copy()
            after[ended] = np.stack(infos["final_obs"][ended])
        next_values = network.value(torch.from_numpy(after)) * torch.from_numpy(~terminated)
        scaled = torch.from_numpy(scale(rewards, ended)).float()
        log_probs = log_prob(distributions, actions)
        rows.append((seen, actions, log_probs, scaled, network.value(seen), next_values, torch.from_numpy(ended)))
        finished += ended_in(infos).values()
    return Rollout(*map(torch.stack, zip(*rows, strict=True))), observations, finished


def log_prob(distributions: list[Categorical], actions: Tensor) -> Tensor:
    """Return (...) log probabilities of (..., P) actions."""
    return torch.stack([part.log_prob(actions[..., n]) for n, part in enumerate(distributions)]).sum(0)


def advantages_of(rollout: Rollout, discount: float, gae_lambda: float) -> Tensor:
    """Return (T, N) generalised advantage estimates."""
    errors = rollout.rewards + discount * rollout.next_values - rollout.values
    advantages, following = torch.zeros_like(errors), torch.zeros_like(errors[0])
    for t in reversed(range(len(errors))):
        following = errors[t] + discount * gae_lambda * following * ~rollout.ended[t]
        advantages[t] = following
    return advantages


def update(network: ActorCritic, optimiser: torch.optim.Optimizer, rollout: Rollout, args: argparse.Namespace) -> None:
    """Improve the network on a rollout."""
    gains = advantages_of(rollout, args.discount, args.gae_lambda)
    advantages, targets = gains.flatten(), (gains + rollout.values).flatten()
    observations, actions, old, *_ = (array.flatten(0, 1) for array in rollout)
    for _ in range(args.epochs):
        for rows in torch.randperm(len(old)).chunk(args.minibatches):
            distributions = network.distributions(observations[rows])
            ratio = (log_prob(distributions, actions[rows]) - old[rows]).exp()
            gain = (advantages[rows] - advantages[rows].mean()) / (advantages[rows].std() + 1e-8)
            policy_loss = -torch.min(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
            value_loss = 0.5 * (network.value(observations[rows]) - targets[rows]).square().mean()
            entropy = torch.stack([part.entropy() for part in distributions]).sum(0).mean()
            loss = policy_loss + VF_COEF * value_loss - args.ent_coef * entropy
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), MAX_GRAD_NORM)
            optimiser.step()


def make_envs(args: argparse.Namespace, num_envs: int) -> Any:
    """Return so many vehicles in the scenario."""
    return aquanav.make_vec_env(
        args.scenario, num_envs, autoreset_mode="SameStep", reward=args.reward, max_decisions=args.max_decisions
    )


def learn(args: argparse.Namespace) -> ActorCritic:
    """Return a network that has learned from about `args.steps` decisions."""
    envs = make_envs(args, args.num_envs)
    network = ActorCritic(envs.single_observation_space.shape[0], envs.single_action_space.nvec.tolist())
    optimiser = torch.optim.Adam(network.parameters(), lr=args.learning_rate, eps=1e-5)
    scale = ReturnScale(args.num_envs, args.discount)
    observations, _ = envs.reset(seed=args.seed)
    per_update = args.num_envs * args.num_steps
    num_updates, began = max(1, args.steps // per_update), time.perf_counter()
    for n in range(num_updates):
        optimiser.param_groups[0]["lr"] = args.learning_rate * (1.0 - n / num_updates)
        rollout, observations, finished = collect(envs, network, observations, scale, args.num_steps)
        update(network, optimiser, rollout, args)
        done = (n + 1) * per_update
        rate = done / (time.perf_counter() - began)
        print(f"{done:>9} decisions, {rate:.0f} per s; {summary(finished)}", flush=True)
    envs.close()
    return network


@torch.no_grad()
def evaluate(network: ActorCritic, args: argparse.Namespace) -> list[Ended]:
    """Return one whole episode of each of `args.eval_episodes` vehicles, with the most likely actions."""
    envs = make_envs(args, args.eval_episodes)
    observations, _ = envs.reset(seed=args.seed + 1_000_000)
    finished: dict[int, Ended] = {}
    while len(finished) < args.eval_episodes:
        parts = network.distributions(torch.from_numpy(observations))
        actions = torch.stack([part.logits.argmax(-1) for part in parts], dim=-1)
        observations, _, _, _, infos = envs.step(actions.numpy())
        finished = ended_in(infos) | finished  # the first of each vehicle
    envs.close()
    return list(finished.values())


def main(arguments: list[str] | None = None) -> None:
    """Learn, evaluate, and save the weights if asked."""
    args = parse_arguments(arguments)
    torch.set_num_threads(1)  # networks this small take longer on several
    torch.manual_seed(args.seed)
    network = learn(args)
    if args.save:
        torch.save(network.state_dict(), args.save)
    print(f"After learning, {summary(evaluate(network, args))}.")


if __name__ == "__main__":
    main()
