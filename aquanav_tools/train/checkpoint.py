"""All that the future of a training run depends on, in one file.

A run that goes on from it ends like one that never stopped. Beside the learner's tensors that takes every generator of
random numbers, where each environment is, the running statistics of returns, the learning curve and the best policy's
score. The file holds tensors, texts and numbers only, so that reading it runs no code.
"""

from __future__ import annotations

import io
import json
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from aquanav_tools.errors import InputError, TrainingError
from aquanav_tools.store import check_room, write_whole
from aquanav_tools.train.advice import AdviceMemory
from aquanav_tools.train.environments import Resumable
from aquanav_tools.train.learners import parameters_of, set_parameters

FORMAT = 3
CHECKPOINT_FILE = "checkpoint.pt"
REPLAYED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Arrays of SB3's replay buffer."""


@dataclass(frozen=True)
class Checkpoint:
    """A run between two updates."""

    lesson: int
    """Index of the lesson."""
    is_lesson_over: bool
    """Whether its last update is done."""
    learner: dict[str, Any]
    """Tensors and counters of the learner, as `learner_state` returns them."""
    journal: dict[str, Any]
    """Plain values that the run keeps: curve, trials, seconds."""


def write_checkpoint(checkpoint: Checkpoint, folder: Path) -> None:
    """Write a checkpoint; the one before is replaced only when the new one is whole.

    Raises:
        ResourceError: the disk is nearly full.
    """
    check_room(folder)
    stream = io.BytesIO()
    journal = json.dumps(checkpoint.journal)
    table = {**vars(checkpoint), "journal": journal, "format": FORMAT}
    torch.save(table, stream)
    write_whole(folder / CHECKPOINT_FILE, stream.getvalue())


def read_checkpoint(folder: Path) -> Checkpoint | None:
    """Return the checkpoint in a folder; None where there is none.

    Raises:
        InputError: it is damaged, or of another format.
    """
    path = folder / CHECKPOINT_FILE
    if not path.is_file():
        return None
    try:
        table = torch.load(path, weights_only=True)
        if table.pop("format") != FORMAT:
            raise ValueError("another version of aquanav wrote it")
        return Checkpoint(**{**table, "journal": json.loads(table["journal"])})
    except Exception as cause:  # whatever damaged bytes make the parser raise
        reason = str(cause).partition("\n")[0] or type(cause).__name__
        raise InputError(
            f"The checkpoint {path} ({path.stat().st_size} bytes) cannot be read: {reason}. It was "
            "changed or damaged. Restore it, or begin anew with --overwrite."
        ) from cause


def learner_state(learner: BaseAlgorithm, envs: Resumable, scale: VecNormalize) -> dict[str, Any]:
    """Return what a learner's future depends on, between two updates."""
    state = {
        "parameters": parameters_of(learner),
        "generators": _generators(learner),
        "num_timesteps": learner.num_timesteps,
        "num_updates": getattr(learner, "_n_updates", 0),
        "observations": torch.from_numpy(np.array(learner._last_obs)),
        "episode_starts": torch.from_numpy(np.array(learner._last_episode_starts)),
        "returns": torch.from_numpy(scale.returns.copy()),
        "spread": return_statistics(scale),
        "environments": envs.state(),
    }
    if hasattr(learner, "_last_lstm_states"):
        state["lstm"] = [tensor.clone() for pair in learner._last_lstm_states for tensor in pair]
    replay = getattr(learner, "replay_buffer", None)
    if replay is not None:
        end = replay.buffer_size if replay.full else replay.pos
        names = replay.arrays if isinstance(replay, AdviceMemory) else REPLAYED
        arrays = {name: torch.from_numpy(getattr(replay, name)[:end]) for name in names}
        state["replay"] = {"pos": replay.pos, "full": replay.full, "arrays": arrays}
    return state


def restore_learner(learner: Any, envs: Resumable, scale: VecNormalize, state: dict[str, Any]) -> None:
    """Bring a new learner, with new environments, to where the state was taken.

    Raises:
        TrainingError: the environments do not come back to where they were.
    """
    set_parameters(learner, state["parameters"])
    learner.num_timesteps, learner._n_updates = state["num_timesteps"], state["num_updates"]
    observations = envs.restore(state["environments"])
    if not np.array_equal(observations, state["observations"].numpy()):
        raise TrainingError(
            "The environments do not come back to where the checkpoint left them, so the run cannot go on as it would "
            "have. The simulation changed, by another version of aquanav or its libraries, or of the processor. Go on "
            "with the versions named in train.json, or begin anew with --overwrite."
        )
    learner._last_obs = learner._last_original_obs = observations
    learner._last_episode_starts = state["episode_starts"].numpy()
    set_return_statistics(scale, state["spread"])
    scale.returns = state["returns"].numpy().copy()
    scale.old_obs = observations
    if "lstm" in state:
        actor, actor_cells, critic, critic_cells = state["lstm"]
        learner._last_lstm_states = type(learner._last_lstm_states)((actor, actor_cells), (critic, critic_cells))
    if "replay" in state:
        _refill(learner.replay_buffer, state["replay"])
    _set_generators(learner, state["generators"])


def return_statistics(scale: VecNormalize) -> list[float]:
    """Return the running mean, variance and count of the returns."""
    return [float(scale.ret_rms.mean), float(scale.ret_rms.var), float(scale.ret_rms.count)]


def set_return_statistics(scale: VecNormalize, statistics: list[float]) -> None:
    """Take over the running mean, variance and count of other returns."""
    mean, variance, count = statistics
    scale.ret_rms.mean, scale.ret_rms.var, scale.ret_rms.count = np.array(mean), np.array(variance), count


def _refill(replay: Any, state: dict[str, Any]) -> None:
    for name, tensor in state["arrays"].items():
        getattr(replay, name)[: len(tensor)] = tensor.numpy()
    replay.pos, replay.full = state["pos"], state["full"]


def _generators(learner: BaseAlgorithm) -> dict[str, Any]:
    numbers: Any = np.random.get_state()  # SB3 draws minibatches from NumPy's global generator
    return {
        "torch": torch.get_rng_state(),
        "numpy": [numbers[0], torch.from_numpy(numbers[1].astype(np.int64)), *numbers[2:]],
        "python": json.dumps(random.getstate()),
        "actions": json.dumps(_state_of(learner.action_space.np_random)),
    }


def _set_generators(learner: BaseAlgorithm, states: dict[str, Any]) -> None:
    torch.set_rng_state(states["torch"])
    kind, keys, position, has_gauss, gauss = states["numpy"]
    np.random.set_state((kind, keys.numpy().astype(np.uint32), position, has_gauss, gauss))
    version, numbers, gauss_next = json.loads(states["python"])
    random.setstate((version, tuple(numbers), gauss_next))
    learner.action_space.np_random.bit_generator.state = json.loads(states["actions"])


def _state_of(generator: np.random.Generator) -> dict[str, Any]:
    return dict(generator.bit_generator.state)
