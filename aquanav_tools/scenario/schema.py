"""What a scenario consists of. `scenario.toml` holds `ScenarioSettings`; the other files hold the geometry."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.centreline.graph import NO_NETWORK, CentrelineGraph
from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.cave.route.starts import Start
from aquanav_tools.cave.water.field import DistanceField
from aquanav_tools.types import Mesh

FORMAT = 1


@dataclass(frozen=True)
class BuiltBy:
    """What made the scenario."""

    aquanav: str
    """Version of aquanav."""
    kind: str
    """Way it was built: photos, scan or synthetic."""


@dataclass(frozen=True)
class WaterSettings:
    """The water in the cave."""

    density: float = 1000.0
    """kg/m^3."""
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Uniform current, world frame, m/s."""

    def __post_init__(self) -> None:
        _check_range("water.density", self.density, 900.0, 1300.0)
        for axis, speed in zip("xyz", self.current, strict=True):
            _check_range(f"water.current {axis}", speed, -10.0, 10.0)


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
    decisions: int = 2400
    """Episode limit, in decisions."""

    def __post_init__(self) -> None:
        _check_range("limits.dt", self.dt, 1e-4, 0.1)
        _check_range("limits.substeps", self.substeps, 1, 1000)
        _check_range("limits.decisions", self.decisions, 1, 1_000_000)


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
    network: CentrelineGraph = NO_NETWORK
    """All passages of the cave; empty when nobody looked for them."""
    content_hash: str = ""
    """SHA-256 over the hashes of all its files; empty before it is written."""
    folder: Path | None = None
    """Where it was read from."""

    @property
    def name(self) -> str:
        """How reports call it."""
        return self.settings.name


def _check_range(name: str, value: float, low: float, high: float) -> None:
    if not (math.isfinite(value) and low <= value <= high):
        raise ValueError(f"{name} = {value} is outside [{low:g}, {high:g}].")
