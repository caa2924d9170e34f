"""Learning by imitation: its loss, what a policy learns of it, and mirrored vehicles, taught in their mirror."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from aquanav_tools.errors import InputError
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.sim.contacts import default_backend
from aquanav_tools.train import training
from aquanav_tools.train.advice import AdviceMemory
from aquanav_tools.train.batched import BatchedEnvs
from aquanav_tools.train.learners import make_learner
from aquanav_tools.train.mirror import MirroredEnvs
from aquanav_tools.train.ppo import Advice, Batch, ParallelPPO
from aquanav_tools.train.settings import RunSettings, TrainSettings
from aquanav_tools.train.training import train
from tests.evaluate.winding import winding_scenario
from tests.train.runs import TINY, assert_stopped_run_ends_alike, tiny_pipeline

ON_BATCH = RunSettings(backend="batch", checkpoint_every=128, final_episodes=0)
TAUGHT = dataclasses.replace(TINY, observation="full", imitation=(1.0, 1.0))


@pytest.fixture(autouse=True)
def no_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare a second for each run."""
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)


def learner_of(settings: TrainSettings, envs: Any) -> ParallelPPO:
    learner = make_learner(envs, settings, 0)
    assert isinstance(learner, ParallelPPO)
    return learner


def test_the_share_goes_in_a_straight_line_from_the_first_to_the_last() -> None:
    learner = learner_of(
        dataclasses.replace(TAUGHT, imitation=(0.8, 0.2)), BatchedEnvs([winding_scenario()] * 4, TAUGHT)
    )
    shares = []
    for remaining in (1.0, 0.5, 0.0, -0.1):
        learner._current_progress_remaining = remaining
        shares.append(learner.imitation_share)
    assert shares == pytest.approx([0.8, 0.5, 0.2, 0.2])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_the_actors_gradient_is_that_of_the_two_losses_by_their_shares(share: float, rng: np.random.Generator) -> None:
    """By torch's own cross-entropy and a clipped ratio written out."""
    settings = dataclasses.replace(TAUGHT, imitation=(share, share), ent_coef=0.0)
    learner = learner_of(settings, BatchedEnvs([winding_scenario()] * 4, settings))
    num, size = 50, learner.observation_space.shape[0]  # type: ignore[index]
    features = torch.from_numpy(rng.normal(size=(num, size)).astype(np.float32))
    actions, advice = (torch.from_numpy(rng.integers(3, size=(num, 3))) for _ in range(2))
    advantages = torch.from_numpy(rng.normal(size=num).astype(np.float32))
    old = torch.from_numpy(rng.normal(-3.3, 0.2, num).astype(np.float32))
    advised = Advice(features.flip(0), advice) if share else None  # other decisions than the rollout's
    learner._backward_actor(Batch(features, actions, old, advantages, advantages), advised, 0.2)
    actor = list(learner.policy.action_net.parameters())  # type: ignore[union-attr]
    found = [parameter.grad.clone() for parameter in actor]
    learner.policy.zero_grad()
    logits = learner.actor(features).view(num, 3, 3)
    log_probs = torch.log_softmax(logits, dim=2).gather(2, actions[..., None]).sum(dim=(1, 2))
    ratio = (log_probs - old).exp()
    surrogate = -torch.minimum(ratio * advantages, ratio.clamp(0.8, 1.2) * advantages).mean()
    entropy = torch.nn.functional.cross_entropy(logits.flip(0).reshape(-1, 3), advice.reshape(-1)) * 3.0
    ((1.0 - share) * surrogate + share * entropy).backward()
    for parameter, gradient in zip(actor, found, strict=True):
        torch.testing.assert_close(gradient, parameter.grad, atol=1e-6, rtol=1e-4)


def test_a_policy_comes_to_choose_as_the_oracle_does(tmp_path: Path) -> None:
    """A third by chance; what is paid for by the reward has no part in it."""
    settings = dataclasses.replace(
        TAUGHT, num_envs=16, n_steps=16, batch=64, epochs=8, hidden=(64,), steps=8192, learning_rate=3e-3, ent_coef=0.0
    )
    envs = BatchedEnvs([winding_scenario()] * 16, settings)
    learner = learner_of(settings, envs)
    learner.teacher = envs.advice
    before = _agreement(learner, envs)
    learner.learn(settings.steps)
    after = _agreement(learner, envs)
    assert before < 0.5
    assert after > 0.58
    envs.close()


def _agreement(learner: ParallelPPO, envs: BatchedEnvs) -> float:
    """Share of the choices, where the policy's likeliest lead, that are the oracle's."""
    seen, alike = envs.reset(), []
    for _ in range(60):
        chosen, _ = learner.predict(seen, deterministic=True)
        alike.append((chosen == envs.advice()).mean())
        seen, *_ = envs.step(chosen)
    return float(np.mean(alike))


def test_what_a_share_that_rises_from_nothing_learns_of_first_was_asked() -> None:
    settings = dataclasses.replace(TAUGHT, imitation=(0.0, 1.0), steps=512)
    learner = learner_of(settings, BatchedEnvs([winding_scenario()] * 4, settings))
    learner.teacher = lambda: np.full((4, 3), 2)
    learner.learn(settings.rollout_size)
    assert learner.replay_buffer is not None and len(learner.replay_buffer) == settings.rollout_size
    assert (learner.replay_buffer.advice[: settings.rollout_size] == 2).all()


def test_greedy_vehicles_take_the_likeliest_choice_and_only_the_others_teach_the_reward() -> None:
    settings = dataclasses.replace(TAUGHT, num_envs=20, n_steps=8, batch=20, imitation=(0.5, 0.5), greedy=0.4)
    learner = learner_of(settings, BatchedEnvs([winding_scenario()] * 20, settings))
    learner.teacher = lambda: np.zeros((20, 3), dtype=np.int64)
    greedy = learner.greedy.numpy()
    assert greedy.sum() == 8
    assert greedy[::2].any() and greedy[1::2].any()  # on both sides of a mirror
    learner.learn(settings.rollout_size)
    buffer, memory = learner.rollout_buffer, learner.replay_buffer
    assert memory is not None and len(memory) == settings.rollout_size  # all of them are asked about
    learned_from = learner._rollout()
    assert len(learned_from.actions) == 8 * 12
    by_chance = buffer.actions.swapaxes(0, 1)[~greedy]  # each environment's decisions in turn
    assert np.array_equal(learned_from.actions.numpy(), by_chance.reshape(-1, 3))


@pytest.mark.parametrize(("num", "share", "count"), [(4, 0.95, 3), (4, 0.25, 1), (10, 0.2, 2)])
def test_so_many_are_greedy_and_never_all(num: int, share: float, count: int) -> None:
    settings = dataclasses.replace(TAUGHT, num_envs=num, n_steps=4, batch=num, imitation=(0.5, 0.5), greedy=share)
    learner = learner_of(settings, BatchedEnvs([winding_scenario()] * num, settings))
    learner.teacher = lambda: np.zeros((num, 3), dtype=np.int64)
    assert int(learner.greedy.sum()) == count
    learner.learn(settings.rollout_size)


def test_what_greedy_vehicles_choose_is_what_the_policy_predicts() -> None:
    settings = dataclasses.replace(TAUGHT, num_envs=20, batch=20, n_steps=1, greedy=0.5)
    learner = learner_of(settings, BatchedEnvs([winding_scenario()] * 20, settings))
    learner.teacher = lambda: np.zeros((20, 3), dtype=np.int64)
    _, callback = learner._setup_learn(20, None)
    likeliest, _ = learner.predict(learner._last_obs, deterministic=True)
    learner.collect_rollouts(learner.env, callback, learner.rollout_buffer, 1)
    chosen = learner.rollout_buffer.actions[0]
    greedy = learner.greedy.numpy()
    assert np.array_equal(chosen[greedy], likeliest[greedy])
    assert not np.array_equal(chosen[~greedy], likeliest[~greedy])


def test_a_mirrored_vehicle_is_taught_in_its_mirror(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = dataclasses.replace(TAUGHT, num_envs=2, batch=2, n_steps=1, mirrored=True)
    envs = MirroredEnvs(BatchedEnvs([winding_scenario()] * 2, settings), settings)
    to_the_left = np.array([[0, 0, 2], [0, 0, 2]])
    monkeypatch.setattr(BatchedEnvs, "advice", lambda _: to_the_left.copy())
    assert envs.advice().tolist() == [[0, 0, 2], [0, 2, 2]]
    envs.close()


def test_a_stopped_run_ends_as_one_that_never_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_scenario(winding_scenario(), tmp_path / "winding")
    choices = {"observation": "full", "imitation": (1.0, 0.3), "steps": 256}
    pipeline = tiny_pipeline(tmp_path / "winding", 1, ON_BATCH, **choices)
    assert_stopped_run_ends_alike(pipeline, tmp_path, monkeypatch)


def test_a_policy_keeps_nothing_of_what_it_was_taught(tmp_path: Path) -> None:
    """The advice of the last rollout is no part of a zip."""
    learner = learner_of(TAUGHT, BatchedEnvs([winding_scenario()] * 4, TAUGHT))
    assert {"advice", "teacher", "replay_buffer", "_imitation"} <= set(learner._excluded_save_params())


def test_the_memory_holds_the_last_decisions_it_has_room_for(rng: np.random.Generator) -> None:
    memory = AdviceMemory(10, 2)
    seen = rng.uniform(-1, 1, (27, 2)).astype(np.float32)
    advice = np.arange(27)[:, None] % 3 * np.ones(3, dtype=np.int64)
    for first, last, known in ((0, 4, 4), (4, 8, 8), (8, 12, 10), (12, 27, 10)):  # the last are more than it holds
        memory.add(seen[first:last], advice[first:last])
        assert len(memory) == known
        kept = {tuple(row) for row in memory.observations[: len(memory)].tolist()}
        assert kept == {tuple(row) for row in seen[last - known : last].astype(np.float16).tolist()}
    observations, choices = memory.draw(200)
    for row, choice in zip(observations.numpy(), choices.numpy(), strict=True):
        number = int(np.abs(seen - row).sum(axis=1).argmin())
        assert number >= 17
        assert (choice == number % 3).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"imitation": (1.2, 0.0)}, "two shares from 0 to 1"),
        ({"imitation": (1.0, 0.0), "action": "continuous", "algorithm": "sac"}, "here sac acts by continuous ones"),
        ({"imitation": (0.0, 0.5), "action": "discrete"}, "here ppo acts by discrete ones"),
        ({"imitation": (0.5, 0.5), "greedy": 1.0}, "greedy must be a share from 0 to below 1"),
        ({"imitation": (0.5, 0.5), "greedy": 0.1}, "greedy = 0.1 of num_envs = 4 is less than one"),
        ({"greedy": 0.3}, "What 30% greedy environments meet is learned by imitation, and there is none"),
    ],
)
def test_what_cannot_be_taught_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(TINY, **changes)


def test_single_vehicles_are_not_taught(tmp_path: Path) -> None:
    write_scenario(winding_scenario(), tmp_path / "winding")
    run = RunSettings(final_episodes=0)
    with pytest.raises(InputError, match=f"needs caves and the batch, and this is {default_backend()}"):
        train(
            tiny_pipeline(tmp_path / "winding", 1, run, observation="full", imitation=(1.0, 1.0)), 0, tmp_path / "out"
        )
