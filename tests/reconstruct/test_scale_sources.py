"""Files and EXIF records that tell scale or up, and the sentences about their faults."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.georeference.camera_positions import CameraPositions, read_positions
from aquanav_tools.reconstruct.georeference.depth_track import photo_time, read_depth_track
from aquanav_tools.reconstruct.georeference.gps import read_gps
from aquanav_tools.reconstruct.georeference.options import ScaleSources
from aquanav_tools.reconstruct.georeference.rig import RigPairs, read_rig
from aquanav_tools.reconstruct.georeference.sources import read_world
from aquanav_tools.reconstruct.georeference.wgs84 import ecef_from_geodetic, enu_from_geodetic
from aquanav_tools.reconstruct.images import Photo, PhotoSet
from tests.reconstruct.models import posed_model

NAMES = ["a.jpg", "b.jpg", "c.jpg", "d.jpg", "e.jpg"]
NOON = datetime(2026, 11, 21, 12)


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def photos_at(times: list[datetime | None], folder: Path = Path()) -> PhotoSet:
    return PhotoSet(
        folder,
        tuple(Photo(name, 64, 48, None, file=name, taken=time) for name, time in zip(NAMES, times, strict=False)),
    )


def test_positions_are_read_in_any_column_order_and_kept_in_that_of_the_photos(tmp_path: Path) -> None:
    path = write(tmp_path / "p.csv", "x, z, y, name\n1, 3, 2, b.jpg\n4, 6, 5, a.jpg\n")
    found = read_positions(path, NAMES).positions
    assert list(found) == ["a.jpg", "b.jpg"]
    np.testing.assert_array_equal(found["b.jpg"], [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,x,y\na.jpg,1,2\n", r"lacks the columns z.*must be: name,x,y,z"),
        ("name,x,y,z\naa.jpg,1,2,3\n", r"line 2: no photo is called 'aa\.jpg'\. Did you mean 'a\.jpg'"),
        ("name,x,y,z\na.jpg,1,2,3\na.jpg,1,2,3\n", r"line 3: 'a\.jpg' is listed twice"),
        ("name,x,y,z\na.jpg,1,two,3\n", r"line 2: x, y, z are not 3 numbers"),
        ("name,x,y,z\na.jpg,1,2\n", r"line 2: x, y, z are not 3 numbers"),
        ("name,x,y,z\na.jpg,1,nan,3\n", r"line 2: .* is not finite"),
    ],
)
def test_faults_in_a_positions_file_are_named_with_their_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_positions(write(tmp_path / "p.csv", text), NAMES)


def test_a_missing_file_is_named_with_how_it_begins(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.csv does not exist.*name,x,y,z"):
        read_positions(tmp_path / "none.csv", NAMES)


def test_a_picture_is_no_list(tmp_path: Path) -> None:
    Image.new("RGB", (64, 48)).save(tmp_path / "p.png")
    with pytest.raises(InputError, match=r"p\.png is not text in UTF-8: byte 0 \(line 1\) is 0x89"):
        read_positions(tmp_path / "p.png", NAMES)


def test_positions_of_photos_that_did_not_register_are_too_few(rng: np.random.Generator) -> None:
    sparse = posed_model(rng.normal(size=(5, 3)), np.full((5, 3), 9.0)).sparse
    known = CameraPositions("camera positions", {"p0.png": np.zeros(3), "p1.png": np.ones(3), "z.png": np.ones(3)})
    with pytest.raises(InputError, match=r"Only 2 of the 5 registered photos have one of the camera positions; 3 are"):
        known.clue(sparse)


# Satellite positions.


def test_a_minute_of_latitude_is_as_long_as_the_meridian_says() -> None:
    # Radius of curvature of the meridian, a (1 - e2) / (1 - e2 sin2)^1.5: a nautical mile is 1842.9 m at the equator
    # and 1861.6 m at the poles (WGS 84).
    for latitude, metres in ((0.0, 1842.905), (45.0, 1852.216), (89.99, 1861.566)):
        ends = np.array([[latitude - 1 / 120, 10.0, 0.0], [latitude + 1 / 120, 10.0, 0.0]])
        assert np.linalg.norm(np.diff(ecef_from_geodetic(ends), axis=0)) == pytest.approx(metres, abs=0.02)


def test_a_degree_of_longitude_on_the_equator_is_a_part_of_its_circle() -> None:
    radius, angle = 6_378_137.0, np.deg2rad(1.0)
    east, north, up = enu_from_geodetic(np.array([[0.0, 1.0, 0.0]]), np.zeros(3))[0]
    assert (east, north) == pytest.approx((radius * np.sin(angle), 0.0), abs=1e-6)
    assert up == pytest.approx(radius * (np.cos(angle) - 1.0), abs=1e-6)


def test_east_north_and_up_keep_distances_and_height(rng: np.random.Generator) -> None:
    places = np.array([47.5, 12.9, 800.0]) + rng.normal(0.0, 1.0, (6, 3)) * [1e-3, 1e-3, 30.0]
    enu, ecef = enu_from_geodetic(places, places[0]), ecef_from_geodetic(places)
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(enu, axis=0), axis=1), np.linalg.norm(np.diff(ecef, axis=0), axis=1)
    )
    above = enu_from_geodetic(np.array([[47.5, 12.9, 900.0]]), np.array([47.5, 12.9, 800.0]))
    np.testing.assert_allclose(above, [[0.0, 0.0, 100.0]], atol=1e-6)


def gps_photos(folder: Path, fixes: list[tuple[float, float, float | None]]) -> PhotoSet:
    for name, (latitude, longitude, height) in zip(NAMES, fixes, strict=False):
        exif = Image.Exif()
        record = exif.get_ifd(0x8825)
        record[1], record[3] = "N" if latitude >= 0 else "S", "E" if longitude >= 0 else "W"
        record[2], record[4] = (
            [IFDRational(int(abs(a))), IFDRational(0), IFDRational(round(abs(a) % 1 * 3600 * 10_000), 10_000)]
            for a in (latitude, longitude)
        )
        if height is not None:
            record[5], record[6] = b"\0", IFDRational(round(height * 100), 100)
        Image.new("RGB", (64, 48)).save(folder / name, exif=exif)
    return photos_at([None] * len(fixes), folder)


def test_satellite_positions_come_in_metres(tmp_path: Path) -> None:
    photos = gps_photos(tmp_path, [(-33.0, -70.0, 500.0), (-33.001, -70.0, 510.0), (-33.002, -70.0, 505.0)])
    found = read_gps(photos)
    places = np.array(list(found.positions.values()))
    np.testing.assert_allclose(np.diff(places, axis=0), [[0.0, -110.92, 10.0], [0.0, -110.92, -5.0]], atol=0.05)
    assert found.spread == (1.0, 1.0, 2.0)


def test_satellite_positions_without_height_leave_it_open(tmp_path: Path) -> None:
    photos = gps_photos(tmp_path, [(47.0, 12.0, 500.0), (47.001, 12.0, None), (47.002, 12.001, 505.0)])
    assert read_gps(photos).spread[2] == np.inf


def test_a_satellite_position_on_another_continent_is_left_out(tmp_path: Path) -> None:
    fixes = [(47.0, 12.0, None), (47.001, 12.0, None), (47.002, 12.001, None), (12.0, 47.0, None)]
    assert set(read_gps(gps_photos(tmp_path, fixes)).positions) == {"a.jpg", "b.jpg", "c.jpg"}


def test_a_damaged_satellite_position_counts_as_none(tmp_path: Path) -> None:
    fixes = [(47.0, 12.0, None), (47.001, 12.0, None), (47.002, 12.001, None), (47.003, 12.0, None)]
    photos = gps_photos(tmp_path, fixes)
    exif = Image.Exif()
    exif.get_ifd(0x8825).update({1: "N", 2: [IFDRational(47), IFDRational(0)], 3: "E", 4: [IFDRational(12)]})
    Image.new("RGB", (64, 48)).save(tmp_path / "b.jpg", exif=exif)
    assert set(read_gps(photos).positions) == {"a.jpg", "c.jpg", "d.jpg"}


@pytest.mark.parametrize(
    ("fixes", "message"),
    [
        ([(0.0, 0.0, 0.0)] * 4, r"0 of 4 photos have a satellite position.*4 more say 0, 0.*no reception under ground"),
        ([(47.0, 12.0, 800.0)] * 4, r"4 photos with a satellite position have the same few positions.*last fix"),
    ],
)
def test_satellite_positions_that_are_none_get_a_sentence(
    tmp_path: Path, fixes: list[tuple[float, float, float | None]], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read_gps(gps_photos(tmp_path, fixes))


# The depth sensor.


def depth_file(folder: Path, begin: datetime = NOON, seconds: int = 60) -> Path:
    """Sinking by 0.1 m a second from 5 m."""
    rows = [f"{(begin + timedelta(seconds=n)).isoformat()},{5 + 0.1 * n}" for n in range(seconds)]
    return write(folder / "depth.csv", "time,depth\n" + "\n".join(rows))


def test_depths_are_matched_to_the_photos_times(tmp_path: Path) -> None:
    photos = photos_at([NOON + timedelta(seconds=s) for s in (1.5, 10.0, 99.0)])
    found = read_depth_track(depth_file(tmp_path), photos, 0.0)
    assert {name: round(float(place[2]), 6) for name, place in found.positions.items()} == {
        "a.jpg": -5.15,
        "b.jpg": -6.0,
    }
    assert found.spread == (np.inf, np.inf, 1.0)


def test_a_camera_clock_that_was_ahead_is_set_back(tmp_path: Path) -> None:
    photos = photos_at([NOON + timedelta(hours=1, seconds=10)])
    assert read_depth_track(depth_file(tmp_path), photos, 3600.0).positions["a.jpg"][2] == pytest.approx(-6.0)


def test_a_gap_in_the_track_is_not_bridged(tmp_path: Path) -> None:
    path = write(
        tmp_path / "d.csv", "time,depth\n2026-11-21T12:00:00,5\n2026-11-21T12:00:01,5\n2026-11-21T12:05:00,9\n"
    )
    photos = photos_at([NOON + timedelta(seconds=0.5), NOON + timedelta(seconds=100)])
    assert set(read_depth_track(path, photos, 0.0).positions) == {"a.jpg"}


def test_frames_of_a_video_are_matched_by_seconds(tmp_path: Path) -> None:
    path = write(tmp_path / "d.csv", "time,depth\n60,5\n62,7\n")
    photos = PhotoSet(Path(), (Photo("frame-000122-01m01.000s.jpg", 64, 48, None),))
    assert read_depth_track(path, photos, 0.0).positions["frame-000122-01m01.000s.jpg"][2] == pytest.approx(-6.0)


@pytest.mark.parametrize("name", ["IMG_20261121_120000.jpg", "2026-11-21 12.00.00.jpg", "20261121T120000.jpg"])
def test_times_are_read_from_names(name: str) -> None:
    assert photo_time(Photo(name, 64, 48, None)) == photo_time(Photo("a.jpg", 64, 48, None, taken=NOON))


def test_names_without_a_date_have_no_time() -> None:
    assert photo_time(Photo("IMG_20269921_120000.jpg", 64, 48, None)) is None
    assert photo_time(Photo("IMG_0001.jpg", 64, 48, None)) is None


def test_a_track_of_another_hour_is_told_with_both_times(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"No photo was taken while.*14:00:00.*12:00:00 to 2026-11-21 12:00:59.*--clock-ahead"
    ):
        read_depth_track(depth_file(tmp_path), photos_at([NOON + timedelta(hours=2)] * 3), 0.0)


def test_photos_without_times_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"None of the 3 photos says when it was taken"):
        read_depth_track(depth_file(tmp_path), photos_at([None] * 3), 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,depth\nyesterday,5\n", r"line 2: 'yesterday' is no date and time"),
        ("time,depth\n2026-11-21T12:00:00,5\n", r"holds 1 depths"),
        ("time,depth\n2026-11-21T12:00:00,-5\n2026-11-21T12:00:01,-6\n", r"mostly negative"),
    ],
)
def test_faults_in_a_depth_track_get_a_sentence(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_depth_track(write(tmp_path / "d.csv", text), photos_at([NOON]), 0.0)


# Two cameras on a bar.


def test_pairs_are_found_by_what_stands_for_the_star() -> None:
    names = ["left_1.jpg", "left_2.jpg", "right_1.jpg", "right_3.jpg"]
    assert read_rig("left_*.jpg", "right_*.jpg", 0.3, names).pairs == (("left_1.jpg", "right_1.jpg"),)


@pytest.mark.parametrize(
    ("first", "message"),
    [("left_.jpg", r"needs one \*"), ("middle_*.jpg", r"0 photos are named middle_.* none of them")],
)
def test_faulty_patterns_get_a_sentence(first: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_rig(first, "right_*.jpg", 0.3, ["left_1.jpg", "right_1.jpg"])


def test_pairs_give_the_scale_in_spite_of_one_that_was_placed_wrongly(rng: np.random.Generator) -> None:
    lefts = rng.normal(size=(6, 3)) * 3.0
    across = rng.normal(size=(6, 3))
    rights = lefts + 0.3 * across / np.linalg.norm(across, axis=1, keepdims=True)
    rights[4] += 2.0
    centres = np.concatenate([lefts, rights])
    sparse = posed_model(centres, np.full((12, 3), 20.0), scale=4.0).sparse
    clue = RigPairs(tuple((f"p{n}.png", f"p{n + 6}.png") for n in range(6)), 0.3).clue(sparse)
    assert clue.metres[0] / clue.sfm[0] == pytest.approx(4.0, rel=1e-3)
    assert 0.005 <= clue.errors[0] < 0.01


def test_two_pairs_are_too_few(rng: np.random.Generator) -> None:
    sparse = posed_model(rng.normal(size=(4, 3)), np.full((4, 3), 20.0)).sparse
    pairs = (("p0.png", "p1.png"), ("p2.png", "p3.png"), ("p4.png", "p5.png"))
    with pytest.raises(InputError, match=r"Only 2 of 3 pairs of photos registered"):
        RigPairs(pairs, 0.3).clue(sparse)


# Up.


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"marker_size": -0.2}, "marker_size"),
        ({"distance": (("A", "B", 0.0),), "picks": Path("p.csv")}, "above 0"),
        ({"distance": (("A", "B", 1.0),)}, "belong together"),
        ({"picks": Path("p.csv")}, "belong together"),
        ({"rig": ("l*", "r*", -1.0)}, "above 0"),
    ],
)
def test_senseless_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ScaleSources(**options)  # type: ignore[arg-type]


def test_a_source_that_says_nothing_of_the_model_is_a_caution_and_the_next_one_is_used(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    centres = rng.normal(size=(8, 3)) * [5.0, 2.0, 1.0]
    names = [f"p{n}.png" for n in range(8)]
    for name in names:
        Image.new("L", (480, 360), 128).save(tmp_path / name)
    photos = PhotoSet(tmp_path, tuple(Photo(name, 480, 360, None, file=name) for name in names))
    rows = [f"{name},{x},{y},{z}" for name, (x, y, z) in zip(names, centres, strict=True)]
    listed = write(tmp_path / "p.csv", "name,x,y,z\n" + "\n".join(rows))
    world = read_world(ScaleSources(positions=listed, marker_size=0.2), photos).with_markers(photos)
    found = world.place(posed_model(centres, np.full((8, 3), 20.0), scale=3.0).sparse)
    assert found.world_from_sfm.scale == pytest.approx(3.0)
    assert [caution.code for caution in found.cautions] == ["unused-scale-source"]
    assert "No apriltag-36h11 marker" in found.cautions[0].message
    assert found.statistics["scale_sources"][0]["source"] == "camera positions"


@pytest.mark.parametrize(
    ("given", "scaling"),
    [
        (ScaleSources(), ()),
        (ScaleSources(level_floor=True), ()),
        (ScaleSources(marker_size=0.2), ("marker_size",)),
        (ScaleSources(gps=True, positions=Path("p.csv")), ("positions", "gps")),
        (ScaleSources(picks=Path("p.csv"), distance=(("a", "b", 2.0),)), ("picks",)),
        (ScaleSources(rig=("l*", "r*", 0.3), depth_track=Path("d.csv")), ("rig", "depth_track")),
    ],
)
def test_it_is_known_which_sources_can_tell_the_size(given: ScaleSources, scaling: tuple[str, ...]) -> None:
    assert given.scaling == scaling
