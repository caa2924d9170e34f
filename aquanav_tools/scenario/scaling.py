"""A cave made larger or smaller as a whole, in memory: to the vehicle it is another cave, with other squeezes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.centreline.graph import NO_NETWORK
from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.cave.route.starts import Start
from aquanav_tools.cave.water.flow import Flow
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Mesh


def scaled(scenario: Scenario, factor: float) -> Scenario:
    """Return a cave whose lengths are multiplied by a factor, about the world's origin.

    The water's speed through the narrowest section stays what a preset says, and so do the goal's tolerance and all
    that belongs to the vehicle; starts are those of before, whether it fits there now or not. The graph of passages is
    left out.
    """
    field, settings, goal = scenario.field, scenario.settings, scenario.settings.goal
    x, y, z = goal.position
    return replace(
        scenario,
        settings=replace(
            settings,
            goal=replace(goal, position=(factor * x, factor * y, factor * z)),
            collision_error=factor * settings.collision_error,
        ),
        cavity=_scaled_cavity(scenario.cavity, factor),
        collision=_scaled_mesh(scenario.collision, factor),
        field=replace(
            field,
            origin=factor * field.origin,
            spacing=factor * field.spacing,
            samples=field.samples * np.float32(factor),
        ),
        guide=_scaled_guide(scenario.guide, factor),
        starts=tuple(_scaled_start(start, factor) for start in scenario.starts),
        flow=None if scenario.flow is None else _scaled_flow(scenario.flow, factor),
        network=NO_NETWORK,
        content_hash="",
        folder=None,
    )


def _scaled_mesh(mesh: Mesh, factor: float) -> Mesh:
    return replace(mesh, vertices=factor * mesh.vertices)


def _scaled_cavity(cavity: Cavity, factor: float) -> Cavity:
    portals = tuple(
        replace(portal, centre=factor * portal.centre, area=factor**2 * portal.area) for portal in cavity.portals
    )
    return replace(cavity, mesh=_scaled_mesh(cavity.mesh, factor), portals=portals)


def _scaled_guide(guide: Guide, factor: float) -> Guide:
    panels = tuple(
        replace(
            panel,
            centre=factor * panel.centre,
            polygon=factor * panel.polygon,
            arc_length=factor * panel.arc_length,
            clearance=factor * panel.clearance,
        )
        for panel in guide.panels
    )
    return replace(guide, centreline=factor * guide.centreline, panels=panels)


def _scaled_start(start: Start, factor: float) -> Start:
    return replace(
        start,
        pose=replace(start.pose, position=factor * start.pose.position),
        clearance=factor * start.clearance,
        geodesic_to_goal=factor * start.geodesic_to_goal,
    )


def _scaled_flow(flow: Flow, factor: float) -> Flow:
    narrowest = flow.narrowest * np.array([factor**2, factor, factor, factor])
    return replace(flow, origin=factor * flow.origin, spacing=factor * flow.spacing, narrowest=narrowest)
