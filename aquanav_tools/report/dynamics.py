"""What an episode drew of its vehicle's dynamics, in words: for recordings and reports."""

from __future__ import annotations

from collections.abc import Mapping

FACTOR = "times what the vehicle's file says"
UNITS = {
    "net_buoyancy": "of the ballast's full force",
    "centre_of_mass_x": "m ahead",
    "centre_of_mass_y": "m to the left",
    "centre_of_mass_z": "m up",
    "payload": "kg",
    "weak_thruster": "number of the weak thruster, 0 for none",
    "weak_thruster_gain": "of the weak thruster's force is left",
    "ray_gain": "times the distance",
    "ray_bias": "m",
    "action_delay": "decisions",
    "observation_delay": "decisions",
}
"""Of the names in `sim.randomisation` that are no factors of what the vehicle's file says."""


def unit_of(name: str) -> str:
    """Return the unit of what is drawn under a name."""
    return UNITS.get(name, FACTOR)


def label_of(name: str) -> str:
    """Return a name for readers."""
    return name.replace("_", " ")


def dynamics_document(dynamics: Mapping[str, float]) -> str:
    """Return what an episode drew, as a table in Markdown; `dynamics` are numbers by name."""
    rows = [f"| {label_of(name)} | {value:.3g} | {unit_of(name)} |" for name, value in dynamics.items()]
    return "\n".join(["This episode drew:", "", "| | | |", "|---|---:|---|", *rows])
