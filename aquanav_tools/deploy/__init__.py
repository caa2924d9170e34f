"""Policies on vehicles: readings of sensors in, commands out, with NumPy and onnxruntime alone."""

from aquanav_tools.deploy.policy import Demand, DeployedPolicy, Readings

__all__ = ["Demand", "DeployedPolicy", "Readings"]
