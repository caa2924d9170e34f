"""Rotations against scipy's."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from aquanav_tools.types import rotation_matrix


def test_rotations_are_scipys_for_one_and_for_many_of_any_length(rng: np.random.Generator) -> None:
    quaternions = rng.normal(size=(20, 4))
    expected = Rotation.from_quat(np.roll(quaternions, -1, axis=1)).as_matrix()
    np.testing.assert_allclose(rotation_matrix(quaternions), expected, atol=1e-14)
    for quaternion, matrix in zip(quaternions, expected, strict=True):
        np.testing.assert_allclose(rotation_matrix(quaternion), matrix, atol=1e-14)
