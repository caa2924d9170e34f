"""Environments half of which are seen in a mirror that swaps left and right.

The vehicle is the same on both sides, so a cave's mirror image is another cave with as true a physics: as many caves
again to learn from, at no cost. The mirror stands in the body's x-z plane.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from aquanav_tools.envs.observation import layout
from aquanav_tools.errors import InputError
from aquanav_tools.registry import import_own, is_own
from aquanav_tools.sim.batch.sensors.base import MirrorImage
from aquanav_tools.sim.batch.sensors.suite import make_sensor
from aquanav_tools.sim.sensors import FANS
from aquanav_tools.train.settings import TrainSettings

Floats = npt.NDArray[np.float32]
FLIPPED = {"goal": [1], "velocity": [1], "rates": [0, 2], "tilt": [1], "command": [1]}
"""What changes its sign, in each slice of the observation: azimuth, sway, roll and yaw (rates are axial), how far the
left side points up, and steer."""


class MirroredEnvs(VecEnvWrapper):
    """Every second environment in a mirror."""

    def __init__(self, venv: VecEnv, settings: TrainSettings) -> None:
        """Wrap environments that observe the preset "paper" or "full", and sensors after it.

        Raises:
            InputError: a sensor has no mirror image.
        """
        super().__init__(venv)
        self._rows = np.arange(1, venv.num_envs, 2)
        self._order, self._signs = mirror_image(settings.observation, settings.sensors, len(settings.history))
        self._turned = TURNED[settings.action]

    def reset(self) -> Floats:
        """Begin all episodes."""
        return self._seen(self.venv.reset())

    def step_async(self, actions: Any) -> None:
        """Take the actions of the next decision, those of mirrored environments as they are chosen there."""
        actions = np.array(actions)
        actions[self._rows] = self._turned(actions[self._rows])
        self.venv.step_async(actions)

    def step_wait(self) -> tuple[Floats, Floats, Any, list[dict[str, Any]]]:
        """Carry out the decision."""
        observations, rewards, dones, infos = self.venv.step_wait()
        for n in self._rows[dones[self._rows]]:
            last = infos[n]["terminal_observation"]
            infos[n] = {**infos[n], "terminal_observation": last[self._order] * self._signs}
        return self._seen(observations), rewards, dones, infos

    def advice(self) -> npt.NDArray[np.int64]:
        """Return the (N, 3) choices of the oracle, as they are in the mirror."""
        choices: npt.NDArray[np.int64] = self.venv.advice()  # type: ignore[attr-defined]  # the batch of caves
        choices[self._rows] = self._turned(choices[self._rows])
        return choices

    def state(self) -> dict[str, Any]:
        """Return where all environments are."""
        found: dict[str, Any] = self.venv.state()  # type: ignore[attr-defined]  # it is Resumable
        return found

    def restore(self, state: dict[str, Any]) -> Floats:
        """Go back to where `state` was taken; return the observations there."""
        return self._seen(self.venv.restore(state))  # type: ignore[attr-defined]

    def _seen(self, observations: Any) -> Floats:
        seen: Floats = np.array(observations)
        seen[self._rows] = seen[self._rows][:, self._order] * self._signs
        return seen


def mirror_image(observation: str, sensors: Sequence[str] = (), num_earlier: int = 0) -> MirrorImage:
    """Return from which value each value of an observation's mirror image comes, and with which sign.

    Args:
        observation: The preset "paper" or "full".
        sensors: By name; their readings follow.
        num_earlier: Earlier observations of the same form that follow these.

    Raises:
        InputError: a sensor has no mirror image.
    """
    parts = [_preset_image(observation), *map(_sensor_image, sensors)] * (1 + num_earlier)
    firsts = np.cumsum([0, *(len(order) for order, _ in parts)])
    orders = [order + first for (order, _), first in zip(parts, firsts, strict=False)]
    return np.concatenate(orders), np.concatenate([signs for _, signs in parts])


def check_mirror_images(lessons: Iterable[TrainSettings]) -> None:
    """Check that what is observed in mirrored environments has a mirror image.

    Raises:
        InputError: a sensor has none.
    """
    for lesson in lessons:
        if lesson.mirrored:
            mirror_image(lesson.observation, lesson.sensors, len(lesson.history))


def _sensor_image(name: str) -> MirrorImage:
    sensor = import_own(name, "sensor") if is_own(name) else make_sensor(name)
    image = getattr(sensor, "mirror_image", None)
    if image is None:
        raise InputError(
            f"The sensor {name} has no mirror image: the method mirror_image, which says from which value each comes "
            "and with which sign. Write it, or learn without mirrored, or without the sensor."
        )
    found: MirrorImage = image()
    return found


def _preset_image(observation: str) -> MirrorImage:
    slices = layout(observation)
    size = max(part.stop for part in slices.values())
    order, signs = np.arange(size), np.ones(size, dtype=np.float32)
    first = 0
    for fan in FANS:  # straight ahead, then right and left alternately
        pairs = np.arange(first + 1, first + fan.num_rays).reshape(-1, 2)
        order[pairs] = pairs[:, ::-1]
        first += fan.num_rays
    for name in FLIPPED.keys() & slices.keys():
        signs[slices[name].start + np.array(FLIPPED[name])] = -1.0
    return order, signs


def _other_choices(actions: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return actions * [1, -1, 1] + [0, 2, 0]


def _other_numbers(actions: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return actions + 6 - 6 * (actions // 3 % 3)


def _other_levels(actions: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return actions * np.array([1.0, -1.0, 1.0], dtype=np.float32)


TURNED: dict[str, Callable[[npt.NDArray[Any]], npt.NDArray[Any]]] = {
    "multidiscrete": _other_choices,
    "discrete": _other_numbers,
    "continuous": _other_levels,
}
"""What an action is in the mirror: left for right."""
