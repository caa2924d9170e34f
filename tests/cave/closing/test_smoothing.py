"""Tunnels that nobody scanned are smoothed away, unless that makes more of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from aquanav_tools.cave.closing import reconstruct
from aquanav_tools.cave.closing.reconstruct import SMOOTHING_VOXELS, ReconstructionOptions, close_surface
from aquanav_tools.geometry.mesh.handles import Handle
from aquanav_tools.types import Mesh
from tests.cave.open_caves import straight

VOXEL = 0.1


def handle(x: float) -> Handle:
    """A ring of 0.1 m across at the wall of the tube."""
    angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    ring = np.stack([x + 0.05 * np.cos(angle), 0.05 * np.sin(angle), np.ones(12)], axis=1)
    return Handle(ring, 0.1 * np.pi, False)


def closed_while_finding(monkeypatch: pytest.MonkeyPatch, *counts: int) -> tuple[list[tuple[int, float]], str]:
    """Close a tube in which extraction after extraction so many handles are found.

    Returns the number of places that each extraction smoothed and the radius, voxels, and what the caution says.
    """
    found, asked, water_surface = iter(counts), [], reconstruct.water_surface

    def extract(water: Any, edits: Any, *more: Any) -> Mesh:
        asked.append((len(edits.spurious), round(edits.smoothing_radius / VOXEL, 6)))
        return water_surface(water, edits, *more)

    monkeypatch.setattr(reconstruct, "water_surface", extract)
    monkeypatch.setattr(reconstruct, "_spurious_handles", lambda *_: tuple(handle(2.0 + n) for n in range(next(found))))
    closed = close_surface(straight(), ReconstructionOptions(VOXEL, 0.8, keep_triangles=False))
    assert next(found, None) is None
    return asked, dict(closed.cautions).get("spurious-handles", "")


def test_larger_balls_are_tried_while_they_help(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, told = closed_while_finding(monkeypatch, 3, 2, 1, 1)
    assert asked == [(0, 0.0), (3, SMOOTHING_VOXELS[0]), (5, SMOOTHING_VOXELS[1]), (6, SMOOTHING_VOXELS[2])]
    assert told.startswith("1 tunnels")


@pytest.mark.parametrize("worse", [2, 5])
def test_a_smoothing_that_makes_more_tunnels_than_it_closes_is_taken_back(
    monkeypatch: pytest.MonkeyPatch, worse: int
) -> None:
    asked, told = closed_while_finding(monkeypatch, 3, 1, worse, 1)
    assert asked == [(0, 0.0), (3, SMOOTHING_VOXELS[0]), (4, SMOOTHING_VOXELS[1]), (3, SMOOTHING_VOXELS[0])]
    assert told.startswith("1 tunnels")


def test_a_tube_without_tunnels_is_extracted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    assert closed_while_finding(monkeypatch, 0) == ([(0, 0.0)], "")
