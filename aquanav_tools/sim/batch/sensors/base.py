"""What a sensor is, what it measures from, and how the built-in ones are computed."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import warp as wp
from gymnasium import spaces

from aquanav_tools.machine import num_cores
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.caves import Cave
from aquanav_tools.sim.batch.random import RAYS
from aquanav_tools.sim.batch.runtime import launch_kernel
from aquanav_tools.sim.batch.sensors.noise import draw_normals
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.batch.table import StructTable
from aquanav_tools.sim.vehicle_base import Vehicle

Reading = npt.NDArray[np.float32]
MirrorImage = tuple[npt.NDArray[np.int64], npt.NDArray[np.float32]]
"""For each value of a reading, from which value it comes in a mirror that swaps left and right, and with which sign."""


class Sensor(Protocol):
    """Anything that measures; one definition serves one vehicle and thousands."""

    def spec(self, scenario: Scenario, vehicle: Vehicle) -> spaces.Space[Any]:
        """Return the space of one vehicle's reading."""

    def measure(self, batch: SensorBatch) -> npt.NDArray[Any]:
        """Return the readings of all vehicles, (N, ...): a row is in the space.

        A reading is a function of the batch's arrays and of what `batch.normals` draws, and of readings earlier in the
        same episode at most: measuring twice at one decision gives the same twice.
        """


class SensorBatch:
    """N vehicles and the caves around them: what sensors measure from."""

    def __init__(
        self,
        state: BatchState,
        caves: Sequence[Cave] | StructTable,
        decision_seconds: float,
        device: Any,
        num_threads: int | None = None,
    ) -> None:
        """Take arrays on a device as they are; they change between measurements.

        Args:
            state: The vehicles'.
            caves: Around them, by `state.cave_of`; in a table they may change.
            decision_seconds: Duration of a decision, s.
            device: Warp's.
            num_threads: On the processor; None takes as many as the process may use.
        """
        self.state, self.num, self.device = state, len(state.order), device
        self._table = caves if isinstance(caves, StructTable) else StructTable(Cave, caves, device)
        self.caves = self._table.array
        self.decision_seconds = decision_seconds
        self.only_restarted = False
        """Whether only the rows of vehicles are needed whose episodes have just begun; others may stay as they are."""
        self.stream = RAYS
        """The purpose from which the sensor that measures next counts what it draws."""
        available = num_cores() if num_threads is None else num_threads
        self.num_threads = available if device.is_cpu else 1
        self._threads = ThreadPoolExecutor(self.num_threads) if self.num_threads > 1 else None

    def view_of(self, name: str) -> Any:
        """Return an array of `BatchState`, (N, ...), as NumPy's; later steps change it."""
        return getattr(self.state, name).numpy()

    def normals(self, count: int) -> Reading:
        """Return (N, count) standard normal numbers that depend on seed, sensor and decision alone."""
        out = wp.zeros((self.num, count), dtype=wp.float32, device=self.device)
        inputs = [self.state.seeds, self.state.decisions, self.stream, out]
        launch_kernel(draw_normals, dim=(self.num, (count + 3) // 4), inputs=inputs, device=self.device)
        drawn: Reading = out.numpy()
        return drawn

    def run(self, launches: Sequence[Any]) -> None:
        """Launch recorded kernels, each in a thread of its own: Warp lets go of Python's lock meanwhile."""
        if self._threads is None or len(launches) == 1:
            for launch in launches:
                launch.launch()
        else:
            list(self._threads.map(_launch, launches))

    def close(self) -> None:
        """End the threads. Closing twice does nothing."""
        if self._threads is not None:
            self._threads.shutdown()


def _launch(launch: Any) -> None:
    launch.launch()


class KernelSensor:
    """A sensor computed by one kernel, whose first arguments are those of `_inputs` and whose last is the output."""

    def __init__(self, kernel: Any, min_slice: int) -> None:
        """Prepare.

        Args:
            kernel: Takes (first, only_restarted, stream, state, caves, ...own inputs, out); indices count from `first`.
            min_slice: Indices for which a further thread is worth its start.
        """
        self._kernel, self._min_slice = kernel, min_slice
        self._batch: SensorBatch | None = None
        self._launches: list[Any] = []
        self._passed: tuple[int, int] = (0, 0)
        self._out: Any = None
        self._restored: dict[str, npt.NDArray[Any]] | None = None
        """What is to be remembered as soon as there is room for it."""

    def measure(self, batch: SensorBatch) -> Reading:
        """Return the readings of all vehicles, (N, ...), in memory that the next measurement changes."""
        if self._batch is not batch:
            self._prepare(batch)
        passed = (int(batch.only_restarted), batch.stream)
        if passed != self._passed:
            self._passed = passed
            for launch in self._launches:
                launch.set_param_by_name("only_restarted", passed[0])
                launch.set_param_by_name("stream", passed[1])
        batch.run(self._launches)
        readings: Reading = self._out.numpy()
        return readings

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of what the sensor remembers of earlier decisions: nothing, where it remembers nothing."""
        return {name: np.array(array.numpy()) for name, array in self._memory().items()}

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Take back what `state` returned, also before the first measurement."""
        self._restored = state
        if self._batch is not None:
            self._remember()

    def _remember(self) -> None:
        if self._restored is not None:
            for name, array in self._memory().items():
                array.assign(self._restored[name])
        self._restored = None

    def _memory(self) -> dict[str, Any]:
        """Return the arrays in which the sensor remembers earlier decisions."""
        return {}

    def _prepare(self, batch: SensorBatch) -> None:
        """Make room for a batch's readings and record the launches, one for each thread."""
        count = batch.num * self._work_per_vehicle(batch)
        self._out = wp.zeros((batch.num, *self._shape()), dtype=wp.float32, device=batch.device)
        own = self._inputs(batch)
        bounds = np.linspace(0, count, max(1, min(batch.num_threads, count // self._min_slice)) + 1).astype(int)
        self._passed = (int(batch.only_restarted), batch.stream)
        self._launches = [
            launch_kernel(
                self._kernel,
                dim=last - first,
                inputs=[first, *self._passed, batch.state, batch.caves, *own, self._out],
                device=batch.device,
                record_cmd=True,
            )
            for first, last in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True)
        ]
        self._batch = batch
        self._remember()

    def _work_per_vehicle(self, batch: SensorBatch) -> int:
        """Return into how many indices of the kernel a vehicle is divided."""
        return 1

    def _shape(self) -> tuple[int, ...]:
        """Return the shape of a reading."""
        raise NotImplementedError

    def _inputs(self, batch: SensorBatch) -> list[Any]:
        """Return the kernel's own inputs."""
        raise NotImplementedError
