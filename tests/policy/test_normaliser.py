from __future__ import annotations

import numpy as np
import torch
from gymnasium import spaces

from aquanav_tools.policy.normaliser import LIMIT, NormalisedObservations


def make(size: int = 3) -> NormalisedObservations:
    return NormalisedObservations(spaces.Box(-1.0, 1.0, (size,)))


def test_what_came_in_parts_counts_as_if_it_came_at_once(rng: np.random.Generator) -> None:
    seen = rng.normal([0.3, -2.0, 0.0], [0.1, 3.0, 1e-3], (1000, 3)).astype(np.float32)
    layer = make()
    for part in np.split(seen, [1, 17, 600]):
        layer.take_in(part)
    # float32 keeps 24 bits: each of the four sums is rounded by at most 6e-8.
    np.testing.assert_allclose(layer.mean, seen.astype(np.float64).mean(axis=0), rtol=4 * 6e-8, atol=1e-9)
    np.testing.assert_allclose(layer.variance, seen.astype(np.float64).var(axis=0), rtol=1e-6)
    assert int(layer.count) == 1000


def test_scaled_observations_have_no_mean_and_unit_spread(rng: np.random.Generator) -> None:
    seen = rng.uniform(0.4, 0.6, (5000, 3)).astype(np.float32)
    layer = make()
    layer.take_in(seen)
    scaled = layer(torch.from_numpy(seen)).numpy()
    # 0.5 / 0.058 = 9 is what float32 subtracts from: 9 * 6e-8 per value.
    np.testing.assert_allclose(scaled.mean(axis=0), 0.0, atol=1e-5)
    np.testing.assert_allclose(scaled.std(axis=0), 1.0, atol=1e-5)


def test_outliers_are_clipped_and_constants_are_harmless() -> None:
    layer = make()
    layer.take_in(np.array([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]], dtype=np.float32))
    scaled = layer(torch.tensor([[100.0, 1.0, 0.5]])).numpy()
    np.testing.assert_array_equal(scaled, [[LIMIT, 0.0, LIMIT]])


def test_before_anything_was_seen_observations_pass_as_they_are() -> None:
    observations = torch.tensor([[0.5, -1.0, 0.25]])
    # EPSILON changes the spread of 1 by 5e-9, less than float32 shows.
    assert torch.equal(make()(observations), observations)


def test_statistics_travel_with_the_weights(rng: np.random.Generator) -> None:
    layer, other = make(), make()
    layer.take_in(rng.random((10, 3)))
    other.load_state_dict(layer.state_dict())
    assert all(torch.equal(other.state_dict()[name], value) for name, value in layer.state_dict().items())
    assert set(layer.state_dict()) == {"mean", "variance", "count"}
