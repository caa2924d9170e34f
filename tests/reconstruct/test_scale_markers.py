"""Printed markers and picked points, through pixels of photos with known poses."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.georeference.markers import Markers, check_dictionary, find_markers
from aquanav_tools.reconstruct.georeference.picks import KnownDistances, Picks, Stations, read_picks
from aquanav_tools.reconstruct.georeference.place import place
from aquanav_tools.reconstruct.georeference.rays import Rays, meet
from aquanav_tools.reconstruct.images import Photo, PhotoSet
from aquanav_tools.types import Array
from tests.reconstruct.models import HEIGHT, WIDTH, Posed, posed_model

SCALE = 2.5
SIDE = 0.2
MARGIN = 1.25
"""Side of the white sheet in sides of the black square."""


@dataclass(frozen=True, eq=False)
class Wall:
    """A wall two metres away with a marker on it, photographed from several places."""

    posed: Posed
    photos: PhotoSet


def square(side: float, centre: tuple[float, float, float] = (2.0, 0.0, 0.0)) -> Array:
    """Corners of an upright square that faces -x, clockwise from the upper left one seen from there."""
    half = 0.5 * side
    return np.array(centre) + [[0, half, half], [0, -half, half], [0, -half, -half], [0, half, -half]]


def photograph(posed: Posed, number: int, folder: Path, centre: tuple[float, float, float] = (2.0, 0.0, 0.0)) -> None:
    """Draw a marker on grey rock into every photo, blurred and noisy as photos are."""
    table = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    border = round(400 * (MARGIN - 1.0) / 2.0)
    print_ = cv2.copyMakeBorder(
        cv2.aruco.generateImageMarker(table, number, 400), *[border] * 4, cv2.BORDER_CONSTANT, value=255
    )
    size = float(len(print_))
    # OpenCV counts from pixel centres: the print's corners are half a pixel outside of its first and last ones.
    sheet = np.array([[0, 0], [size, 0], [size, size], [0, size]]) - 0.5
    for index in range(len(posed.centres)):
        corners = posed.pixels(index, square(SIDE * MARGIN, centre)) - 0.5
        warp = cv2.getPerspectiveTransform(sheet.astype(np.float32), 4 * (corners + 0.5).astype(np.float32) - 0.5)
        fine = cv2.warpPerspective(print_, warp, (4 * WIDTH, 4 * HEIGHT), borderValue=90)
        picture = cv2.resize(0.6 * fine + 20.0, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
        picture = cv2.GaussianBlur(picture, (3, 3), 0.6)
        picture += np.random.default_rng(index).normal(0.0, 2.0, picture.shape)
        cv2.imwrite(str(folder / f"p{index}.png"), np.clip(picture, 0, 255).astype(np.uint8))


def photo_set(folder: Path, count: int) -> PhotoSet:
    names = [f"p{index}.png" for index in range(count)]
    return PhotoSet(folder, tuple(Photo(name, WIDTH, HEIGHT, None, file=name) for name in names))


def half_circle(count: int, scale: float = SCALE) -> Posed:
    angles = np.linspace(-0.6, 0.6, count)
    centres = np.stack([2.0 - 1.6 * np.cos(angles), 1.6 * np.sin(angles), 0.2 * np.cos(3.0 * angles)], axis=1)
    return posed_model(centres, np.tile([2.0, 0.0, 0.0], (count, 1)), scale)


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Wall:
    folder, posed = tmp_path_factory.mktemp("wall"), half_circle(6)
    photograph(posed, 7, folder)
    return Wall(posed, photo_set(folder, 6))


def test_a_photographed_marker_gives_the_scale_within_its_stated_error(wall: Wall) -> None:
    markers = find_markers(wall.photos, SIDE, "apriltag-36h11")
    assert set(markers.corners) == {7}
    assert len(markers.corners[7]) == 6
    clue = markers.clue(wall.posed.sparse)
    off = float(clue.metres[0] / clue.sfm[0]) / SCALE - 1.0
    print(f"scale {100 * off:+.2f} %, stated +- {196 * clue.errors[0]:.2f} %")
    assert abs(off) < 1.96 * clue.errors[0] < 0.03
    assert abs(off) < 0.01


def test_corners_are_found_where_they_were_drawn(wall: Wall) -> None:
    found = find_markers(wall.photos, SIDE, "apriltag-36h11").corners[7]
    for index in range(6):
        drawn = wall.posed.pixels(index, square(SIDE))
        assert np.abs(found[f"p{index}.png"] - drawn).max() < 0.6  # blur of 0.6 px and noise of 2 of 255


def test_stated_errors_of_markers_hold_for_noisy_corners() -> None:
    posed = half_circle(5)
    held, draws = 0, 60
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        shared = rng.normal(0.0, 0.25)  # blur moves all corners of all photos outwards alike
        seen = {}
        for index in range(5):
            corners = posed.pixels(index, square(SIDE))
            outwards = np.sign(corners - corners.mean(axis=0))
            seen[f"p{index}.png"] = corners + shared * outwards + rng.normal(0.0, 0.5, (4, 2))
        clue = Markers(SIDE, {3: seen}).clue(posed.sparse)
        held += bool(abs(np.log(clue.metres[0] / clue.sfm[0] / SCALE)) < 1.96 * clue.errors[0])
    assert held >= 53  # of 60 at 95 %, fewer have a chance of 1 in 100


def test_no_marker_in_the_photos_is_said_with_what_to_check(wall: Wall) -> None:
    with pytest.raises(
        InputError, match=r"No aruco-5x5-50 marker of 0\.2 m was found in 6 photos.*--marker-dictionary"
    ):
        find_markers(wall.photos, SIDE, "aruco-5x5-50")


def test_a_marker_in_one_photo_alone_is_said_before_any_camera_is_placed(tmp_path: Path) -> None:
    photograph(half_circle(3), 7, tmp_path)
    for index in (0, 2):
        Image.new("L", (WIDTH, HEIGHT), 128).save(tmp_path / f"p{index}.png")
    with pytest.raises(InputError, match=r"1 apriltag-36h11 markers .* 3 photos, but none of them in two: marker 7"):
        find_markers(photo_set(tmp_path, 3), SIDE, "apriltag-36h11")


def test_a_marker_seen_once_gives_no_scale() -> None:
    posed = half_circle(3)
    markers = Markers(SIDE, {4: {"p1.png": posed.pixels(1, square(SIDE))}})
    with pytest.raises(
        InputError, match=r"None of 1 printed markers.*marker 4 is seen in 1 registered photo\. Each must"
    ):
        markers.clue(posed.sparse)


def test_a_marker_seen_once_beside_a_good_one_is_listed_as_left_out() -> None:
    posed = half_circle(4)
    good = {f"p{n}.png": posed.pixels(n, square(SIDE)) for n in range(4)}
    once = {"p1.png": posed.pixels(1, square(SIDE, (2.0, 0.4, 0.0)))}
    clue = Markers(SIDE, {4: good, 5: once}).clue(posed.sparse)
    assert clue.labels == ("marker 4",)
    assert clue.left_out == ("marker 5 is seen in 1 registered photo",)
    found = place(posed.sparse.centres, posed.sparse.rotations, [clue])
    assert found.statistics["scale_sources"][0]["left_out"] == ["marker 5 is seen in 1 registered photo"]
    assert json.loads(json.dumps(found.statistics, allow_nan=False)) == found.statistics


def test_a_marker_that_hangs_in_two_places_gives_no_scale() -> None:
    posed = half_circle(4)
    places = [(2.0, 0.0, 0.0), (2.0, 0.4, 0.3), (2.0, -0.4, -0.3), (2.0, 0.3, -0.5)]
    seen = {f"p{n}.png": posed.pixels(n, square(SIDE, place)) for n, place in enumerate(places)}
    with pytest.raises(InputError, match=r"marker 4 is not (at one place|square)"):
        Markers(SIDE, {4: seen}).clue(posed.sparse)


@pytest.mark.parametrize(
    ("name", "known"),
    [("apriltag-36h11", "APRILTAG_36H11"), ("aruco-4x4-50", "4X4_50"), ("4X4_50", "4X4_50")],
)
def test_dictionaries_have_plain_names(name: str, known: str) -> None:
    assert check_dictionary(name).upper() == f"DICT_{known}"


def test_an_unknown_dictionary_gets_the_closest_name() -> None:
    with pytest.raises(InputError, match=r"called 'apriltag-36h12'\. Did you mean 'apriltag-36h11'"):
        check_dictionary("apriltag-36h12")


def test_lines_of_sight_meet_where_they_were_aimed_at_in_spite_of_a_mistake(rng: np.random.Generator) -> None:
    point, origins = np.array([0.3, 4.0, 1.0]), rng.normal(size=(7, 3))
    aimed = np.tile(point, (7, 1))
    aimed[2] += 1.0
    directions = aimed - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = meet(Rays(origins, directions, np.full(7, 1e-3)), 3.0)
    assert found is not None
    np.testing.assert_allclose(found.point, point, atol=1e-9)
    np.testing.assert_array_equal(found.is_seen, np.arange(7) != 2)


def test_the_covariance_of_a_meeting_is_that_of_its_scatter() -> None:
    origins = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1.0, 0.0]])
    point, angle = np.array([0.5, 0.3, 4.0]), 1e-3
    found = []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        towards = point - origins
        distances = np.linalg.norm(towards, axis=1, keepdims=True)
        noise = rng.normal(0.0, angle, (3, 3)) * distances
        directions = towards + noise - (noise * towards).sum(axis=1, keepdims=True) * towards / distances**2
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        meeting = meet(Rays(origins, directions, np.full(3, angle)), 8.0)
        assert meeting is not None
        found.append(meeting.point)
        covariance = meeting.covariance
    scatter = np.cov(np.array(found).T)
    # A variance from 400 draws is known to 7 %.
    np.testing.assert_allclose(np.diag(scatter), np.diag(covariance), rtol=0.25)


def test_lines_from_one_place_do_not_meet() -> None:
    origins = np.array([[0.0, 0.0, 0.0], [0.001, 0.0, 0.0]])
    directions = np.array([[0.0, 0.0, 1.0], [-0.0002, 0.0, 1.0]])
    assert meet(Rays(origins, directions, np.full(2, 1e-3)), 3.0) is None


def picks_of(posed: Posed, points: dict[str, Array], noise: float, rng: np.random.Generator) -> Picks:
    count = len(posed.centres)
    return Picks(
        {
            name: {f"p{n}.png": posed.pixels(n, point[None])[0] + rng.normal(0.0, noise, 2) for n in range(count)}
            for name, point in points.items()
        }
    )


def test_a_measured_distance_gives_the_scale_within_its_stated_error() -> None:
    posed = half_circle(4)
    points = {"A": np.array([2.0, 0.5, 0.1]), "B": np.array([2.1, -0.6, -0.2])}
    true = float(np.linalg.norm(points["A"] - points["B"]))
    held, draws = 0, 60
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        tape = true + rng.normal(0.0, 0.01)
        clue = KnownDistances(picks_of(posed, points, 2.0, rng), (("A", "B", tape),)).clue(posed.sparse)
        held += bool(abs(np.log(clue.metres[0] / clue.sfm[0] / SCALE)) < 1.96 * clue.errors[0])
    assert held >= 53  # of 60 at 95 %, fewer have a chance of 1 in 100


def test_picked_stations_are_where_the_survey_says(rng: np.random.Generator) -> None:
    posed = half_circle(4)
    points = {
        name: np.array(p) for name, p in {"1": (2.0, 0.5, 0.1), "2": (2.2, -0.6, 0.2), "3": (2.5, 0, -0.4)}.items()
    }
    clue = Stations(picks_of(posed, points, 0.0, rng), points).clue(posed.sparse)
    np.testing.assert_allclose(clue.sfm * SCALE, clue.world, atol=1e-6)


def test_a_point_picked_once_is_named(rng: np.random.Generator) -> None:
    posed = half_circle(3)
    picks = picks_of(posed, {"A": np.array([2.0, 0.5, 0.1])}, 0.0, rng)
    once = Picks({"A": {"p0.png": picks.pixels["A"]["p0.png"]}})
    with pytest.raises(InputError, match=r"Point 'A' is picked in 1 registered photos of 1; two"):
        once.points(posed.sparse, ["A"])


def test_picks_of_different_rocks_do_not_meet(rng: np.random.Generator) -> None:
    posed = half_circle(2)
    seen = {
        "p0.png": posed.pixels(0, np.array([[2.0, 0.5, 0.1]]))[0],
        "p1.png": posed.pixels(1, np.array([[2.0, 0, 0.4]]))[0],
    }
    with pytest.raises(InputError, match=r"picks of point 'A' in p0\.png, p1\.png do not meet within 10 px"):
        Picks({"A": seen}).points(posed.sparse, ["A"])


def test_picks_are_read_as_image_viewers_count(tmp_path: Path) -> None:
    path = tmp_path / "picks.csv"
    path.write_text("point,photo,x,y\nA,p0.png,10,20\n")
    np.testing.assert_array_equal(read_picks(path, ["p0.png"]).pixels["A"]["p0.png"], [10.5, 20.5])


def test_a_pick_in_an_unknown_photo_is_named_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "picks.csv"
    path.write_text("point,photo,x,y\nA,p9.png,10,20\n")
    with pytest.raises(InputError, match=r"line 2: no photo is called 'p9\.png'\. Did you mean 'p0\.png'"):
        read_picks(path, ["p0.png"])
