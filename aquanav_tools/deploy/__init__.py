"""Policies on vehicles: readings of sensors in, commands out, with NumPy and onnxruntime alone; maps take numba."""

from typing import TYPE_CHECKING

from aquanav_tools.deploy.policy import Demand, DeployedPolicy, Readings
from aquanav_tools.deploy.track import Track
from aquanav_tools.lazy import offer_functions

if TYPE_CHECKING:
    from aquanav_tools.deploy.waypoint import Waypoint

offer_functions(__name__, {"Waypoint": "aquanav_tools.deploy.waypoint"})
__all__ = ["Demand", "DeployedPolicy", "Readings", "Track", "Waypoint"]
