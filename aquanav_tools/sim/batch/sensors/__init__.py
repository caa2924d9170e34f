"""Sensors as objects: each has a space, and measures for all vehicles of a batch at once."""

from __future__ import annotations

_HERE = "aquanav_tools.sim.batch.sensors"
BUILT_IN = {
    "fan": f"{_HERE}.fan:RangeFan",
    "echosounders": f"{_HERE}.fan:EchoSounders",
    "sonar3d": f"{_HERE}.fan:Sonar3D",
    "depth": f"{_HERE}.depth:DepthCell",
    "imu": f"{_HERE}.inertial:InertialUnit",
    "dvl": f"{_HERE}.dvl:DopplerLog",
    "waypoint": f"{_HERE}.waypoint:Waypoint",
    "route": f"{_HERE}.route:Route",
    "track": f"{_HERE}.track:Track",
    "sonar": f"{_HERE}.sonar:ImagingSonar",
}
"""The sensors that come with aquanav: name, and the class as `module:Name`."""
PRIVILEGED = ("route",)
"""Those of them that read what no vehicle can measure: for lessons, and for what would be if it could."""
