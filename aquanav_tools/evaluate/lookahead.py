"""Where commands would take a vehicle in free water, by its own equations of motion."""

from __future__ import annotations

from itertools import product

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.sim.batch.prediction import Predictor
from aquanav_tools.sim.command import NUM_CHOICES, Command

CHOICES = tuple(
    Command(1.0 - ballast, 1.0 - steer, thrust - 1.0)
    for ballast, steer, thrust in product(range(NUM_CHOICES), repeat=3)
)
"""The 27 commands of the multidiscrete form, in the order of the discrete one."""


def predictor_of(env: CaveEnv, *, has_map: bool, knows_draws: bool = False) -> Predictor:
    """Return the equations of an environment's vehicle for its decisions, with its map or without.

    They are those of the vehicle's file, or of what this episode drew for it.
    """
    settings = env.scenario.settings
    limits, field = settings.limits, env.scenario.field if has_map else None
    draws = env.drawn_dynamics if knows_draws else None
    return Predictor(env.vehicle, settings.water.density, limits.dt, limits.substeps, field, draws)
