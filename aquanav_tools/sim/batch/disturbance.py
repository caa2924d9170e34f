"""Rays that err or get no echo, and values that arrive late: the same functions for one vehicle and for many."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.sim.batch.random import RAYS, normal_pair, share_of_one, words
from aquanav_tools.sim.batch.runtime import OPTIONS, find_device, launch_kernel
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)


@wp.struct
class RangeNoise:
    """How measured distances err; zeros leave them as they are."""

    constant: wp.float32
    """Standard deviation of an echo's distance, m."""
    proportional: wp.float32
    """What that grows by with the distance, m/m."""
    dropout: wp.float32
    """Probability that a ray gets no echo, at whatever angle it meets the wall."""
    grazing_dropout: wp.float32
    """Probability that an echo is lost along the wall, at 90 degrees from its normal."""
    grazing_from: wp.float32
    """Angle from the normal below which no echo is lost for its angle, rad; from there the probability grows evenly."""


@wp.func
def dropout_at(noise: RangeNoise, incidence: float):
    """Return the probability that a ray gets no echo which meets the wall at an angle from its normal, rad."""
    slant = wp.clamp((incidence - noise.grazing_from) / (1.5707964 - noise.grazing_from), 0.0, 1.0)
    return noise.dropout + (1.0 - noise.dropout) * noise.grazing_dropout * slant


@wp.func
def measured_range(
    distance: float, incidence: float, length: float, noise: RangeNoise, seed: int, purpose: int, decision: int
):
    """Return a ray's distance as a real sensor gives it.

    Only an echo errs: a ray that meets nothing keeps its full length, and none reads beyond it or below zero.
    """
    result = length
    if distance < length:
        drawn = words(seed, purpose, decision)
        if share_of_one(drawn[2]) >= dropout_at(noise, incidence):
            spread = noise.constant + noise.proportional * distance
            result = wp.clamp(distance + spread * normal_pair(drawn[0], drawn[1])[0], 0.0, length)
    return result


@wp.func
def is_dropped(dropout: float, seed: int, ray: int, decision: int):
    """Return whether a ray gets no echo, which has the probability `dropout`."""
    return share_of_one(words(seed, RAYS + ray, decision)[2]) < dropout


@wp.func
def measured(distance: float, length: float, noise: float, dropout: float, seed: int, ray: int, decision: int):
    """Return a ray's distance with errors of one standard deviation, `noise` (m), and one probability of no echo."""
    errors = RangeNoise()
    errors.constant = noise
    errors.dropout = dropout
    return measured_range(distance, 0.0, length, errors, seed, RAYS + ray, decision)


@wp.func
def exchange(
    values: wp.array2d(dtype=wp.float32), waiting: wp.array2d(dtype=wp.float32), i: int, turn: int, delay: int
):
    """Put row `i` of the values into its queue, in place of the row that has waited for `delay` turns, which it gets.

    The queue has room for D rows of W one after the other, (N, D * W), of which a delay of up to D uses its number;
    `turn` counts up by one from call to call.
    """
    if delay == 0:
        return
    width = values.shape[1]
    first = turn % delay * width
    for n in range(width):
        value = values[i, n]
        values[i, n] = waiting[i, first + n]
        waiting[i, first + n] = value


@wp.func
def fill_queue(values: wp.array2d(dtype=wp.float32), waiting: wp.array2d(dtype=wp.float32), i: int):
    """Fill the queue of row `i` with its values."""
    width = values.shape[1]
    for n in range(waiting.shape[1]):
        waiting[i, n] = values[i, n % width]


@wp.kernel
def disturb(
    rays: wp.array2d(dtype=wp.float32),
    dropped: wp.array2d(dtype=wp.bool),
    lengths: wp.array(dtype=wp.float32),
    noise: float,
    dropout: float,
    seeds: wp.array(dtype=wp.int32),
    decisions: wp.array(dtype=wp.int32),
):
    """Disturb all rays in place, and write which of them got no echo."""
    i, ray = wp.tid()
    seed, decision = seeds[i], decisions[i]
    dropped[i, ray] = is_dropped(dropout, seed, ray, decision)
    rays[i, ray] = measured(rays[i, ray], lengths[ray], noise, dropout, seed, ray, decision)


class RayErrors:
    """The errors of the rays of N vehicles, for environments that keep their vehicles in NumPy's arrays."""

    def __init__(self, num: int, lengths: Array, noise: float, dropout: float) -> None:
        """Prepare for `num` vehicles.

        Args:
            num: Vehicles.
            lengths: (R,) of the rays, m.
            noise: Standard deviation of an echo's distance, m.
            dropout: Probability that a ray gets no echo.
        """
        device, shape = find_device("cpu"), (num, len(lengths))
        rays = wp.zeros(shape, dtype=wp.float32, device=device)
        dropped = wp.zeros(shape, dtype=wp.bool, device=device)
        reach = wp.array(lengths.astype(np.float32), dtype=wp.float32, device=device)
        seeds, decisions = (wp.zeros(num, dtype=wp.int32, device=device) for _ in range(2))
        self._launch = launch_kernel(
            disturb, dim=shape, inputs=[rays, dropped, reach, noise, dropout, seeds, decisions], device=device,
            record_cmd=True,
        )  # fmt: skip
        self._rays, self._dropped, self._seeds, self._decisions = (
            array.numpy() for array in (rays, dropped, seeds, decisions)
        )

    def disturb(self, rays: npt.NDArray[np.float32], seeds: Any, decisions: Any) -> tuple[Any, Any]:
        """Return (N, R) distances as real sensors give them, m, and (N, R) which rays got no echo.

        Args:
            rays: (N, R) true distances, m.
            seeds: (N,) of the episodes, from 0 to 2^32 - 1; with the decision and the ray they give its error.
            decisions: (N,) made so far in each episode.
        """
        self._rays[:], self._decisions[:] = rays, decisions
        self._seeds[:] = np.asarray(seeds, dtype=np.uint32).view(np.int32)
        self._launch.launch()
        return self._rays.copy(), self._dropped.copy()


@wp.kernel
def delay_rows(
    values: wp.array2d(dtype=wp.float32),
    waiting: wp.array2d(dtype=wp.float32),
    turns: wp.array(dtype=wp.int32),
    chosen: wp.array(dtype=wp.bool),
):
    """Delay the chosen rows; a turn of -1 fills a row's queue with its values."""
    i = wp.tid()
    if chosen[i]:
        if turns[i] < 0:
            fill_queue(values, waiting, i)
        else:
            exchange(values, waiting, i, turns[i], waiting.shape[1] // values.shape[1])


def delay(values: Any, waiting: Any, turns: Any, chosen: Any) -> None:
    """Let the rows of NumPy's arrays wait in their queues, in place.

    Args:
        values: (N, W) float32: the newest go in, those of D turns ago come out.
        waiting: (N, D * W) float32, the queues, D > 0.
        turns: (N,) of each row, counting up; -1 fills the queue with the row's values and leaves these as they are.
        chosen: (N,) bool, rows that take part.
    """
    device = find_device("cpu")
    arrays = [
        wp.array(values, dtype=wp.float32, ndim=2, copy=False, device=device),
        wp.array(waiting, dtype=wp.float32, ndim=2, copy=False, device=device),
        wp.array(np.asarray(turns, dtype=np.int32), dtype=wp.int32, device=device),
        wp.array(np.asarray(chosen), dtype=wp.bool, device=device),
    ]
    launch_kernel(delay_rows, dim=len(values), inputs=arrays, device=device)
