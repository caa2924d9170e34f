"""The current on a regular grid: as a table (CSV), and as VTK's image data (.vti), which ParaView and PyVista read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.water import mean_velocities
from aquanav_tools.types import Array

MAX_SAMPLES = 60_000
"""Of the box around a cave: 3 MB of text."""
UNIT_STRENGTH = 1.0
"""Mean speed through the narrowest section for which the way of the water is written where it stands still, m/s."""


@dataclass(frozen=True, eq=False)
class CurrentGrid:
    """Velocity of the water at the samples of a grid, without gusts, eddies and waves."""

    origin: Array
    """(3,) place of sample [0, 0, 0], world, m."""
    spacing: float
    """m."""
    velocity: Array
    """(X, Y, Z, 3) world, m/s; zero in rock."""
    clearance: Array
    """(X, Y, Z) m, negative in rock."""
    is_unit: bool
    """Whether this is the flow for UNIT_STRENGTH, since the scenario's own water stands still."""

    @property
    def points(self) -> Array:
        """(X, Y, Z, 3) places of the samples, m."""
        places = np.moveaxis(np.indices(self.clearance.shape), 0, -1)
        return np.asarray(self.origin + self.spacing * places, dtype=np.float64)


def sample_current(scenario: Scenario) -> CurrentGrid | None:
    """Return the scenario's current, or its flow for UNIT_STRENGTH where it stands still; None without either."""
    vertices = scenario.cavity.mesh.vertices
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0)
    finest = scenario.field.spacing if scenario.flow is None else scenario.flow.spacing
    spacing = max(finest, float(np.prod(size) / MAX_SAMPLES) ** (1 / 3))
    counts = np.ceil(size / spacing).astype(int) + 1
    points = low + spacing * np.moveaxis(np.indices(counts), 0, -1).reshape(-1, 3)
    clearance = scenario.field.clearance(points)
    velocity = np.array(mean_velocities(scenario, None, points))
    is_unit = not velocity.any()
    if is_unit:
        velocity = np.array(mean_velocities(scenario, UNIT_STRENGTH, points))
    if not velocity.any():
        return None
    velocity[clearance <= 0.0] = 0.0
    return CurrentGrid(low, spacing, velocity.reshape(*counts, 3), clearance.reshape(counts), is_unit)


def write_current(current: CurrentGrid, folder: Path) -> None:
    """Write current.csv, a row per sample in water, and current.vti, all samples."""
    rows = np.concatenate([current.points, current.velocity], axis=-1)[current.clearance > 0.0]
    header = "x_m,y_m,z_m,u_m_per_s,v_m_per_s,w_m_per_s"
    np.savetxt(folder / "current.csv", rows, "%.4f", ",", header=header, comments="")
    (folder / "current.vti").write_text(_vti(current), encoding="ascii")


def _vti(current: CurrentGrid) -> str:
    """Return an XML image-data file in ASCII; VTK runs through x fastest."""
    extent = " ".join(f"0 {count - 1}" for count in current.clearance.shape)
    origin = " ".join(f"{value:.9g}" for value in current.origin)
    rows = current.velocity.transpose(2, 1, 0, 3).reshape(-1, 3)
    velocity = "\n".join(f"{u:.5g} {v:.5g} {w:.5g}" for u, v, w in rows)
    clearance = "\n".join(f"{value:.4g}" for value in current.clearance.transpose(2, 1, 0).ravel())
    spacing = " ".join([f"{current.spacing:.9g}"] * 3)
    return (
        '<?xml version="1.0"?>\n<VTKFile type="ImageData" version="0.1" byte_order="LittleEndian">\n'
        f'<ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">\n<Piece Extent="{extent}">\n'
        '<PointData Vectors="velocity" Scalars="clearance">\n'
        f'<DataArray type="Float32" Name="velocity" NumberOfComponents="3" format="ascii">\n{velocity}\n</DataArray>\n'
        f'<DataArray type="Float32" Name="clearance" format="ascii">\n{clearance}\n</DataArray>\n'
        "</PointData>\n</Piece>\n</ImageData>\n</VTKFile>\n"
    )
