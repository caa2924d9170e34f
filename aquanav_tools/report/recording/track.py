"""The track of an episode as a table, for spreadsheets and data frames: CSV, or Parquet."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.libraries import require
from aquanav_tools.report.trajectory import Trajectory
from aquanav_tools.store import write_whole
from aquanav_tools.types import Array

SUFFIXES = ".csv", ".parquet"


def check_track(path: Path) -> None:
    """Check that a track can be written, before the episode is run.

    Raises:
        InputError: its name ends otherwise, its folder is not there, or there is something at its path.
        LibraryError: it is to be Parquet and PyArrow is not installed.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"There are no tracks like {path.name}. Give it a name that ends in {' or '.join(SUFFIXES)}.")
    if not path.parent.is_dir():
        raise InputError(f"There is no folder {path.parent} for the track {path.name}. Make it first.")
    if path.exists():
        raise InputError(f"{path} exists. Choose another name for the track, or remove it.")
    if path.suffix.lower() == ".parquet":
        require("A track as Parquet", "pyarrow", otherwise=", or make it a .csv")


def write_track(path: Path, trajectory: Trajectory) -> None:
    """Write an episode as a table with a row per state, whole or not at all.

    Raises:
        InputError, LibraryError: as in `check_track`.
        ResourceError: the disk is full, or the folder read-only.
    """
    check_track(path)
    columns = track_columns(trajectory)
    table = _csv_table(columns) if path.suffix.lower() == ".csv" else _parquet_table(columns)
    try:
        write_whole(path, table)
    except OSError as cause:
        raise ResourceError(
            f"The track {path} of {len(table)} bytes cannot be written: {cause.strerror or cause}. The disk "
            "may be full or the folder read-only; choose another."
        ) from cause


def _csv_table(columns: dict[str, Array]) -> bytes:
    text = io.StringIO()
    rows = csv.writer(text)
    rows.writerow(columns)
    for row in zip(*(column.tolist() for column in columns.values()), strict=True):
        rows.writerow(["" if value != value else value for value in row])  # nan is what is not there
    return text.getvalue().encode()


def _parquet_table(columns: dict[str, Array]) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = {name: pa.array(column, from_pandas=True) for name, column in columns.items()}  # nan becomes null
    stream = io.BytesIO()
    pq.write_table(pa.table(arrays), stream)
    return stream.getvalue()


def track_columns(trajectory: Trajectory) -> dict[str, Array]:
    """Return the (D + 1,) columns by their names, which end in their units; nan where there is no value.

    World: x east, y north, z up; body: x ahead, y left, z up. A reward is that of the decision that led to its row, a
    command the one that is given in it.
    """
    before, behind = trajectory.rewards, trajectory.commands
    missing = np.full((1, behind.shape[1]), np.nan)
    tables: list[tuple[tuple[str, ...], Array]] = [
        (("time_s",), trajectory.times),
        (("x_m", "y_m", "z_m"), trajectory.positions),
        (("qw", "qx", "qy", "qz"), trajectory.orientations),
        (("surge_m_per_s", "sway_m_per_s", "heave_m_per_s"), trajectory.velocities[:, :3]),
        (("roll_rate_rad_per_s", "pitch_rate_rad_per_s", "yaw_rate_rad_per_s"), trajectory.velocities[:, 3:]),
        (("current_x_m_per_s", "current_y_m_per_s", "current_z_m_per_s"), trajectory.currents),
        (("clearance_m",), trajectory.clearances),
        (("progress_m",), trajectory.progress),
        (("collided",), trajectory.collided.astype(np.int64)),
        (("cost",), trajectory.costs),
        (("reward",), np.concatenate([[np.nan], before])),
        (("ballast", "steer", "thrust"), np.concatenate([behind, missing])),
        (tuple(f"ray_{n}_m" for n in range(trajectory.rays.shape[1])), trajectory.rays),
    ]
    return {
        name: column
        for names, table in tables
        for name, column in zip(names, table.reshape(len(table), -1).T, strict=True)
    }
