"""The Stable-Baselines3 algorithm of a lesson, and everything that its future depends on.

What passes from lesson to lesson: the network's weights with its running means and spreads, and the optimisers'
moments unless the lesson asks for fresh ones. Memories of old decisions do not: they are of another cave.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from aquanav_tools.envs.observation import layout
from aquanav_tools.libraries import require
from aquanav_tools.policy.normaliser import NormalisedObservations
from aquanav_tools.policy.observed import OBSERVED, observed_table
from aquanav_tools.train.fitting import decisions_of, update_size
from aquanav_tools.train.ppo import ParallelPPO
from aquanav_tools.train.settings import OFF_POLICY, TrainSettings

ACTION_NOISE_STD = 0.1
"""Of the noise on td3's actions; the value of its authors (Fujimoto et al. 2018)."""
MAX_WEIGHT = 1e9
"""Of a network that can still compute: four layers of such weights overflow float32, at 3e38."""
Parameters = dict[str, Any]


def class_of(algorithm: str) -> Any:
    """Return the class of an algorithm.

    Raises:
        LibraryError: it is not installed.
    """
    return _recurrent_ppo() if algorithm == "recurrent-ppo" else {"ppo": ParallelPPO, "sac": SAC, "td3": TD3}[algorithm]


def make_learner(envs: VecEnv, settings: TrainSettings, seed: int, done: int = 0) -> BaseAlgorithm:
    """Return an untrained algorithm.

    Args:
        envs: To learn in.
        settings: A fitted lesson.
        seed: Of the network and of sampling.
        done: Decisions of the lesson that were learned from before, by a learner that this one is to go on for.

    Raises:
        LibraryError: the algorithm is not installed.
    """
    make = _make_off_policy if settings.algorithm in OFF_POLICY else _make_on_policy
    learner = make(envs, settings, seed, _schedule(settings, done))
    _mask_observations(learner, settings)
    setattr(learner, OBSERVED, observed_table(settings.observation, settings))
    learner.set_logger(Logger(None, []))
    return learner


def make_policy(observation: spaces.Space[Any], action: spaces.Space[Any], settings: TrainSettings) -> BasePolicy:
    """Return an untrained network for these spaces, as `make_learner` makes it, without anything around it."""
    name, options = _policy_of(settings)
    kind = class_of(settings.algorithm).policy_aliases[name]
    policy: BasePolicy = kind(observation, action, _schedule(settings, 0), **options)
    return policy


def _policy_of(settings: TrainSettings) -> tuple[str, dict[str, Any]]:
    """Return the name of the policy's class, in SB3's words, and its arguments."""
    normalising = {"features_extractor_class": NormalisedObservations} if settings.normalise else {}
    network = {"net_arch": list(settings.hidden), "activation_fn": torch.nn.SiLU, **normalising}
    if settings.algorithm == "recurrent-ppo":
        return "MlpLstmPolicy", network | {"lstm_hidden_size": settings.memory}
    return "MlpPolicy", network


def _make_on_policy(envs: VecEnv, settings: TrainSettings, seed: int, rate: LinearSchedule) -> BaseAlgorithm:
    name, network = _policy_of(settings)
    ours: dict[str, Any] = {}
    if settings.algorithm == "ppo":
        ours = {
            "precision": settings.precision,
            "imitation": settings.imitation,
            "memory": settings.replay,
            "greedy": settings.greedy,
        }
    return class_of(settings.algorithm)(
        name,
        envs,
        learning_rate=rate,
        n_steps=settings.n_steps,
        batch_size=settings.batch,
        n_epochs=settings.epochs,
        gamma=settings.discount,
        gae_lambda=settings.gae_lambda,
        clip_range=settings.clip,
        ent_coef=settings.ent_coef,
        policy_kwargs=network,
        seed=seed,
        device="cpu",
        **ours,
    )


def _make_off_policy(envs: VecEnv, settings: TrainSettings, seed: int, rate: LinearSchedule) -> BaseAlgorithm:
    noise = NormalActionNoise(np.zeros(3), np.full(3, ACTION_NOISE_STD)) if settings.algorithm == "td3" else None
    name, network = _policy_of(settings)
    return class_of(settings.algorithm)(
        name,
        envs,
        learning_rate=rate,
        buffer_size=settings.replay,
        learning_starts=settings.learning_starts,
        batch_size=settings.batch,
        gamma=settings.discount,
        train_freq=1,
        gradient_steps=max(1, round(settings.update_ratio * settings.num_envs)),
        action_noise=noise,
        policy_kwargs=network,
        seed=seed,
        device="cpu",
    )


def _schedule(settings: TrainSettings, done: int) -> LinearSchedule:
    """Return the learning rate by what is left of the lesson, which SB3 counts when an update's decisions are made.

    "linear" asks for the rate at the update's first decision instead: all of it at the first, a fraction at the last.
    """
    if settings.schedule == "original":
        return LinearSchedule(settings.learning_rate, 0.0, 1.0)
    total = decisions_of(settings, done)
    fraction = update_size(settings) / total
    return LinearSchedule(
        settings.learning_rate * (1.0 + fraction), settings.learning_rate * fraction, total / settings.steps
    )


def _recurrent_ppo() -> Any:
    require("--algorithm recurrent-ppo", "sb3_contrib")
    from sb3_contrib import RecurrentPPO

    return RecurrentPPO


def update_normalisers(learner: BaseAlgorithm, observations: np.ndarray, settings: TrainSettings) -> None:
    """Add observations to the statistics of the network's normalisers; nothing where it has none."""
    for module in learner.policy.modules():
        if isinstance(module, NormalisedObservations):
            module.take_in(observations)
    _mask_observations(learner, settings)


def _mask_observations(learner: BaseAlgorithm, settings: TrainSettings) -> None:
    """Keep from the network the values that its settings mask."""
    if not settings.masked_observations:
        return
    indices = maskable_indices(settings.observation)
    hidden = np.array([indices[name] for name in settings.masked_observations])
    for module in learner.policy.modules():
        if isinstance(module, NormalisedObservations):
            firsts = np.arange(0, len(module.variance), len(module.variance) // (1 + len(settings.history)))
            module.hide((firsts[:, None] + hidden).ravel().tolist())


def maskable_indices(observation: str) -> dict[str, int]:
    """Return where in an observation preset the values are that can be masked, by their names."""
    slices = layout(observation)
    names = ("distance", "azimuth", "elevation")
    goal = {name: slices["goal"].start + n for n, name in enumerate(names)} if "goal" in slices else {}
    return goal | ({"depth": slices["depth"].start} if "depth" in slices else {})


def parameters_of(learner: BaseAlgorithm) -> Parameters:
    """Return weights, optimisers' states and other learned tensors, by name."""
    _, names = learner._get_torch_save_params()
    return {**learner.get_parameters(), **{name: getattr(learner, name).data for name in names or []}}


def set_parameters(learner: BaseAlgorithm, parameters: Parameters) -> None:
    """Take over what `parameters_of` returned, from a learner of the same algorithm and network."""
    _, names = learner._get_torch_save_params()
    for name in names or []:
        getattr(learner, name).data.copy_(parameters[name])
    states = {name: state for name, state in parameters.items() if name not in (names or [])}
    learner.set_parameters(states, exact_match=True)


def inherit(learner: BaseAlgorithm, parameters: Parameters, settings: TrainSettings) -> None:
    """Begin a lesson with what an earlier one has learned."""
    if settings.optimiser == "fresh":
        fresh = parameters_of(learner)
        parameters = {name: fresh[name] if "optimizer" in name else value for name, value in parameters.items()}
    set_parameters(learner, parameters)


def has_finite_weights(learner: BaseAlgorithm) -> bool:
    """Return whether all weights are numbers no larger than MAX_WEIGHT."""
    values = learner.policy.state_dict().values()
    return all(bool((value.abs() <= MAX_WEIGHT).all()) for value in values)  # false for nan
