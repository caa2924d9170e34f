"""Policies on vehicles: readings of sensors in, commands out, with NumPy and onnxruntime alone."""

from aquanav_tools.deploy.policy import Demand, DeployedPolicy, Readings
from aquanav_tools.deploy.track import Track

__all__ = ["Demand", "DeployedPolicy", "Readings", "Track"]
