"""The Stable-Baselines3 algorithm of a lesson, and everything that its future depends on.

What passes from lesson to lesson: the network's weights with its running means and spreads, and the optimisers'
moments unless the lesson asks for fresh ones. Memories of old decisions do not: they are of another cave.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from aquanav_tools.envs.observation import layout
from aquanav_tools.errors import InputError
from aquanav_tools.policy.normaliser import NormalisedObservations
from aquanav_tools.train.settings import OFF_POLICY, TrainSettings
from aquanav_tools.train.update import LeanPPO

EXPLORATION = 0.1
"""Standard deviation of the noise on td3's actions; the value of its authors (Fujimoto et al. 2018)."""
MAX_WEIGHT = 1e9
"""Of a network that can still compute: four layers of such weights overflow float32, at 3e38."""
Parameters = dict[str, Any]


def class_of(algorithm: str) -> Any:
    """Return the class of an algorithm.

    Raises:
        InputError: it is not installed.
    """
    return _recurrent_ppo() if algorithm == "recurrent-ppo" else {"ppo": LeanPPO, "sac": SAC, "td3": TD3}[algorithm]


def make_learner(envs: VecEnv, settings: TrainSettings, seed: int) -> BaseAlgorithm:
    """Return an untrained algorithm.

    Raises:
        InputError: the algorithm is not installed.
    """
    make = _make_off_policy if settings.algorithm in OFF_POLICY else _make_on_policy
    learner = make(envs, settings, seed)
    _hide(learner, settings)
    learner.set_logger(Logger(None, []))
    return learner


def _make_on_policy(envs: VecEnv, settings: TrainSettings, seed: int) -> BaseAlgorithm:
    is_recurrent = settings.algorithm == "recurrent-ppo"
    return class_of(settings.algorithm)(
        "MlpLstmPolicy" if is_recurrent else "MlpPolicy",
        envs,
        learning_rate=LinearSchedule(settings.learning_rate, 0.0, 1.0),
        n_steps=settings.buffer // settings.num_envs,
        batch_size=settings.batch,
        n_epochs=settings.epochs,
        gamma=settings.discount,
        gae_lambda=settings.trace,
        clip_range=settings.clip,
        ent_coef=settings.entropy,
        policy_kwargs=_network(settings) | ({"lstm_hidden_size": settings.memory} if is_recurrent else {}),
        seed=seed,
        device="cpu",
    )


def _make_off_policy(envs: VecEnv, settings: TrainSettings, seed: int) -> BaseAlgorithm:
    noise = NormalActionNoise(np.zeros(3), np.full(3, EXPLORATION)) if settings.algorithm == "td3" else None
    return class_of(settings.algorithm)(
        "MlpPolicy",
        envs,
        learning_rate=LinearSchedule(settings.learning_rate, 0.0, 1.0),
        buffer_size=settings.replay,
        learning_starts=settings.warm_up,
        batch_size=settings.batch,
        gamma=settings.discount,
        train_freq=1,
        gradient_steps=max(1, round(settings.update_ratio * settings.num_envs)),
        action_noise=noise,
        policy_kwargs=_network(settings),
        seed=seed,
        device="cpu",
    )


def _network(settings: TrainSettings) -> dict[str, Any]:
    normalising = {"features_extractor_class": NormalisedObservations} if settings.normalise else {}
    return {"net_arch": list(settings.hidden), "activation_fn": torch.nn.SiLU, **normalising}


def _recurrent_ppo() -> Any:
    try:
        from sb3_contrib import RecurrentPPO
    except ImportError as cause:
        raise InputError(
            "recurrent-ppo needs sb3-contrib, which is not installed. Install it: pip install 'aquanav[recurrent]'"
        ) from cause
    return RecurrentPPO


def take_in(learner: BaseAlgorithm, observations: np.ndarray, settings: TrainSettings) -> None:
    """Let the network's normalisers see observations; nothing where it has none."""
    for module in learner.policy.modules():
        if isinstance(module, NormalisedObservations):
            module.take_in(observations)
    _hide(learner, settings)


def _hide(learner: BaseAlgorithm, settings: TrainSettings) -> None:
    """Keep from the network what it is to be blind to."""
    if not settings.blind_to:
        return
    slices = layout(settings.observation)
    places = {"distance": slices["goal"].start, "elevation": slices["goal"].start + 2}
    places |= {"depth": slices["depth"].start} if "depth" in slices else {}
    for module in learner.policy.modules():
        if isinstance(module, NormalisedObservations):
            module.hide([places[name] for name in settings.blind_to])


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


def is_sound(learner: BaseAlgorithm) -> bool:
    """Return whether all weights are numbers no larger than MAX_WEIGHT."""
    values = learner.policy.state_dict().values()
    return all(bool((value.abs() <= MAX_WEIGHT).all()) for value in values)  # false for nan
