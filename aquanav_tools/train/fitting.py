"""Rollout, minibatch and warm-up that fit a lesson's length, and what the lesson then learns from."""

from __future__ import annotations

import dataclasses
import math

from aquanav_tools.train.settings import OFF_POLICY, TrainSettings

MIN_UPDATES = 30
"""Of PPO in a lesson. Chosen: three updates of the original's 20,480 decisions learn nothing that can be seen."""
FEW_UPDATES = 10
LARGEST_ROLLOUT = 20_480
"""The original's."""
MINIBATCHES = 16
"""Of a rollout; the original has 20."""
SMALLEST_BATCH = 32
WARM_UP = 10_000
"""Decisions, where a twentieth of the lesson is more."""


def fitted(lesson: TrainSettings) -> TrainSettings:
    """Return a lesson with numbers for what it leaves open: n_steps, batch and learning_starts."""
    n_steps = lesson.n_steps or _n_steps(lesson)
    return dataclasses.replace(
        lesson,
        n_steps=n_steps,
        batch=lesson.batch or _batch(n_steps * lesson.num_envs),
        learning_starts=lesson.learning_starts or min(WARM_UP, lesson.steps // 20),
    )


def update_size(lesson: TrainSettings) -> int:
    """Return the decisions of which a fitted lesson learns from whole multiples."""
    return lesson.num_envs if lesson.algorithm in OFF_POLICY else lesson.rollout_size


def num_updates(lesson: TrainSettings, done: int = 0) -> int:
    """Return how often a fitted lesson collects decisions and learns from them, after those that are done."""
    return math.ceil((lesson.steps - done) / update_size(lesson))


def decisions_of(lesson: TrainSettings, done: int = 0) -> int:
    """Return the decisions that a fitted lesson really learns from: its steps, but in whole updates."""
    return done + num_updates(lesson, done) * update_size(lesson)


def described(lesson: TrainSettings, done: int = 0) -> str:
    """Return a sentence about what a fitted lesson will learn from, after the decisions that are done."""
    size, number, total = update_size(lesson), num_updates(lesson, done), decisions_of(lesson, done)
    asked = "" if total == lesson.steps else f" ({lesson.steps:,} were asked for)"
    asked += f", {done:,} of them before and {total - done:,}" if done else ""
    if lesson.algorithm in OFF_POLICY:
        return (
            f"{total:,} decisions{asked}, {size} at a time, one in each environment; the first "
            f"{lesson.learning_starts:,} are taken at random, and nothing is learned before."
        )
    updates = f"{number:,} update{'s' if number > 1 else ''}"
    text = f"{total:,} decisions{asked} in {updates} of {size:,} ({lesson.n_steps:,} of each environment: n_steps)."
    if number < FEW_UPDATES and not done:
        is_least = lesson.rollout_size <= math.lcm(lesson.num_envs, MINIBATCHES)
        smaller = "" if is_least else ", or fewer per update (--n-steps 0 takes what fits)"
        text += f" So few updates teach little: take more steps{smaller}."
    return text


def _n_steps(lesson: TrainSettings) -> int:
    """Return those of the largest rollout with enough updates, or of one up to a third smaller, nearer to the steps.

    The rollout is a multiple of the environments and of the minibatches.
    """
    unit = math.lcm(lesson.num_envs, lesson.batch or MINIBATCHES)
    units = math.ceil(lesson.steps / unit)
    largest = max(1, min(units // MIN_UPDATES, LARGEST_ROLLOUT // unit))
    sizes = range(largest, max(1, 2 * largest // 3) - 1, -1)
    rollout_size = unit * min(sizes, key=lambda size: size * math.ceil(units / size))
    return rollout_size // lesson.num_envs


def _batch(rollout_size: int) -> int:
    """Return the divisor of a rollout's size that is nearest, as a ratio, to a sixteenth of it."""
    wanted = max(SMALLEST_BATCH, rollout_size // MINIBATCHES)
    divisors = [size for size in range(1, rollout_size + 1) if rollout_size % size == 0]
    return min(divisors, key=lambda size: max(size / wanted, wanted / size))
