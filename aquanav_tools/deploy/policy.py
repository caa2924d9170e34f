"""A policy of aquanav-train's on a vehicle: what its sensors read becomes the observation, its choice a command.

Where observations and actions are laid out is said once, in `sim.scales` and `sim.command`; tests hold what is computed
here to what the environment shows. The file is run as it is: take policies of strangers through aquanav-eval first.
"""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import InputError
from aquanav_tools.policy.observed import OBSERVED, Observed, read_observed
from aquanav_tools.sim.command import DIVING, IDLE, NUM_CHOICES, Command, command_of
from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.scales import DISTANCE_SCALE, PRESETS, RATE_SCALE, ROWS, SPEED_SCALE, soft
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.sim.vehicle import load_vehicle

MEASURED = ("paper", "full")
"""Presets that a vehicle can fill."""
DECISION_SECONDS = 0.1
"""Between two decisions, as policies are trained: five physics steps of 0.02 s."""
Values = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Readings:
    """What a vehicle's sensors read before a decision, in its body frame: x ahead, y left, z up."""

    rays: npt.ArrayLike
    """(28,) distance to the wall along each of `DeployedPolicy.ray_directions`, m; what meets none reads its length."""
    goal: npt.ArrayLike
    """(3,) of the goal: distance, m; azimuth off the level heading, left positive, rad; elevation, up positive, rad."""
    velocity: npt.ArrayLike | None = None
    """(3,) over ground, m/s: a Doppler log's."""
    rates: npt.ArrayLike | None = None
    """(3,) of turn, rad/s: a gyroscope's."""
    depth: float | None = None
    """Below the entrance, m: a pressure sensor's."""
    tilt: npt.ArrayLike | None = None
    """(2,) sines of the angles by which the nose and the left side point up."""
    sensors: Mapping[str, npt.ArrayLike] = field(default_factory=dict)
    """What further sensors read, by the names in `DeployedPolicy.sensors`, in the units of docs/sensors.md."""


class Demand(NamedTuple):
    """What a command asks the vehicle's own controller for, body frame."""

    surge: float
    """Force ahead, N."""
    heave: float
    """Force up, N."""
    yaw_rate: float
    """Rate of turn to the left, rad/s."""


class DeployedPolicy:
    """A network as aquanav-train exports it (policy.onnx), with what it remembers between decisions."""

    def __init__(self, path: str | Path, vehicle: str | Path = "bluerov2") -> None:
        """Read a policy, and the vehicle whose trim and forces its commands move.

        Args:
            path: Of the ONNX file.
            vehicle: Name of a shipped vehicle, or of a TOML file; one of the model "fossen".

        Raises:
            InputError: the file is no such policy, does not say what it observes, or observes what no vehicle measures;
                or there is no such vehicle.
        """
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4  # what it has to say comes as an exception too
        try:
            self._network = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except Exception as cause:  # of onnxruntime's own kinds, which share no base but this
            raise InputError(f"{path} cannot be read as an ONNX file: {cause}. Give a policy.onnx.") from cause
        self._inputs = {value.name: value.shape[1] for value in self._network.get_inputs()}
        self._output = self._network.get_outputs()[0]
        found = _observed(self._network, self._inputs.get("obs_0", 0), Path(path))
        loaded = load_vehicle(vehicle)
        if not isinstance(loaded, FossenVehicle):
            raise InputError(f"The vehicle {vehicle} is of the original's model, which no real vehicle has.")
        self._actuators = loaded.actuators
        self._preset, self.sensors = found.observation, found.sensors
        self._ages = (0, *found.history)
        pattern = original_pattern()
        self.ray_directions, self.ray_lengths = pattern.directions, pattern.lengths
        """(28, 3) unit vectors in the body frame, and (28,) lengths, m, of the rays that `Readings.rays` holds."""
        self.reset()

    def reset(self) -> None:
        """Begin a dive: neutral trim, no command yet, nothing remembered."""
        self.trim, self.command = 0.0, IDLE
        self._past: deque[Values] = deque(maxlen=1 + max(self._ages))

    def act(self, readings: Readings) -> Command:
        """Return the command for the next 0.1 s: ballast, steer and thrust, each in [-1, 1].

        Raises:
            InputError: a reading is missing, has another shape, or is not finite.
        """
        command = self.choose(self.observe(readings))
        self.take(command)
        return command

    def choose(self, seen: Values) -> Command:
        """Return the command that the network chooses for what `observe` returned."""
        inputs = {name: np.ones((1, size), dtype=np.float32) for name, size in self._inputs.items()}
        inputs["obs_0"] = seen[None]
        (chosen,) = self._network.run([self._output.name], inputs)
        return self._command(np.asarray(chosen).reshape(-1))

    def take(self, command: Command) -> None:
        """Remember what the vehicle is told for the next 0.1 s: the policy's command, or a pilot's in its place."""
        self.command = command
        step = self._actuators.trim_rate * DECISION_SECONDS * command.ballast
        self.trim = min(max(self.trim + step, -1.0), 1.0)

    def observe(self, readings: Readings) -> Values:
        """Return what the network gets for readings, as the environment shows it: (D,); they count as the latest.

        Raises:
            InputError: as `act`.
        """
        rows = [self._row(name, readings) for name in PRESETS[self._preset]]
        rows += [_flat(name, readings.sensors.get(name)) for name in self.sensors]
        latest = np.concatenate(rows).astype(np.float32)
        if not self._past:
            self._past.extend([latest] * (self._past.maxlen or 1))
        else:
            self._past.append(latest)
        seen = np.concatenate([self._past[-1 - age] for age in self._ages])
        if len(seen) != self._inputs["obs_0"]:
            raise InputError(
                f"The readings come to {len(seen)} values, and the policy takes {self._inputs['obs_0']}. "
                f"Sensors that it observes: {', '.join(self.sensors) or 'none'}."
            )
        return seen

    def demand(self) -> Demand:
        """Return what the last command asks the vehicle's controller for, with the trim as it is now."""
        actuators, thrust = self._actuators, self.command.thrust
        surge = actuators.surge_force * thrust * (actuators.reverse_fraction if thrust < 0.0 else 1.0)
        return Demand(surge, actuators.heave_force * self.trim, actuators.yaw_rate * self.command.steer)

    def _row(self, name: str, readings: Readings) -> npt.NDArray[Any]:
        if name == "trim":
            return np.array([self.trim])
        if name == "command":
            return np.array(self.command)
        value = _flat(name, getattr(readings, name), ROWS[name])
        if name == "rays":
            return np.clip(value / self.ray_lengths, 0.0, 1.0)
        if name == "goal":
            distance, azimuth, elevation = value
            azimuth -= 2.0 * math.pi * round(azimuth / (2.0 * math.pi))
            return np.array([soft(distance, DISTANCE_SCALE), azimuth / math.pi, elevation / (0.5 * math.pi)])
        scales = {"velocity": SPEED_SCALE, "rates": RATE_SCALE, "depth": DISTANCE_SCALE}
        return soft(value, scales[name]) if name in scales else value

    def _command(self, chosen: npt.NDArray[Any]) -> Command:
        if chosen.dtype.kind == "f":
            return Command(*np.clip(chosen, -1.0, 1.0).tolist())
        choices = chosen.tolist()
        if len(choices) == 1:  # one number stands for all three
            choices = list(np.unravel_index(choices[0], (NUM_CHOICES,) * len(DIVING)))
        return command_of(DIVING, [int(choice) for choice in choices])


def _observed(network: Any, size: int, path: Path) -> Observed:
    """Return what the file says that its policy observes; where it says nothing, the preset of so many values."""
    properties = network.get_modelmeta().custom_metadata_map
    try:
        settings = {name: json.loads(text) for name, text in properties.items() if name == OBSERVED}
    except json.JSONDecodeError as cause:
        raise InputError(f"{path} says in another form than aquanav's what it observes: {cause}.") from cause
    sizes = {sum(ROWS[name] for name in PRESETS[preset]): preset for preset in MEASURED}
    found = read_observed(settings, path) or (Observed(sizes[size]) if size in sizes else None)
    if found is None:
        raise InputError(f"{path} does not say what it observes. Take the policy.onnx of a run of aquanav-train.")
    if found.observation not in MEASURED:
        raise InputError(
            f"{path} observes '{found.observation}', which no vehicle measures. Train with --observation full or paper."
        )
    return found


def _flat(name: str, value: Any, size: int | None = None) -> npt.NDArray[Any]:
    """Return a reading as a row of numbers."""
    if value is None:
        raise InputError(f"The policy observes '{name}', and the readings have none. Fill it in at every decision.")
    row = np.asarray(value, dtype=np.float64).reshape(-1)
    if (size is not None and len(row) != size) or not np.isfinite(row).all():
        raise InputError(f"'{name}' must be {size or 'some'} finite numbers, got {np.array2string(row, threshold=6)}.")
    return row
