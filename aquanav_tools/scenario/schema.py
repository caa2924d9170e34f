"""What a scenario consists of. `scenario.toml` holds `ScenarioSettings`; the other files hold the geometry."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.centreline.graph import NO_NETWORK, CentrelineGraph
from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.cave.route.starts import Start
from aquanav_tools.cave.water.flow import Flow
from aquanav_tools.errors import did_you_mean
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.scenario.limits import MAX_DECISIONS, ORIGINAL_DECISIONS
from aquanav_tools.types import Mesh

FORMAT = 1


@dataclass(frozen=True)
class BuiltBy:
    """What made the scenario."""

    aquanav: str
    """Version of aquanav."""
    kind: str
    """Way it was built: photos, scan, survey or synthetic."""


Current = str | float | tuple[float, float, float]
"""A preset's name, a strength, m/s, or one velocity everywhere, world frame, m/s."""

PRESETS: dict[str, float] = {"still": 0.0, "half": 0.25, "full": 0.5, "flood": 0.8}
"""Mean speed of the water through the narrowest section, m/s, by the slowest vehicle that ships, bluerov2: it makes
0.99 m/s ahead, 0.67 in reverse and 0.5 up. In `full` it keeps half of its speed against the flow, and can still hold
its place in reverse. `half` is half of that, as in the paper. In `flood` it must turn into the flow to hold its place,
and makes 0.2 m/s there. The original benchmark's vehicle is twice as fast."""
MAX_SPEED = 10.0
"""Fastest current, m/s."""


@dataclass(frozen=True)
class WaveSettings:
    """Waves on a free surface, all of one length and direction; none when their height is 0."""

    height: float = 0.0
    """From trough to crest, m."""
    period: float = 4.0
    """s."""
    direction_deg: float = 0.0
    """Where they run to, degrees from world x towards y."""
    depth: float = math.inf
    """Of the water below the surface at rest, m."""

    def __post_init__(self) -> None:
        _check_range("water.waves.height", self.height, 0.0, 20.0)
        _check_range("water.waves.period", self.period, 0.2, 60.0)
        _check_range("water.waves.direction_deg", self.direction_deg, -360.0, 360.0)
        if not self.depth > 0.0:
            raise ValueError(f"water.waves.depth = {self.depth} must be positive; leave it out for deep water.")
        if self.height > self.depth:
            raise ValueError(f"water.waves.height = {self.height} is more than their depth of {self.depth} m.")


@dataclass(frozen=True)
class WaterSettings:
    """The water in the cave."""

    density: float = 1000.0
    """kg/m^3."""
    temperature: float = 10.0
    """Degrees Celsius."""
    salinity: float = 0.0
    """Salt, g/kg."""
    current: Current = "still"
    """A preset (still, half, full, flood), the mean speed through the narrowest section (m/s, negative for the other
    way), or one velocity everywhere (world frame, m/s)."""
    turbulence: float = 0.15
    """Root mean square speed of the eddies over the strength of the current. A karst passage with a friction factor of
    about 0.1 (Darcy and Weisbach's; Jeannin 2001) has a friction velocity of sqrt(0.1 / 8) = 0.11 of the mean speed,
    and fluctuations somewhat above that."""
    seed: int = 0
    """Picks the eddies' pattern; how they come and go is drawn in each episode."""
    surface: float | None = None
    """Height z of a free surface, m; none in a flooded cave."""
    waves: WaveSettings = field(default_factory=WaveSettings)

    def __post_init__(self) -> None:
        _check_range("water.density", self.density, 900.0, 1300.0)
        _check_range("water.temperature", self.temperature, 0.0, 100.0)
        _check_range("water.salinity", self.salinity, 0.0, 150.0)
        check_current(self.current)
        _check_range("water.turbulence", self.turbulence, 0.0, 1.0)
        _check_range("water.seed", self.seed, 0, 2**63 - 1)
        if self.surface is not None:
            _check_range("water.surface", self.surface, -1e6, 1e6)
        elif self.waves.height > 0.0:
            raise ValueError("water.waves need a surface: give its height as water.surface.")


def check_current(current: Current) -> None:
    """Refuse a current that is no preset, or too fast.

    Raises:
        ValueError: with the closest preset, or the range.
    """
    if isinstance(current, str):
        if current not in PRESETS:
            raise ValueError(f"water.current = '{current}' is no preset.{did_you_mean(current, PRESETS)}")
        return
    if np.shape(current) not in ((), (3,)):
        raise ValueError(f"water.current = {current} is neither a preset nor 1 or 3 numbers.")
    for speed in np.ravel(current):
        _check_range("water.current", float(speed), -MAX_SPEED, MAX_SPEED)


@dataclass(frozen=True)
class GoalSettings:
    """Where the route ends."""

    position: tuple[float, float, float]
    """Centre of the last panel, world, m."""
    tolerance: float = 0.5
    """The goal is reached when no more than this is left to go along the guide, m."""

    def __post_init__(self) -> None:
        for axis, value in zip("xyz", self.position, strict=True):
            _check_range(f"goal.position {axis}", value, -1e6, 1e6)
        _check_range("goal.tolerance", self.tolerance, 0.0, 100.0)


@dataclass(frozen=True)
class LimitSettings:
    """Time in the scenario; the defaults are the original benchmark's."""

    dt: float = 0.02
    """Physics step, s."""
    substeps: int = 5
    """Physics steps per agent decision."""
    decisions: int = ORIGINAL_DECISIONS
    """Episode limit, in decisions. The original's 2400 is a least, which grows where the way is long for the vehicle
    (`sim.time_limit`); any other number is the limit."""

    def __post_init__(self) -> None:
        _check_range("limits.dt", self.dt, 1e-4, 0.1)
        _check_range("limits.substeps", self.substeps, 1, 1000)
        _check_range("limits.decisions", self.decisions, 1, MAX_DECISIONS)


@dataclass(frozen=True)
class ScenarioSettings:
    """The table of scenario.toml."""

    name: str
    """How reports call it."""
    built: BuiltBy
    goal: GoalSettings
    vehicle: str = "bluerov2"
    """Name of the vehicle the starts were checked for."""
    water: WaterSettings = field(default_factory=WaterSettings)
    limits: LimitSettings = field(default_factory=LimitSettings)
    collision_error: float = 0.0
    """Bound on the distance between the collision mesh and the cavity, m."""

    def __post_init__(self) -> None:
        # A scenario is untrusted: its vehicle is a name, never a path.
        if not re.fullmatch(r"[A-Za-z0-9_-]+", self.vehicle):
            raise ValueError(f"vehicle = '{self.vehicle}' is no name of letters, digits, '-' and '_'.")


@dataclass(frozen=True)
class OtherVehicle:
    """A vehicle that takes the place of a scenario's own."""

    name: str
    path: str
    """Name or file, as it was given."""
    sha256: str
    """Of its file."""
    left_out: tuple[int, ...] = ()
    """Numbers of the scenario's starts that are not among its starts now, since the hull does not fit there."""


@dataclass(frozen=True, eq=False)
class Scenario:
    """A cave ready to dive in."""

    settings: ScenarioSettings
    cavity: Cavity
    collision: Mesh
    """Simplified cavity for contacts."""
    field: DistanceField
    guide: Guide
    starts: tuple[Start, ...]
    vehicle_toml: str = ""
    """The vehicle's file, so that the folder is enough by itself; empty when it names a shipped vehicle only."""
    flow: Flow | None = None
    """The current from portal to portal; None when nobody looked for it, or there is none."""
    network: CentrelineGraph = NO_NETWORK
    """All passages of the cave; empty when nobody looked for them."""
    content_hash: str = ""
    """SHA-256 over the hashes of all its files; empty before it is written."""
    other_vehicle: OtherVehicle | None = None
    """Whose hull, starts and ways these are where that is not the vehicle in the files."""
    folder: Path | None = None
    """Where it was read from."""

    @property
    def name(self) -> str:
        """How reports call it."""
        return self.settings.name


def _check_range(name: str, value: float, low: float, high: float) -> None:
    if not (math.isfinite(value) and low <= value <= high):
        raise ValueError(f"{name} = {value} is outside [{low:g}, {high:g}].")
