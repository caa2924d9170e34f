"""An observation of several parts, each under a name of its own: one of the presets, and sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.definitions import OwnCode, check_reading, common_box
from aquanav_tools.envs.extensions import Extensions, VehicleArrays
from aquanav_tools.errors import InputError
from aquanav_tools.registry import is_own
from aquanav_tools.sim.scales import PRESETS

if TYPE_CHECKING:
    from aquanav_tools.sim.batch.sensors.base import Sensor, SensorBatch

Arrays = dict[str, npt.NDArray[Any]]
Parts = Mapping[str, "str | Sensor"]
"""What is observed, by name: a preset ("paper", "full" or "original"), a sensor by its name ("fan", "depth", "imu",
"dvl" or "sonar"), a sensor of the user's own as module:Name, or a sensor."""


class DictObservation:
    """What N vehicles see, as a dictionary of arrays with a row for each of them."""

    def __init__(self, parts: Parts, delay: int) -> None:
        """Take the parts.

        Args:
            parts: At least one; of presets at most one, as a batch computes one of them.
            delay: Decisions by which sensors are late; the batch delays its preset itself.

        Raises:
            InputError: there are no parts, several presets, or no sensor of a name.
        """
        from aquanav_tools.sim.batch.sensors.base import KernelSensor
        from aquanav_tools.sim.batch.sensors.suite import SensorSuite

        presets = [name for name, part in parts.items() if isinstance(part, str) and part in PRESETS]
        if len(presets) > 1:
            raise InputError(
                f'An observation has at most one preset, and {" and ".join(presets)} are two. "full" holds "paper".'
            )
        self.preset = str(parts[presets[0]]) if presets else "paper"
        """What the batch computes: a part, or what is left unseen."""
        self._preset_name = presets[0] if presets else None
        sensors = {name: part for name, part in parts.items() if name not in presets}
        if not presets and not sensors:
            raise InputError("An observation must have at least one part: a preset or a sensor.")
        self._own = {
            name: OwnCode("sensor", str(part), "measure") if is_own(part) else OwnCode("sensor", name, "measure", part)
            for name, part in sensors.items()
            if is_own(part) or not isinstance(part, str | KernelSensor)
        }
        sensors = {name: part for name, part in sensors.items() if name not in self._own}
        self._suite = SensorSuite(sensors) if sensors else None
        self._delay = delay
        self.observations: Arrays = {}
        """(N, ...) by name: what is seen now."""
        self.final_observations: Arrays = {}
        """The same of episodes that ended in the last step and whose successors have begun in it."""
        self._waiting: Arrays = {}

    def prepare(
        self,
        vehicles: VehicleArrays,
        preset: spaces.Space[Any],
        pairs: Sequence[tuple[Any, Any]],
        make_sensors: Callable[[], SensorBatch] | None,
        extensions: Extensions,
    ) -> spaces.Dict:
        """Make room for the readings of a batch, and return the space of one vehicle's observation.

        Args:
            vehicles: Those of the batch.
            preset: Space of the preset.
            pairs: Each scenario of the batch, and the vehicle in it.
            make_sensors: Returns what aquanav's own sensors measure from; None where there are none.
            extensions: Has the view for sensors of the user's own, and is told where they fail.

        Raises:
            InputError: a sensor's space is not the same in all scenarios.
        """
        known: dict[str, spaces.Space[Any]] = {}
        self._vehicles, self._extensions, num = vehicles, extensions, extensions.view.num
        if self._preset_name is not None:
            known[self._preset_name] = preset
            self._refresh_preset()
        if self._suite is not None and make_sensors is not None:
            self._batch = make_sensors()
            known |= self._suite.common_spec(pairs).spaces
        known |= {name: common_box(own, pairs) for name, own in self._own.items()}
        for name in known.keys() - {self._preset_name}:
            shape, dtype = known[name].shape, known[name].dtype
            assert shape is not None, "a suite's spaces have shapes"
            self.observations[name] = np.zeros((num, *shape), dtype=dtype)
            self.final_observations[name] = np.zeros((num, *shape), dtype=dtype)
            self._waiting[name] = np.zeros((num, self._delay, *shape), dtype=dtype)
        return spaces.Dict(known)

    def begin(self) -> None:
        """Observe the beginnings of all episodes."""
        self._refresh_preset()
        self._look(np.arange(self._extensions.view.num), only_restarted=False)

    def judge(self) -> None:
        """Observe what a decision has led to, before ended episodes are followed by others."""
        self._refresh_preset()
        self._look(np.flatnonzero(self._vehicles.as_numpy("restarted")), only_restarted=False)

    def follow(self) -> None:
        """Keep what was seen last where a successor has begun in the same step, and observe its beginning."""
        self._refresh_preset()
        begun = np.flatnonzero(self._vehicles.as_numpy("restarted"))
        if len(begun):
            for name in self._waiting:
                self.final_observations[name][begun] = self.observations[name][begun]
            self._look(begun, only_restarted=True)

    def _look(self, begun: npt.NDArray[np.integer], only_restarted: bool) -> None:
        """Read the sensors; readings of rows that have begun are seen at once, others wait their turn."""
        for name, readings in self._measure(only_restarted).items():
            seen, waiting = self.observations[name], self._waiting[name]
            if only_restarted:
                seen[begun] = readings[begun]
            elif self._delay:
                rows = np.arange(len(seen))
                turns = self._vehicles.as_numpy("decisions") % self._delay
                seen[:] = waiting[rows, turns]
                waiting[rows, turns] = readings
                seen[begun] = readings[begun]
            else:
                seen[:] = readings
            if self._delay:
                waiting[begun] = readings[begun, None]

    def _measure(self, only_restarted: bool) -> Arrays:
        """Return (N, ...) of each sensor; zeros where one of the user's own fails."""
        readings: Arrays = {}
        if self._suite is not None:
            self._batch.only_restarted = only_restarted
            readings = self._suite.measure(self._batch)
        for name, own in self._own.items():
            space = self.observations[name]
            given = own.ask(self._extensions.view, partial(check_reading, like=space), self._extensions.failures)
            readings[name] = np.zeros_like(space) if given is None else given
        return readings

    def _refresh_preset(self) -> None:
        """Take the preset again: from a GPU the arrays are copies, on the processor always the same."""
        if self._preset_name is not None:
            self.observations[self._preset_name] = self._vehicles.as_numpy("observations")
            self.final_observations[self._preset_name] = self._vehicles.as_numpy("final_observations")

    def state(self) -> Arrays:
        """Return copies of all that future observations depend on."""
        kept = {f"waiting/{name}": values.copy() for name, values in self._waiting.items()}
        kept |= {f"seen/{name}": self.observations[name].copy() for name in self._waiting}
        return kept if self._suite is None else kept | self._suite.state()

    def restore(self, state: Arrays) -> None:
        """Take back what `state` returned."""
        for name, values in self._waiting.items():
            values[:] = state[f"waiting/{name}"]
            self.observations[name][:] = state[f"seen/{name}"]
        if self._suite is not None:
            self._suite.restore(state)

    def close(self) -> None:
        """End the threads. Closing twice does nothing."""
        if self._suite is not None:
            self._batch.close()


def parts_of(observation: str | Parts, delay: int) -> DictObservation | None:
    """Return a dictionary of parts that is asked for; None for a preset or an observation by its name."""
    return None if isinstance(observation, str) else DictObservation(observation, delay)
