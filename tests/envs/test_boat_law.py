"""Boats that a law of motion of the user's own moves, held against what the law says in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from aquanav_tools.envs.boat_batch import BoatBatch
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.errors import InputError, OwnCodeError
from aquanav_tools.sim.boat import footprint_of, load_boat
from tests.envs.test_boat_extensions import SMALL, steers
from tests.envs.test_surface_env import bay_with, block
from tests.own_modules import WriteModule, own_module

__all__ = ["own_module"]

SPEED, TURN = 2.0, 0.5
"""Of the glider at full thrust and full steer, m/s and rad/s."""
CODE = """
def glide(states, commands, currents, dt):
    after = states.copy()
    yaw = 2.0 * np.arctan2(states[:, 6], states[:, 3])
    ahead = np.stack([np.cos(yaw), np.sin(yaw), 0.0 * yaw], axis=1)
    after[:, :3] += dt * (2.0 * commands[:, 2:] * ahead + currents)
    yaw = yaw + dt * 0.5 * commands[:, 1]
    after[:, 3:7] = np.stack([np.cos(yaw / 2), 0.0 * yaw, 0.0 * yaw, np.sin(yaw / 2)], axis=1)
    after[:, 7:] = 0.0
    after[:, 7], after[:, 12] = 2.0 * commands[:, 2], 0.5 * commands[:, 1]
    return after

def leap(states, commands, currents, dt):
    return states + 2.0 * (np.arange(13) == 1)
"""


@pytest.mark.parametrize("sea", ["still", "rough"])
def test_a_law_says_where_boats_go_whatever_the_sea(sea: str, own_module: WriteModule) -> None:
    batch = BoatBatch(bay_with(), 3, next_step=False, sea=sea, motion=f"{own_module(CODE)}:glide", current="still")
    batch.reset([1, 2, 3])
    begun, drift = batch.copy_of("positions"), np.zeros((3, 3))
    for _ in range(20):  # 2 s: ahead, waiting, turning left on the spot
        batch.command(np.array([[1, 2], [1, 1], [0, 1]]))
        batch.step()
        drift += batch.decision_seconds * batch.copy_of("currents")  # that the wind makes
    moved = batch.copy_of("positions") - begun - drift
    assert np.any(drift) == (sea == "rough")
    np.testing.assert_allclose(moved, [[2.0 * SPEED, 0.0, 0.0], [0.0] * 3, [0.0] * 3], atol=1e-9)
    w, _, _, z = batch.copy_of("orientations")[2]
    assert 2.0 * np.arctan2(z, w) == pytest.approx(2.0 * TURN, abs=1e-9)


def test_rocks_stop_a_boat_whatever_law_moves_it(own_module: WriteModule) -> None:
    env = SurfaceEnv(bay_with(block(-30.0, 3.0)), sea="still", motion=f"{own_module(CODE)}:glide", current="still")
    _, info = env.reset(seed=1)
    begun, touched = info["position"][0], []
    for _ in range(100):  # 20 m ahead, where there are less than 10
        *_, info = env.step([1, 2])
        touched.append(info["collision"])
    bow = info["position"][0] + 0.5 * footprint_of(load_boat("otter")).length
    assert touched[-1] and not touched[10]
    assert begun + 5.0 < bow < -30.0 + 0.01


@pytest.mark.parametrize("num", [1, 7, 40])
def test_a_boat_moves_alone_as_it_does_among_others(num: int, own_module: WriteModule) -> None:
    options: dict[str, Any] = {"sea": "breeze", "motion": f"{own_module(CODE)}:glide", "action_delay": 1}
    batch = BoatBatch(SMALL, num, next_step=False, num_threads=2, **options)
    batch.reset([11 + n for n in range(num)])
    alone = BoatBatch(SMALL, 1, next_step=False, **options)
    alone.reset([11 + num - 1])
    for n in range(60):
        actions = steers(num, n)
        for each, chosen in ((batch, actions), (alone, actions[-1:])):
            each.command(chosen)
            each.step()
        for name in ("positions", "orientations", "velocities", "observations", "rewards", "touched"):
            assert np.array_equal(batch.copy_of(name)[-1:], alone.copy_of(name)), (name, n)


def test_a_law_that_fails_is_told_and_one_on_a_gpu_is_refused(own_module: WriteModule) -> None:
    own = own_module(CODE)
    env = SurfaceEnv(bay_with(), motion=f"{own}:leap")
    env.reset(seed=1)
    with pytest.raises(OwnCodeError, match="moved a vehicle by 2 m in one physics step, more than 1 m"):
        env.step([1, 2])
    with pytest.raises(InputError, match=r"law of motion of your own is computed on the processor|There is no device"):
        BoatBatch(SMALL, 2, next_step=False, device="cuda", motion=f"{own}:glide")
