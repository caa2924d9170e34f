"""Each fault is put into one photo of a good set, and found in that photo alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.reconstruct.depth import DepthOptions
from aquanav_tools.reconstruct.features import FeatureOptions
from aquanav_tools.reconstruct.images import Photo, PhotoSet, read_photos
from aquanav_tools.reconstruct.intake.forecast import Forecast, check_disk, check_memory, forecast
from aquanav_tools.reconstruct.intake.likeness import find_copies, find_groups
from aquanav_tools.reconstruct.intake.options import IntakeOptions
from aquanav_tools.reconstruct.intake.preflight import Preflight, preflight
from aquanav_tools.reconstruct.intake.sharpness import sharpness
from aquanav_tools.reconstruct.matching import MatchOptions
from tests.reconstruct.pictures import GreyImage, pan, speckle, write, write_pan


def look(folder: Path) -> Preflight:
    return preflight(read_photos(folder))


def codes(found: Preflight) -> set[str]:
    return {caution.code for caution in found.cautions}


def message(found: Preflight, code: str) -> str:
    return next(caution.message for caution in found.cautions if caution.code == code)


def test_a_good_set_is_let_pass_without_a_word(tmp_path: Path) -> None:
    write_pan(tmp_path, 6)
    found = look(tmp_path)
    assert found.cautions == ()
    assert len(found.photos.photos) == 6


@pytest.mark.parametrize(
    ("code", "spoil"),
    [
        ("dark-photos", lambda p: p // 16),
        ("burnt-photos", lambda p: np.minimum(p.astype(int) + 130, 255).astype(np.uint8)),
        ("blurred-photos", lambda p: cv2.blur(p, (9, 3))),
    ],
)
def test_a_spoilt_photo_is_named_and_no_other(tmp_path: Path, code: str, spoil) -> None:  # type: ignore[no-untyped-def]
    pictures = write_pan(tmp_path, 6)
    write(tmp_path, {"p3.png": spoil(pictures[3])})
    found = look(tmp_path)
    assert [(finding.name, finding.code) for finding in found.findings] == [("p3.png", code)]
    assert "1 of 6 photos, p3.png" in message(found, code)


def test_turbid_water_is_not_taken_for_blur() -> None:
    rock = speckle(300, 400)
    turbid = (110 + rock.astype(float) / 3).astype(np.uint8)
    vignetted = (rock * np.linspace(0.2, 1.0, 400)).astype(np.uint8)
    assert sharpness(turbid) == pytest.approx(sharpness(rock), rel=0.15)
    assert sharpness(vignetted) == pytest.approx(sharpness(rock), rel=0.15)
    assert sharpness(cv2.blur(rock, (7, 1))) < 0.7 * sharpness(rock)


def test_identical_photos_are_refused_with_their_names(tmp_path: Path) -> None:
    write(tmp_path, {f"{index}.png": speckle(300, 400) for index in range(5)})
    with pytest.raises(InputError, match=r"5 photos .* show 1 different picture: 1\.png \(the same picture as 0\.png"):
        look(tmp_path)


def test_one_copy_is_left_out_by_name_and_the_rest_is_used(tmp_path: Path) -> None:
    pictures = write_pan(tmp_path, 5)
    write(tmp_path, {"p9.jpg": pictures[1]}, quality=90)
    found = look(tmp_path)
    assert found.photos.names == [f"p{index}.png" for index in range(5)]
    assert "p9.jpg (the same picture as p1.png)" in message(found, "photos-left-out")


def test_photos_from_one_place_are_told_but_used(tmp_path: Path) -> None:
    pictures = write_pan(tmp_path, 5)
    noise = np.random.default_rng(0).normal(0.0, 3.0, pictures[4].shape)
    write(tmp_path, {"p5.png": np.clip(pictures[4] + noise, 0, 255).astype(np.uint8)})
    found = look(tmp_path)
    assert "p5.png (as p4.png)" in message(found, "still-photos")
    assert len(found.photos.photos) == 6


def test_damaged_photos_are_told_again(tmp_path: Path) -> None:
    write_pan(tmp_path, 4)
    (tmp_path / "p7.jpg").write_text("text")
    assert "1 of 5 photos are not used: p7.jpg" in message(look(tmp_path), "photos-left-out")


def test_photos_of_two_places_form_two_groups(tmp_path: Path) -> None:
    here, there = pan(7, 60, seed=1), pan(4, 60, seed=2)
    write(tmp_path, {f"p{index:02d}.png": pixels for index, pixels in enumerate(here + there)})
    found = look(tmp_path)
    assert "4 of 11 photos overlap with none" in message(found, "gaps")
    assert "p07.png to p10.png" in message(found, "gaps")


def test_unrelated_photos_do_not_overlap() -> None:
    assert len(find_groups([speckle(300, 400, seed) for seed in range(8)])) == 8


def test_a_set_without_order_is_told_so(tmp_path: Path) -> None:
    write(tmp_path, {f"{seed}.png": speckle(300, 400, seed) for seed in range(6)})
    assert "largest of 6 groups that hang together has 1 of 6 photos" in message(look(tmp_path), "little-overlap")


def test_a_station_photographed_all_around_hangs_together() -> None:
    one, two, three = pan(4, 50, seed=1), pan(4, 50, seed=2), pan(4, 50, seed=3)
    stations = [picture for around in zip(one, two, three, strict=True) for picture in around]
    assert [len(group) for group in find_groups(stations)] == [4, 4, 4]


def test_copies_are_found_anywhere_in_a_set() -> None:
    pictures: list[GreyImage] = pan(5, 60)
    assert find_copies([*pictures, pictures[1]]) == [(5, 1)]


def test_an_action_camera_asks_for_its_lens(tmp_path: Path) -> None:
    write_pan(tmp_path, 3)
    photos = read_photos(tmp_path)
    photos = replace(photos, photos=tuple(replace(photo, camera="GoPro HERO9 Black") for photo in photos.photos))
    assert "--lens fisheye" in message(preflight(photos), "perhaps-fisheye")
    fisheye = replace(photos, intake=IntakeOptions(lens="fisheye"))
    assert codes(preflight(fisheye)) == set()


def test_a_housing_is_reported_with_numbers(tmp_path: Path) -> None:
    write_pan(tmp_path, 3)
    photos = replace(read_photos(tmp_path), intake=IntakeOptions(housing="flat-port"))
    assert "grows by 33%" in message(preflight(photos), "refraction")


def many(count: int) -> PhotoSet:
    return PhotoSet(Path(), tuple(Photo(f"p{index}.jpg", 960, 720, None) for index in range(count)))


def expect(count: int, **intake: str) -> Forecast:
    photos = replace(many(count), intake=IntakeOptions(**intake))  # type: ignore[arg-type]
    return forecast(photos, FeatureOptions(), MatchOptions(), DepthOptions())


def test_the_forecast_of_the_demo_is_right_to_a_factor_of_two_on_two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda process: {0, 1}, raising=False)
    expected = expect(65)
    assert 1034 / 2 < expected.pairs < 1034 * 2  # measured: 1034
    assert 325 / 2 < sum(expected.seconds.values()) < 325 * 2  # measured: 325 s, 0.405 GB
    assert 0.405 / 2 < expected.disk_gb < 0.405 * 2


@pytest.mark.parametrize(("stage", "cpu_seconds"), [("features", 108.7), ("depth", 205.2), ("fusion", 19.8)])
def test_stages_take_what_they_took_for_the_demo(
    stage: str, cpu_seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda process: {0, 1}, raising=False)
    ratio = expect(65).seconds[stage] / (cpu_seconds / 2)  # build.json of the demo, on both of two cores
    assert 1 / 1.5 < ratio < 1.5


def test_placing_cameras_takes_one_core_as_long_as_for_the_demo() -> None:
    assert 1 / 1.5 < expect(65).seconds["cameras"] / 20.0 < 1.5  # build.json of the demo


def test_long_sets_take_time_in_proportion_to_their_length() -> None:
    ratio = sum(expect(2000).seconds.values()) / sum(expect(1000).seconds.values())
    assert ratio == pytest.approx(2.0, rel=0.02)


def test_copies_with_more_contrast_take_disk() -> None:
    assert expect(100, enhance="features").disk_gb > expect(100).disk_gb


def test_a_full_disk_is_noticed_before_the_work() -> None:
    with pytest.raises(ResourceError, match=r"has 0\.10 GB free, .* will write about \d+\.\d+ GB"):
        check_disk(expect(1000), 100_000_000, Path("out"))
    check_disk(expect(1000), 10**12, Path("out"))


def test_too_little_memory_is_noticed_before_the_work() -> None:
    with pytest.raises(ResourceError, match=r"0\.5 GB of memory are free, and the reconstruction will take \d\.\d GB"):
        check_memory(expect(65), 500_000_000)


def test_the_forecast_reads_as_a_sentence() -> None:
    assert "GB of memory" in str(expect(100))
    assert " h (" in str(expect(20_000))
