"""Tracks of episodes are tables that others read."""

from __future__ import annotations

import csv
import errno
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.report.recording import track
from aquanav_tools.report.recording.track import write_track
from tests.report.test_bag import dive

COLUMNS = {
    "time_s": "times", "x_m": "positions", "y_m": "positions", "z_m": "positions", "clearance_m": "clearances",
    "progress_m": "progress", "collided": "collided", "cost": "costs",
}  # fmt: skip


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_track_has_every_state_in_its_units(suffix: str, tmp_path: Path) -> None:
    if suffix == ".parquet":
        parquet = pytest.importorskip("pyarrow.parquet", reason="It is about Parquet: pip install pyarrow.")
    trajectory, path = dive(), tmp_path / f"track{suffix}"
    write_track(path, trajectory)
    if suffix == ".csv":
        with path.open(newline="", encoding="utf-8") as file:
            rows = [{name: float(value or "nan") for name, value in row.items()} for row in csv.DictReader(file)]
    else:
        rows = [
            {name: np.nan if value is None else float(value) for name, value in row.items()}
            for row in parquet.read_table(path).to_pylist()
        ]
    assert len(rows) == trajectory.num_decisions + 1
    found = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    for name, of in COLUMNS.items():
        wanted = getattr(trajectory, of)
        np.testing.assert_array_equal(found[name], _axis(wanted, name))
    turns = np.stack([found[name] for name in ("qw", "qx", "qy", "qz")], axis=1)
    np.testing.assert_array_equal(turns, trajectory.orientations)
    rates = ["surge_m_per_s", "sway_m_per_s", "heave_m_per_s"]
    rates += ["roll_rate_rad_per_s", "pitch_rate_rad_per_s", "yaw_rate_rad_per_s"]
    np.testing.assert_array_equal(np.stack([found[name] for name in rates], axis=1), trajectory.velocities)
    currents = np.stack([found[f"current_{axis}_m_per_s"] for axis in "xyz"], axis=1)
    np.testing.assert_array_equal(currents, trajectory.currents)
    rays = np.stack([found[f"ray_{n}_m"] for n in range(trajectory.rays.shape[1])], axis=1)
    np.testing.assert_array_equal(rays, trajectory.rays)
    np.testing.assert_array_equal(found["reward"][1:], trajectory.rewards)
    commands = np.stack([found[name] for name in ("ballast", "steer", "thrust")], axis=1)
    np.testing.assert_array_equal(commands[:-1], trajectory.commands)
    assert np.isnan([found["reward"][0], *commands[-1]]).all()


def _axis(values: np.ndarray, name: str) -> np.ndarray:
    return values if values.ndim == 1 else values[:, "xyz".index(name[0])]


def test_a_track_is_whole_or_not_there_and_replaces_nothing(tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    with pytest.raises(ValueError, match=r"zip\(\) argument"):
        write_track(path, replace(dive(), rewards=np.zeros(1)))
    assert not path.exists()
    write_track(path, dive())
    with pytest.raises(InputError, match=r"track.csv exists. Choose another name for the track"):
        write_track(path, dive())


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("track.xls", "There are no tracks like track.xls.*ends in .csv or .parquet"),
        ("no/track.csv", "no folder.*Make it"),
    ],
)
def test_a_track_that_cannot_be_written_is_refused(name: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        write_track(tmp_path / name, dive())


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_full_disk_is_told_in_a_sentence(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fill_up(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    if suffix == ".parquet":
        pytest.importorskip("pyarrow", reason="It is about Parquet: pip install pyarrow.")
    monkeypatch.setattr(track, "write_whole", fill_up)
    with pytest.raises(ResourceError, match=r"bytes cannot be written: No space left on device.*choose another"):
        write_track(tmp_path / f"track{suffix}", dive())
