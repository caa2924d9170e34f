"""Settings of the cave's stages, apart from the code so that a command's --help need not load it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True)
class ScanOptions:
    """How to read a scan's coordinates."""

    unit: Literal["m", "dm", "cm", "mm", "km", "ft", "in"] | None = None
    """Length unit of the file. When not given, what the file or its format says (E57, PTX, DAE, USD, 3MF), else metres.
    Sizes that no cave has are refused, with the unit that fits."""
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    """Axis of the file that points up. When not given, what the file says (DAE, USD), else z."""


@dataclass(frozen=True)
class ClosingOptions:
    """How to turn an open surface into a closed cavity."""

    voxel: float | None = None
    """Size of the cells a damaged scan is resampled with, m; chosen from the scan and the vehicle when not given."""
    memory: float = 4.0
    """Memory that closing may take, GB; the voxel is enlarged until it does."""
    min_portal: float | None = None
    """Openings at least this wide (m) can be portals, smaller ones are holes; twice the vehicle's width by default:
    through a narrower one it could not leave the cave."""
    inside: tuple[tuple[float, float, float], ...] = ()
    """Points X Y Z (m, as in the report) that are water: picks one of two caves, keeps a passage open."""
    cut: tuple[tuple[float, float, float, float, float, float], ...] = ()
    """Planes X Y Z NX NY NZ that end the cave in a portal: through a point in the water, with the direction that is cut
    away."""
    cut_at: tuple[float, ...] = ()
    """Places where the cave ends in a portal, in metres along the route of an earlier build of the same input; the
    shorter part of that route is cut away. The earlier build is the one in the output folder (then with --overwrite),
    or in the folder of --route-of."""
    route_of: Path | None = None
    """Scenario folder whose route the metres of --cut-at count along."""
    accept_open: bool = False
    """Go on where so little of the wall was seen, or its points scatter so much, that it may be no cave. The cavity is
    closed around the water that was seen; wall that nobody saw is invented, and marked so (`observed`)."""

    def __post_init__(self) -> None:
        for name in ("voxel", "min_portal", "memory"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise ValueError(f"{name} = {value} must be positive.")
        for plane in self.cut:
            if not any(plane[3:]):
                raise ValueError(f"cut = {plane} has no direction: its last three numbers are all 0.")


@dataclass(frozen=True)
class RouteOptions:
    """Which way through the cave."""

    entrance: str = ""
    """Where the route begins: the label of a portal in the report, or a point "X,Y,Z". Farthest apart by default."""
    goal: str = ""
    """Where it ends, likewise."""
    routes: Literal["longest", "all"] = "longest"
    """Of a cave with more than two open ends: "all" writes a scenario for each further pair of them as well, into the
    folder "routes" of the output."""


@dataclass(frozen=True)
class PanelOptions:
    """Where panels stand."""

    spacing: float = 2.0
    """Distance between panels where the passage is wide and straight, m; they stand no farther apart anywhere."""
    min_spacing: float = 0.4
    """Distance between panels in narrow places and bends, m; closer only where one would not see the next."""
    tangent_length: float = 1.0
    """Length of route over which a panel's direction is averaged, m."""
    margin: float = 0.1
    """Room beside the vehicle on straight ways from panel to panel, where the passage leaves it, m."""

    def __post_init__(self) -> None:
        if not 0.0 < self.min_spacing <= self.spacing:
            raise ValueError(f"min_spacing = {self.min_spacing} must be in (0, spacing = {self.spacing}].")
        if not self.tangent_length > 0.0 or not self.margin >= 0.0:
            raise ValueError(f"tangent_length = {self.tangent_length} or margin = {self.margin} is out of range.")


@dataclass(frozen=True)
class StartOptions:
    """Which start poses to draw."""

    count: int = 40
    """Number of start poses."""
    last_share: float = 1.0
    """Starts lie in all the water that the vehicle can reach; or, below 1, in this share of the longest way to the goal
    alone, at its far end. A task can choose among them: --start-range."""
    min_goal_distance: float = 2.0
    """No start is nearer to the goal than this, along the shortest way, m."""
    margin: float = 0.1
    """Distance that the vehicle keeps from the wall at the start, m."""
    max_yaw_error_deg: float = 30.0
    """Starts look along the shortest way to the goal within this angle."""

    def __post_init__(self) -> None:
        if self.count < 1:
            raise ValueError(f"count = {self.count} must be at least 1.")
        if not 0.0 < self.last_share <= 1.0:
            raise ValueError(f"last_share = {self.last_share} is outside (0, 1].")
        if not self.margin >= 0.0 or not 0.0 <= self.max_yaw_error_deg <= 180.0:
            raise ValueError(f"margin = {self.margin} or max_yaw_error_deg = {self.max_yaw_error_deg} is out of range.")
        if not self.min_goal_distance >= 0.0:
            raise ValueError(f"min_goal_distance = {self.min_goal_distance} must not be negative.")


@dataclass(frozen=True)
class WaterOptions:
    """The water in the cave, and which way it flows."""

    current: Literal["still", "half", "full", "flood"] = "still"
    """Current of the scenario; training and evaluation can choose another."""
    inlets: tuple[int, ...] = ()
    """Portals, by their labels in the report, where water enters; the one nearest to the goal by default."""
    outlets: tuple[int, ...] = ()
    """Portals where it leaves; all others by default. Portals in neither list are closed to the flow."""
    temperature: float | None = None
    """Degrees Celsius; with salinity it gives the water's density, which is 1000 kg/m^3 when neither is given."""
    salinity: float | None = None
    """Salt, g/kg: 0 in fresh water, 35 in the sea."""

    def __post_init__(self) -> None:
        if self.temperature is not None and not 0.0 <= self.temperature <= 100.0:
            raise ValueError(f"temperature = {self.temperature} must be 0 to 100 degrees Celsius.")
        if self.salinity is not None and not 0.0 <= self.salinity <= 150.0:
            raise ValueError(f"salinity = {self.salinity} must be 0 to 150 g/kg.")
