"""Survex data files. Truth: closed forms, and positions that Survex's own cavern computed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.survey.model import LegFlag, StationFlag, Survey
from aquanav_tools.survey.svx import read_svx
from aquanav_tools.survey.svx_files import MAX_FILE_BYTES
from aquanav_tools.types import Array
from tests.survey.example import ENLARGED, LOOPS, SCALE, cavern

BY_CAVERN = {
    "entrance": (0.0, 0.0, 0.0),
    "upper.1": (0.0, 0.0, 0.0),
    "upper.2": (7.8028, 9.2473, -2.3514),
    "upper.3": (15.8265, 3.8518, -1.4196),
    "upper.4": (11.4949, -3.7843, -1.4265),
    "upper.5": (11.4113, -3.5098, -7.5257),
    "upper.6": (12.1771, -11.8673, -5.6243),
    "upper.7": (19.405, -10.0614, -4.3038),
    "upper.20": (2.9664, 12.6472, 7.5),
    "back.2": (20.526, 4.6409, -6.5526),
    "back.3": (27.5095, -3.5711, -7.2443),
    "digitised.2": (23.8189, -3.9053, -5.1743),
    "digitised.3": (20.2327, 3.2508, -4.5447),
    "digitised.4": (20.0976, -5.8635, -4.4993),
    "digitised.5": (25.2327, 3.2508, -4.5447),
    "gone.1": (12.1771, -11.8673, -5.6243),
    "gone.a": (12.7849, -8.4205, -5.6243),
    "gone.A": (16.6088, -12.6487, -5.6243),
}
"""What cavern 1.4.4 makes of LOOPS enlarged a hundredfold (see `example`), divided by a hundred."""
LENGTH_BY_CAVERN = 161.4793
MILLIMETRE = 1e-3


def read(tmp_path: Path, text: str) -> Survey:
    path = tmp_path / "cave.svx"
    path.write_text(text)
    return read_svx(path)


def place(tmp_path: Path, text: str, name: str = "2") -> Array:
    return read(tmp_path, "*fix 1 0 0 0\n" + text).find(name).position


def advice(tmp_path: Path, text: str) -> str:
    with pytest.raises(InputError) as error:
        read(tmp_path, text)
    return str(error.value)


def test_stations_in_loops_are_where_survex_puts_them(tmp_path: Path) -> None:
    survey = read(tmp_path, LOOPS)
    for name, position in BY_CAVERN.items():
        assert survey.find(name).position == pytest.approx(position, abs=MILLIMETRE), name
    assert survey.length == pytest.approx(LENGTH_BY_CAVERN, abs=MILLIMETRE)
    assert survey.title == "Loops"
    assert survey.warnings == ()


def test_cavern_itself_agrees_to_a_millimetre(tmp_path: Path) -> None:
    (tmp_path / "loops.svx").write_text(LOOPS)
    (tmp_path / "enlarged.svx").write_text(ENLARGED)
    positions, length = cavern(tmp_path / "enlarged.svx", tmp_path)
    survey = read_svx(tmp_path / "loops.svx")
    named = {station.name: station.position for station in survey.stations if station.name}
    assert named.keys() == positions.keys()
    for name, position in positions.items():
        assert named[name] == pytest.approx(position / SCALE, abs=MILLIMETRE), name
    assert survey.length == pytest.approx(length / SCALE, abs=MILLIMETRE)


def test_flags_of_stations_and_legs_are_kept(tmp_path: Path) -> None:
    survey = read(tmp_path, LOOPS)
    assert [station.name for station in survey.entrances] == ["entrance"]
    assert survey.find("upper.20").flags == StationFlag.SURFACE
    assert survey.find("upper.1").flags & StationFlag.FIXED
    assert len(survey.splays) == 2  # "-" and "."; "..." is a leg to a point that only lacks a name
    assert sum(bool(leg.flags & LegFlag.DUPLICATE) for leg in survey.legs) == 1  # two readings, one after the other
    walls = [station for station in survey.stations if station.flags & StationFlag.WALL]
    assert len(walls) == 1
    assert sum(bool(leg.flags & LegFlag.NOSURVEY) for leg in survey.legs) == 1
    assert survey.passages[0].lrud[1] == pytest.approx([1.5, 1.0, math.nan, 0.7], nan_ok=True)


def test_a_level_leg_to_the_east_ends_in_the_east(tmp_path: Path) -> None:
    assert place(tmp_path, "1 2 10 90 0") == pytest.approx([10, 0, 0], abs=1e-9)


@pytest.mark.parametrize(
    ("text", "position"),
    [
        ("1 2 10 0 30", (0, 10 * math.cos(math.pi / 6), 5)),
        ("1 2 10 - UP", (0, 0, 10)),
        ("1 2 10 - -V", (0, 0, -10)),
        ("1 2 10 0 -", (0, 10, 0)),
        ("*units tape feet\n1 2 10 0 0", (0, 3.048, 0)),
        ("*units tape 0.5 metres\n1 2 10 0 0", (0, 5, 0)),
        ("*units compass grads\n1 2 10 100 0", (10, 0, 0)),
        ("*units clino percent\n1 2 10 0 100", (0, 10 / math.sqrt(2), 10 / math.sqrt(2))),
        ("*units compass quadrants\n1 2 10 S90E 0", (10, 0, 0)),
        ("*units compass quadrants\n1 2 10 W 0", (-10, 0, 0)),
        ("*calibrate tape 1 2\n1 2 6 0 0", (0, 10, 0)),
        ("*units tape feet\n*calibrate tape 0.5\n1 2 10.5 0 0", (0, 3.048, 0)),
        ("*calibrate tape 0.5 feet 1.1\n1 2 10 0 0", (0, 11 - 0.1524, 0)),
        ("*calibrate declination -90\n1 2 10 0 0", (10, 0, 0)),
        ("*declination 90 degrees\n1 2 10 0 0", (10, 0, 0)),
        ("*data diving from to tape compass fromdepth todepth\n*calibrate depth 0 -1\n1 2 5 0 2 6", (0, 3, -4)),
        ("*data diving from to tape compass depthchange\n1 2 5 0 -4", (0, 3, -4)),
        ("*data cylpolar from to tape compass depthchange\n1 2 3 0 -4", (0, 3, -4)),
        ("*data cartesian from to northing easting altitude\n1 2 3 4 5", (4, 3, 5)),
        ("*data topofil from to fromcount tocount compass clino\n1 2 100 110 0 0", (0, 10, 0)),
        ("*data normal station count newline direction compass clino\n1 100\n B 180 0\n2 110", (0, 10, 0)),
        ("*data diving station depth newline tape compass\n1 -1\n 5 0\n2 -5", (0, 3, -4)),
        ("*data normal from to tape backcompass backclino\n1 2 10 180 -30", (0, 10 * math.cos(math.pi / 6), 5)),
        ("*data normal from to tape compass backcompass clino\n1 2 10 359 181 0", (0, 10, 0)),
        ("*data normal from to ignore compass tape clino ignoreall\n1 2 x 90 10 0 nice chamber", (10, 0, 0)),
        ("*set decimal /\n1 2 10/5 90 0", (10.5, 0, 0)),
        ("*infer plumbs on\n*calibrate clino 5\n1 2 10 0 90", (0, 0, 10)),
        ("*begin\n*units tape feet\n*end\n1 2 10 90 0", (10, 0, 0)),
    ],
)
def test_readings_mean_what_the_manual_says(tmp_path: Path, text: str, position: tuple[float, ...]) -> None:
    # Tolerance: rounding of doubles over lengths of 10 m.
    assert place(tmp_path, text) == pytest.approx(position, abs=1e-9)


def test_an_exact_fix_at_both_ends_shares_the_misclosure_evenly(tmp_path: Path) -> None:
    survey = read(tmp_path, "*fix 1 0 0 0\n*fix 3 0 21 0\n1 2 10 0 0\n2 3 10 0 0")
    assert survey.find("2").position == pytest.approx([0, 10.5, 0], abs=1e-9)


@pytest.mark.parametrize(
    ("longitude", "latitude", "east", "north"),
    [
        (19.894801, 49.245350, 419561.49, 5455318.47),
        (18.1, 10.2, 182241.26, 1128950.28),
        (24.5, 70.5, 630330.58, 7825387.23),
    ],
)
def test_longitude_and_latitude_become_utm(
    tmp_path: Path, longitude: float, latitude: float, east: float, north: float
) -> None:
    text = f"*cs out UTM34N\n*cs LONG-LAT\n*fix 1 {longitude} {latitude} 1383\n1 2 1 0 0"
    # As cavern 1.4.4 (PROJ) prints them, to the centimetre.
    assert read(tmp_path, text).find("1").position == pytest.approx([east, north, 1383.0], abs=0.0051)


def test_a_survey_without_fixed_point_starts_at_the_origin_and_says_so(tmp_path: Path) -> None:
    survey = read(tmp_path, "a b 10 90 0")
    assert survey.find("a").position == pytest.approx([0, 0, 0])
    assert "no fixed point" in survey.warnings[0]


def test_files_are_included_from_below_their_folder_only(tmp_path: Path) -> None:
    (tmp_path / "deep" / "deeper").mkdir(parents=True)
    (tmp_path / "secret.svx").write_text("1 2 10 90 0")
    (tmp_path / "deep" / "deeper" / "leg.svx").write_text("1 2 10 90 0")
    root = tmp_path / "deep" / "cave.svx"
    root.write_text("*fix 1\n*include deeper\\LEG.svx\n")
    assert read_svx(root).length == pytest.approx(10.0)
    root.write_text("*fix 1\n*include ../secret\n")
    with pytest.raises(InputError, match="outside"):
        read_svx(root)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("*equat 1 2", ["cave.svx:1", "Did you mean 'equate'?"]),
        ("1 2 10 90", ["cave.svx:1", "lacks 'clino'"]),
        ("1 2 10 90 0 7", ["6 fields, 5 are expected"]),
        ("1 2 ten 90 0", ["'ten' is no number"]),
        ("1 2 nan 90 0", ["'nan' is no number"]),
        ("1 2! 10 90 0", ["'2!' is no name"]),
        ("*data normal from to tape compas clino", ["'compas' is not known", "'compass'"]),
        ("*data normal from tape compass", ["neither 'station' nor 'from' and 'to'"]),
        ("*data cartesian from to dx dy", ["easting, northing and altitude must be"]),
        (f"1 2 {'9' * 400} 0 0", ["larger than anything"]),
        ("*data norml from to", ["'norml' is not known", "'normal'"]),
        ("*units tape degrees", ["'degrees' is no unit of tape"]),
        ("*calibrate", ["words are missing"]),
        ("*begin a\n1 2 10 90 0", ["the file ends before *end a"]),
        ("*begin a\n*end b", ["the block began as 'a'"]),
        ("*fix 1 0 0 0\n*fix 1 0 0 1", ["fixed at another place"]),
        ("*fix 1 0 0 0\n1 2 3 4 5\n7 8 3 4 5", ["2 of 4 stations are tied to no fixed point", "'7'"]),
        ("*include nowhere", ["there is no such file"]),
        ("*include cave", ["may include itself"]),
        ("*cs out UTM34N\n*cs OSGB:SD\n*fix 1 1 2 3", ["we cannot convert", "cavern"]),
        ("; nothing", ["no stations"]),
        (
            "*data diving from to tape compass depthchange\n1 2 5 0 -6",
            ["depth changes by 6.00 m over a tape of 5.00 m"],
        ),
    ],
)
def test_each_fault_gets_its_sentence(tmp_path: Path, text: str, words: list[str]) -> None:
    message = advice(tmp_path, text)
    for word in words:
        assert word in message


def test_binary_missing_and_huge_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "cave.svx"
    with pytest.raises(InputError, match="no file"):
        read_svx(path)
    path.write_bytes(b"Survex\0\1\2")
    with pytest.raises(InputError, match="binary"):
        read_svx(path)
    with path.open("wb") as file:
        file.truncate(MAX_FILE_BYTES + 1)
    with pytest.raises(InputError, match="at most"):
        read_svx(path)


def test_the_declination_that_cannot_be_computed_is_owned_up_to(tmp_path: Path) -> None:
    survey = read(tmp_path, "*cs out UTM34N\n*cs UTM34N\n*declination auto 1 2 3\n*fix 1 0 0 0\n1 2 10 0 0")
    assert survey.find("2").position == pytest.approx([0, 10, 0])
    assert "*declination auto" in survey.warnings[0]


def test_a_thousand_random_loops_close(tmp_path: Path, rng: np.random.Generator) -> None:
    true = rng.uniform(0.0, 100.0, (200, 3))
    pairs = rng.integers(0, 200, (1000, 2))
    pairs = np.vstack([pairs[pairs[:, 0] != pairs[:, 1]], np.column_stack([np.arange(199), np.arange(1, 200)])])
    steps = true[pairs[:, 1]] - true[pairs[:, 0]]
    lines = [f"{a} {b} {x:.9f} {y:.9f} {z:.9f}" for (a, b), (x, y, z) in zip(pairs, steps, strict=True)]
    fix = "*fix 0 " + " ".join(f"{x:.9f}" for x in true[0])
    survey = read(tmp_path, "\n".join([fix, "*data cartesian from to dx dy dz", *lines]))
    found = np.array([survey.find(str(index)).position for index in range(200)])
    assert np.abs(found - true).max() < 1e-6  # nine decimals in the file
