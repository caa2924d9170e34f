"""What an episode's decisions lead to, in Warp: how it ends, and the amounts that the reward's terms are paid for."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from aquanav_tools.sim.batch.runtime import OPTIONS, find_device, launch_kernel
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
RUNNING, SUCCESS, COLLISION, TIMEOUT = (wp.constant(n) for n in range(4))
"""Outcomes, in the order of `envs.episode.OUTCOMES`."""
NUM_TERMS = 7
"""Of the reward: progress, time, contact, proximity, goal, collision, timeout."""


@wp.func
def outcome_of(is_touching: int, ends_on_collision: int, is_at_goal: bool, decisions: int, max_decisions: int):
    """Return the outcome after a decision; a contact during the decision comes before the goal at its end."""
    if ends_on_collision == 1 and is_touching == 1:
        return COLLISION
    if is_at_goal:
        return SUCCESS
    if decisions >= max_decisions:
        return TIMEOUT
    return RUNNING


@wp.func
def term_amount(term: int, gained: f64, steps: int, touched: int, cut_off: f64, outcome: int):
    """Return what the weight of a term of the reward is multiplied by.

    Args:
        term: Its number, in the order of `envs.reward.TERMS`.
        gained: Progress in the decision, m.
        steps: Physics steps of the decision.
        touched: Those in contact.
        cut_off: Sum over the rays of 1 - distance / length.
        outcome: After the decision.
    """
    if term == 0:
        return gained
    if term == 1:
        return f64(steps)
    if term == 2:
        return f64(touched)
    if term == 3:
        return f64(steps) * cut_off
    return f64(outcome == term - 3)  # goal, collision and timeout, in the order of the outcomes


@wp.kernel
def probe_decision(
    num_touched: int, settings: wp.vec4i, is_at_goal: bool, gained: f64, cut_off: f64,
    outcome: wp.array(dtype=wp.int32), amounts: wp.array(dtype=f64),
):  # fmt: skip
    """Write the outcome of one decision, and what each term is paid for."""
    steps, decisions, most = settings[0], settings[1], settings[2]
    result = outcome_of(int(num_touched > 0), settings[3], is_at_goal, decisions, most)
    outcome[0] = result
    for n in range(amounts.shape[0]):
        amounts[n] = term_amount(n, gained, steps, num_touched, cut_off, result)


@dataclass(frozen=True)
class Decision:
    """What happened in one decision, and the rules that judge it: for looking at these by themselves."""

    gained: float = 0.0
    """Progress, m."""
    num_touched: int = 0
    """Physics steps in contact."""
    cut_off: float = 0.0
    """Sum over the rays of 1 - distance / length."""
    is_at_goal: bool = False
    decisions: int = 1
    """Made so far."""
    max_decisions: int = 2400
    ends_on_collision: bool = False
    steps: int = 5
    """Physics steps."""

    def judge(self) -> tuple[int, Array]:
        """Return the outcome's number, and the (7,) amounts that the terms of the reward are paid for."""
        device = find_device("cpu")
        outcome = wp.zeros(1, dtype=wp.int32, device=device)
        amounts = wp.zeros(NUM_TERMS, dtype=wp.float64, device=device)
        settings = wp.vec4i(self.steps, self.decisions, self.max_decisions, int(self.ends_on_collision))
        inputs = [self.num_touched, settings, self.is_at_goal, self.gained, self.cut_off, outcome, amounts]
        launch_kernel(probe_decision, dim=1, inputs=inputs, device=device)
        return int(outcome.numpy()[0]), amounts.numpy()
