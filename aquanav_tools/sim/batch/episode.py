"""What an episode's decisions lead to, in Warp: how it ends, and the amounts that the reward's terms are paid for."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.runtime import OPTIONS

wp.set_module_options(OPTIONS)

f64 = wp.float64
RUNNING, SUCCESS, COLLISION, TIMEOUT = (wp.constant(n) for n in range(4))
"""Outcomes, in the order of `envs.episode.OUTCOMES`."""
NUM_TERMS = 7
"""Of the reward: progress, time, contact, proximity, goal, collision, timeout."""


@wp.func
def outcome_of(
    is_touching: int, ends_on_collision: int, remaining: f64, tolerance: f64, decisions: int, max_decisions: int
):
    """Return the outcome after a decision; a contact during the decision comes before the goal at its end."""
    if ends_on_collision == 1 and is_touching == 1:
        return COLLISION
    if remaining <= tolerance:
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
