"""Several sensors on one vehicle: a dictionary of readings."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.sensors import BUILT_IN
from aquanav_tools.sim.batch.sensors.base import KernelSensor, Sensor, SensorBatch
from aquanav_tools.sim.batch.sensors.noise import stream_of
from aquanav_tools.sim.vehicle_base import Vehicle

Readings = dict[str, npt.NDArray[Any]]


def make_sensor(kind: str, **options: Any) -> Sensor:
    """Return a sensor that comes with aquanav, by its name in BUILT_IN, with its class's arguments.

    Raises:
        InputError: there is none of that name (the message has the nearest), or it does not take the options.
    """
    if kind not in BUILT_IN:
        raise InputError(f"There is no sensor '{kind}'.{did_you_mean(kind, BUILT_IN)}")
    module, name = BUILT_IN[kind].split(":")
    try:
        sensor: Sensor = getattr(importlib.import_module(module), name)(**options)
    except TypeError as cause:
        raise InputError(f"The sensor '{kind}' cannot be made of {options}: {cause}.") from cause
    return sensor


class SensorSuite:
    """Named sensors, read together. Their names are the keys of the readings, and of what each of them draws."""

    def __init__(self, sensors: Mapping[str, str | Sensor]) -> None:
        """Take sensors; a text names one that comes with aquanav.

        Raises:
            InputError: there is no sensor, or none of such a name.
        """
        if not sensors:
            raise InputError("A suite of sensors must have at least one sensor.")
        self.sensors = {
            name: make_sensor(sensor) if isinstance(sensor, str) else sensor for name, sensor in sensors.items()
        }
        self._spaces: dict[str, spaces.Space[Any]] = {}

    def spec(self, scenario: Scenario, vehicle: Vehicle) -> spaces.Dict:
        """Return the space of one vehicle's readings.

        Raises:
            InputError: a sensor has another space than a box, or a discrete one.
        """
        self._spaces = {name: sensor.spec(scenario, vehicle) for name, sensor in self.sensors.items()}
        for name, space in self._spaces.items():
            if getattr(space, "shape", None) is None:
                raise InputError(f"The sensor '{name}' has {space!r} for a space. It must be a gymnasium.spaces.Box.")
        return spaces.Dict(self._spaces)

    def common_spec(self, pairs: Sequence[tuple[Scenario, Vehicle]]) -> spaces.Dict:
        """Return the space of one vehicle's readings, which must be the same in several scenarios.

        Raises:
            InputError: it is not; the message has the sensor and the scenarios.
        """
        first, *others = [self.spec(*pair) for pair in pairs]
        for (scenario, _), other in zip(pairs[1:], others, strict=True):
            for name in self.sensors:
                if other[name] != first[name]:
                    raise InputError(
                        f"The sensor '{name}' has the space {first[name]} in {pairs[0][0].name} and {other[name]} in "
                        f"{scenario.name}. In one batch it must be the same."
                    )
        return first

    def measure(self, batch: SensorBatch) -> Readings:
        """Return each sensor's readings, (N, ...), in memory of their own; `spec` comes first.

        Raises:
            InputError: readings of a user's sensor have another shape than its space, or are not finite.
        """
        readings: Readings = {}
        for name, sensor in self.sensors.items():
            batch.stream = stream_of(name)
            measured = sensor.measure(batch)
            readings[name] = (
                measured.copy() if isinstance(sensor, KernelSensor) else self._checked(name, measured, batch.num)
            )
        return readings

    def state(self) -> Readings:
        """Return copies of what sensors remember of earlier decisions."""
        return {
            f"sensor/{name}/{key}": values
            for name, sensor in self.sensors.items()
            if isinstance(sensor, KernelSensor)
            for key, values in sensor.state().items()
        }

    def restore(self, state: Readings) -> None:
        """Take back what `state` returned."""
        for name, sensor in self.sensors.items():
            lead = f"sensor/{name}/"
            if isinstance(sensor, KernelSensor):
                sensor.restore({key.removeprefix(lead): state[key] for key in state if key.startswith(lead)})

    def _checked(self, name: str, measured: Any, num: int) -> npt.NDArray[Any]:
        """Return the readings of a user's sensor as its space has them."""
        space = self._spaces[name]
        values = np.array(measured, dtype=space.dtype)
        if values.shape != (num, *(space.shape or ())):
            raise InputError(
                f"The sensor '{name}' measured an array of shape {values.shape}; {num} vehicles with its space take "
                f"{(num, *(space.shape or ()))}. Correct its `measure` or its `spec`."
            )
        if np.issubdtype(values.dtype, np.floating) and not np.isfinite(values).all():
            rows = np.flatnonzero(~np.isfinite(values.reshape(num, -1)).all(axis=1))
            raise InputError(
                f"The sensor '{name}' measured values that are not finite for {len(rows)} of {num} vehicles, the first "
                f"of them number {rows[0]}. Correct its `measure`."
            )
        return values
