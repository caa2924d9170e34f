"""The scenario's file flow.npz: the current from portal to portal, on a grid of its own."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from aquanav_tools.cave.water.flow import Flow, flow_from_bricks
from aquanav_tools.errors import ScenarioError
from aquanav_tools.geometry.volume.field import BRICK
from aquanav_tools.scenario.geometry import read_member


def write_flow(flow: Flow, path: Path) -> None:
    """Write the arrays of a flow, compressed.

    They are `origin`, `spacing`, `bricks`, `velocity` (of each brick's samples, for a mean of 1 m/s through the
    narrowest section), `narrowest` (its area, m^2, and middle, m), `portals` and `shares`.
    """
    with path.open("wb") as stream:
        np.savez_compressed(
            stream,
            origin=flow.origin,
            spacing=flow.spacing,
            bricks=flow.bricks,
            velocity=flow.samples[:, :BRICK, :BRICK, :BRICK],
            narrowest=flow.narrowest,
            portals=np.array([label for label, _ in flow.shares], dtype=np.int64),
            shares=np.array([share for _, share in flow.shares], dtype=np.float64),
        )


def read_flow(path: Path) -> Flow:
    """Return the flow in an NPZ that `write_flow` wrote, as carefully as `read_field`.

    Raises:
        ScenarioError: it is of another form, or a value is not finite or out of range.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            origin = read_member(archive, "origin", np.float64, (3,))
            spacing = float(read_member(archive, "spacing", np.float64, ()))
            bricks = read_member(archive, "bricks", np.int32, (-1, -1, -1))
            cores = read_member(archive, "velocity", np.float32, (-1, BRICK, BRICK, BRICK, 3))
            narrowest = read_member(archive, "narrowest", np.float64, (4,))
            labels = read_member(archive, "portals", np.int64, (-1,))
            shares = read_member(archive, "shares", np.float64, (-1,))
    except Exception as cause:  # whatever a damaged archive, or an array's header, makes the parsers raise
        raise ScenarioError(f"{path} is not a flow: {cause!r}. Build the scenario again.") from cause
    if (
        not bricks.size
        or not len(cores)
        or bricks.min() < 0
        or bricks.max() >= len(cores)
        or len(labels) != len(shares)
    ):
        raise ScenarioError(f"{path} has bricks that do not fit its {len(cores)} pieces. Build the scenario again.")
    arrays = (origin, np.array(spacing), cores, narrowest, shares)
    if not all(np.isfinite(array).all() for array in arrays) or not spacing > 0.0 or not narrowest[0] > 0.0:
        raise ScenarioError(f"{path} has values that are not finite, or no size. Build the scenario again.")
    passed = tuple((int(label), float(share)) for label, share in zip(labels, shares, strict=True))
    return flow_from_bricks(origin, spacing, bricks, cores, narrowest, passed)
