"""What a build takes from a survey: a cave made of its legs and wall points, or a check of a scan against it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aquanav_tools.build.journal import Journal
from aquanav_tools.cave.closing.free_space import FreeSpace
from aquanav_tools.cave.scan.read import FAR_FROM_ORIGIN
from aquanav_tools.survey.drift import DriftReport, check_drift
from aquanav_tools.survey.model import Survey
from aquanav_tools.survey.passage_graph import passage_graph
from aquanav_tools.survey.solid import SurveyCave, survey_solid
from aquanav_tools.survey.walls import wall_points
from aquanav_tools.types import Array, Mesh, Sim3

MAX_SCALE_ERROR = 0.01
MAX_TILT_DEG = 2.0
MAX_DRIFT = 1.0
"""Beyond a hundredth of scale, two degrees of tilt or a metre of drift in a hundred, a scan deserves a second look."""


@dataclass(frozen=True, eq=False)
class SurveyWalls:
    """A survey as if it had been scanned."""

    surface: Mesh
    """Walls, open at the entrances, m."""
    free_space: FreeSpace
    """Its stations and legs."""
    measured: Array
    """(N, 3) points of the wall that were measured; the rest of it is a model, m."""
    offset: Array
    """(3,) what was subtracted to bring it to the origin, m."""
    facts: dict[str, Any]


def model_walls(survey: Survey, journal: Journal) -> SurveyWalls:
    """Return the cave that a survey describes.

    Raises:
        InputError: it has no legs under ground.
        MeshError: they do not make one closed solid.
    """
    cave = survey_solid(survey)
    for sentence in cave.warnings:
        journal.warn("survey", sentence)
    journal.warn("modelled-wall", _how_measured(cave))
    centre = np.round(cave.stations.mean(axis=0))
    offset = centre if np.abs(centre).max() > FAR_FROM_ORIGIN else np.zeros(3)
    surface = cave.open_surface
    facts = {
        "survey": survey.title,
        "survey_length": survey.length,
        "wall_points": cave.num_wall_points,
        "median_misfit": cave.median_misfit if cave.num_wall_points else None,
        "p95_misfit": cave.p95_misfit if cave.num_wall_points else None,
        "measured_share": cave.measured_share,
        "survey_loops": cave.num_loops,
    }
    return SurveyWalls(
        Mesh(surface.vertices - offset, surface.faces),
        FreeSpace(cave.stations, cave.legs).moved(-offset),
        wall_points(survey, passage_graph(survey)).points - offset,
        offset,
        facts,
    )


def _how_measured(cave: SurveyCave) -> str:
    if not cave.num_wall_points:
        return (
            "The walls are a model: the survey has neither splays nor passage dimensions, so that nothing about the "
            "passage's width is known. Take every clearance as made up."
        )
    return (
        f"The walls are a model: {cave.num_wall_points} points of them were measured, half of these lie within "
        f"{cave.median_misfit:.2f} m of it and 95 % within {cave.p95_misfit:.2f} m. Clearance is no better known."
    )


def survey_free_space(survey: Survey, offset: Array) -> FreeSpace:
    """Return the stations and legs of a survey in the frame of a scan that was moved by -offset (m)."""
    graph = passage_graph(survey)
    return FreeSpace(graph.nodes, graph.segments).moved(-offset)


def hold_against(survey: Survey, cavity: Mesh, offset: Array, journal: Journal) -> dict[str, Any]:
    """Return how a survey and the cavity of a scan agree, and note what does not.

    Raises:
        InputError: the survey has too few splays for that.
    """
    report = check_drift(survey, cavity, Sim3(1.0, np.eye(3), -offset))
    tilt_deg, yaw_deg = np.rad2deg(report.tilt), np.rad2deg(report.yaw)
    if (
        abs(report.scan_scale - 1.0) > MAX_SCALE_ERROR
        or tilt_deg > MAX_TILT_DEG
        or report.drift_per_100_m > MAX_DRIFT
        or report.stations_outside
    ):
        journal.warn("survey-differs", _difference(report, tilt_deg))
    return {
        "num_stations": report.num_stations,
        "stations_outside": list(report.stations_outside),
        "blocked_legs": [list(names) for names in report.blocked_legs],
        "num_splays": report.num_splays,
        "median_residual": report.median_residual,
        "p95_residual": report.p95_residual,
        "drift_per_100_m": report.drift_per_100_m,
        "suggested_scale": report.scan_scale,
        "suggested_up": report.up.tolist(),
        "tilt_deg": float(tilt_deg),
        "yaw_deg": float(yaw_deg),
    }


def _difference(report: DriftReport, tilt_deg: float) -> str:
    return (
        f"Survey and scan differ: the scan's lengths should be multiplied by {report.scan_scale:.3f}, its up axis is "
        f"{tilt_deg:.1f} degrees off, it drifts by {report.drift_per_100_m:.2f} m in 100 m, and "
        f"{len(report.stations_outside)} of {report.num_stations} stations are not inside. Correct the scan, or the "
        "survey where it is the worse one."
    )
