"""The stage that gives a cave its currents, and what the report says of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from aquanav_tools.build.journal import Journal
from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.options import WaterOptions
from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.cave.water.flow import Flow, find_flow
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.report.cave_map import CaveMap
from aquanav_tools.report.flow_map import draw_flow
from aquanav_tools.report.html import Figure, Section, Table
from aquanav_tools.scenario.schema import PRESETS, Scenario, WaterSettings
from aquanav_tools.sim.water_properties import water_density, water_viscosity

DEFAULTS = WaterSettings()


def find_currents(
    cavity: Cavity, field: DistanceField, guide: Guide, options: WaterOptions, journal: Journal
) -> Flow | None:
    """Return the flow through the cave; None, with a warning, where none is found."""
    with journal.stage("Finding the currents"):
        narrowest = min(panel.clearance for panel in guide.panels)
        flow = find_flow(cavity, field, guide.centres, narrowest, options.inlets, options.outlets)
    if flow is None:
        journal.warn(
            "no-flow",
            "No flow was found through the cave: cells small enough for the narrowest way would be too many. The "
            "scenario has no currents; cut the cave, or build its parts.",
        )
    elif len(cavity.portals) < 2:
        number = "one portal" if cavity.portals else "no portal"
        journal.warn("springs", f"The cave has {number}, and a flow needs two ends. With a current, {_ways(flow)}.")
    return flow


def water_settings(options: WaterOptions) -> WaterSettings:
    """Return the scenario's water; its density follows from temperature and salinity where either is given."""
    if options.temperature is None and options.salinity is None:
        return WaterSettings(current=options.current)
    temperature = DEFAULTS.temperature if options.temperature is None else options.temperature
    salinity = DEFAULTS.salinity if options.salinity is None else options.salinity
    density = round(water_density(temperature, salinity), 3)
    return WaterSettings(density=density, temperature=temperature, salinity=salinity, current=options.current)


def current_facts(scenario: Scenario) -> dict[str, Any]:
    """Return what is known of the currents, as plain values, for report.json."""
    water, flow = scenario.settings.water, scenario.flow
    viscosity = water_viscosity(water.temperature, water.salinity) / water.density
    facts: dict[str, Any] = {"density": water.density, "kinematic_viscosity": viscosity, "has_flow": flow is not None}
    if flow is None:
        return facts
    return {
        **facts,
        "spacing": flow.spacing,
        "narrowest_area": float(flow.narrowest[0]),
        "narrowest_position": flow.narrowest[1:].tolist(),
        "shares": {str(label): share for label, share in flow.shares},
        "flux": {name: speed * float(flow.narrowest[0]) for name, speed in PRESETS.items()},
        "reynolds": {name: speed * _width(flow) / viscosity for name, speed in PRESETS.items()},
    }


def current_section(scenario: Scenario, cave: CaveMap, folder: Path) -> Section:
    """Return what the report says of the currents, drawn into a folder."""
    flow, facts = scenario.flow, current_facts(scenario)
    if flow is None:
        return Section("Currents", "No flow through this cave was found. It has no currents.", (), ())
    path = folder / "currents.svg"
    draw_flow(cave, flow, scenario.field, path)
    text = (
        f"With a current, {_ways(flow)}. The smallest cross-section has {flow.narrowest[0]:.2f} m²; presets give the "
        "speed there. That is a place by area; the narrowest place for a vehicle is one by width."
    )
    rows = tuple(
        (name, f"{speed:g}", f"{facts['flux'][name]:.3f}", f"{facts['reynolds'][name]:.2g}")
        for name, speed in PRESETS.items()
    )
    table = Table(
        "Presets", ("current", "speed in the smallest cross-section (m/s)", "flow (m³/s)", "Reynolds number"), rows
    )
    caption = "The current at `full`, averaged from floor to ceiling; longer and darker arrows are faster water."
    return Section("Currents", text, (Figure(path, caption),), (table,))


def _ways(flow: Flow) -> str:
    """Return where water enters and leaves, as a clause."""
    if not flow.shares:
        return "water wells up at the goal and drains where the way starts"
    if len(flow.shares) == 1:
        (label, share), *_ = flow.shares
        if share > 0.0:
            return f"water enters through portal {label} and drains at the way's other end"
        return f"water wells up at the way's other end and leaves through portal {label}"
    ways = [f"{abs(share):.0%} {'enters' if share > 0.0 else 'leaves'} through portal {n}" for n, share in flow.shares]
    return f"of the water {', '.join(ways)}"


def _width(flow: Flow) -> float:
    """Return the diameter of a disc with the area of the narrowest section, m."""
    return float(2.0 * (flow.narrowest[0] / 3.141592653589793) ** 0.5)
