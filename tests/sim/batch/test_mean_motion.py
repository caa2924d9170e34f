"""The velocity that leads from one state to the next, which the wall is asked about."""

from __future__ import annotations

import numpy as np
import warp as wp

from aquanav_tools.sim.batch.contact import mean_motion
from aquanav_tools.sim.batch.motion import State, vec6
from aquanav_tools.sim.batch.runtime import OPTIONS, find_device
from tests.sim.bodies import multiply, random_states

wp.set_module_options(OPTIONS)
DT = 0.5


@wp.kernel
def measure(positions: wp.array2d(dtype=wp.vec3d), turns: wp.array2d(dtype=wp.vec4d), found: wp.array(dtype=vec6)):
    i = wp.tid()
    before = State()
    after = State()
    before.position = positions[i, 0]
    before.orientation = turns[i, 0]
    after.position = positions[i, 1]
    after.orientation = turns[i, 1]
    found[i] = mean_motion(before, after, wp.float64(0.5))


def test_mean_motion_leads_from_one_state_to_the_next_by_the_shorter_turn(rng: np.random.Generator) -> None:
    device, states = find_device("cpu"), random_states(rng, 40).reshape(20, 2, 13)
    positions = wp.array(states[..., :3], dtype=wp.vec3d, device=device)
    turns = wp.array(states[..., 3:7], dtype=wp.vec4d, device=device)
    found = wp.zeros(20, dtype=vec6, device=device)
    wp.launch(measure, dim=20, inputs=[positions, turns, found], device=device)
    for (before, after), velocity in zip(states, found.numpy(), strict=True):
        angle = np.linalg.norm(velocity[3:]) * DT
        axis = velocity[3:] / np.linalg.norm(velocity[3:])
        turn = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])
        np.testing.assert_allclose(before[:3] + DT * velocity[:3], after[:3], atol=1e-12)
        np.testing.assert_allclose(abs(multiply(turn, before[3:7]) @ after[3:7]), 1.0, atol=1e-12)
        assert angle <= np.pi + 1e-12
