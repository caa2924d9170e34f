"""Photos as they lie in the workspace: upright, 8 bits, safely named, masked; and COLMAP works with them."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.features import FeatureOptions, extract_features
from aquanav_tools.reconstruct.images import PhotoSet, read_photos
from aquanav_tools.reconstruct.intake.enhance import equalised
from aquanav_tools.reconstruct.intake.exif import ORIENTATION_TAG
from aquanav_tools.reconstruct.intake.memory import sift_bytes, sift_threads
from aquanav_tools.reconstruct.intake.options import IntakeOptions
from aquanav_tools.reconstruct.intake.prepare import prepare_photos
from aquanav_tools.reconstruct.matching import MatchOptions, match_features
from tests.reconstruct.pictures import GreyImage, pan, speckle, write, write_pan


def prepared(folder: Path, work: Path, **intake: str) -> PhotoSet:
    return prepare_photos(replace(read_photos(folder), intake=IntakeOptions(**intake)), work)  # type: ignore[arg-type]


def shown(photos: PhotoSet, name: str) -> GreyImage:
    with Image.open(photos.path(name)) as image:
        return np.asarray(image.convert("L"))


def nearly_same(one: GreyImage, other: GreyImage) -> bool:
    return one.shape == other.shape and float(np.abs(one.astype(int) - other).mean()) < 3.0  # JPEG of quality 95


def test_plain_photos_are_linked_and_others_copied(tmp_path: Path) -> None:
    pictures = write_pan(tmp_path / "in", 3)
    write(tmp_path / "in", {"p9.png": np.dstack([pictures[0], np.full_like(pictures[0], 255)])})
    photos = prepared(tmp_path / "in", tmp_path / "work")
    assert [photos.path(name).is_symlink() for name in photos.names] == [True, True, True, False]
    assert nearly_same(shown(photos, "p9.png"), pictures[0])


@pytest.mark.parametrize(
    ("orientation", "stored"),
    [
        (2, lambda p: p[:, ::-1]),
        (3, lambda p: p[::-1, ::-1]),
        (4, lambda p: p[::-1]),
        (5, lambda p: p.T),
        (6, lambda p: np.rot90(p)),
        (7, lambda p: np.rot90(p, 2).T),
        (8, lambda p: np.rot90(p, -1)),
    ],
)
def test_photos_are_turned_upright(tmp_path: Path, orientation: int, stored) -> None:  # type: ignore[no-untyped-def]
    pictures = write_pan(tmp_path / "in", 2)
    record = Image.Exif()
    record[ORIENTATION_TAG] = orientation
    write(tmp_path / "in", {"turned.jpg": np.ascontiguousarray(stored(pictures[0]))}, exif=record, quality=95)
    assert nearly_same(shown(prepared(tmp_path / "in", tmp_path / "work"), "turned.jpg"), pictures[0])


def test_16_bit_and_colour_and_float_tiff_become_the_same_picture(tmp_path: Path) -> None:
    grey = speckle(300, 400)
    write(tmp_path / "in", {"a.tif": grey.astype(np.uint16) * 257, "b.png": grey.astype(np.uint16) * 257})
    write(tmp_path / "in", {"c.tif": (grey / np.float32(255)).astype(np.float32), "d.png": np.dstack([grey] * 3)})
    photos = prepared(tmp_path / "in", tmp_path / "work")
    assert photos.names == ["a.tif", "b.png", "c.tif", "d.png"]
    assert all(nearly_same(shown(photos, name), grey) for name in photos.names)


def test_transparent_parts_are_masked(tmp_path: Path) -> None:
    pictures = write_pan(tmp_path / "in", 2)
    alpha = np.full((300, 400), 255, np.uint8)
    alpha[:, :150] = 0
    write(tmp_path / "in", {"glass.png": np.dstack([pictures[0]] * 3 + [alpha])})
    photos = prepared(tmp_path / "in", tmp_path / "work")
    assert photos.masks_dir is not None
    mask = np.asarray(Image.open(photos.masks_dir / f"{photos.path('glass.png').name}.png"))
    np.testing.assert_array_equal(mask, alpha)
    assert not shown(photos, "glass.png")[:, :140].any()


@pytest.mark.parametrize("mask_name", ["p 1.png.png", "p 1.png"])
def test_nothing_is_found_behind_a_mask_and_names_may_hold_spaces(tmp_path: Path, mask_name: str) -> None:
    pictures = pan(3, 40)
    write(tmp_path / "in", {f"p {index}.png": pixels for index, pixels in enumerate(pictures)})
    mask = np.full((150, 200), 255, np.uint8)  # half the photo's size
    mask[:75] = 0
    write(tmp_path / "in" / "masks", {mask_name: mask})
    photos, database = prepared(tmp_path / "in", tmp_path / "work"), tmp_path / "work" / "database.db"
    extract_features(photos, database, FeatureOptions(max_features=400))
    match_features(photos, database, MatchOptions())
    with load_pycolmap().Database.open(database) as store:
        keypoints = {image.name: store.read_keypoints(image.image_id) for image in store.read_all_images()}
        _, inliers = store.read_two_view_geometry_num_inliers()
    assert sorted(keypoints) == ["p%200.png", "p%201.png", "p%202.png"]
    assert keypoints["p%201.png"][:, 1].min() > 149.0
    assert keypoints["p%200.png"][:, 1].min() < 20.0
    assert len(inliers) == 3
    assert min(inliers) > 50


def test_a_mask_of_another_shape_is_refused_by_name(tmp_path: Path) -> None:
    write_pan(tmp_path / "in", 3)
    write(tmp_path / "in" / "masks", {"p1.png": np.zeros((300, 300), np.uint8)})
    with pytest.raises(InputError, match=r"masks/p1\.png is 300 x 300 px, its photo, held upright, 400 x 300 px"):
        prepared(tmp_path / "in", tmp_path / "work")


def test_a_mask_that_is_no_picture_is_refused_by_name(tmp_path: Path) -> None:
    write_pan(tmp_path / "in", 3)
    (tmp_path / "in" / "masks").mkdir()
    (tmp_path / "in" / "masks" / "p1.png").write_text("black")
    with pytest.raises(InputError, match=r"mask .*p1\.png cannot be used: the file holds no picture"):
        prepared(tmp_path / "in", tmp_path / "work")


def test_contrast_for_features_alone_leaves_the_photos_as_they_are(tmp_path: Path) -> None:
    dull = {f"{i}.png": (100 + pixels // 20).astype(np.uint8) for i, pixels in enumerate(pan(3, 40))}
    write(tmp_path / "in", dull)
    photos = prepared(tmp_path / "in", tmp_path / "work", enhance="features")
    assert photos.features_dir is not None
    with Image.open(photos.features_dir / "0.png") as bright:
        assert np.asarray(bright).std() > 2.0 * dull["0.png"].std()
    np.testing.assert_array_equal(shown(photos, "0.png"), dull["0.png"])


def test_contrast_for_all_changes_the_photos(tmp_path: Path) -> None:
    dull = {f"{i}.png": (100 + pixels // 20).astype(np.uint8) for i, pixels in enumerate(pan(3, 40))}
    write(tmp_path / "in", dull)
    photos = prepared(tmp_path / "in", tmp_path / "work", enhance="all")
    assert photos.features_dir is None
    assert shown(photos, "0.png").std() > 2.0 * dull["0.png"].std()


def test_equalising_keeps_the_hue() -> None:
    import cv2

    blue_rock = np.dstack([speckle(200, 200) // 4 + 40, speckle(200, 200) // 4 + 90, speckle(200, 200) // 4 + 110])
    after = np.asarray(equalised(Image.fromarray(blue_rock)))
    hues = [
        cv2.cvtColor(pixels, cv2.COLOR_RGB2LAB)[..., 1:].reshape(-1, 2).mean(axis=0) for pixels in (blue_rock, after)
    ]
    np.testing.assert_allclose(hues[0], hues[1], atol=4.0)


PEAK_OF_LARGE_PHOTOS = """
import resource, sys
from pathlib import Path
from aquanav_tools.reconstruct.images import read_photos
from aquanav_tools.reconstruct.intake.prepare import prepare_photos
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
photos = prepare_photos(read_photos(Path(sys.argv[1])), Path(sys.argv[2]))
print(*(photo.width * photo.height for photo in photos.photos))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


def test_photos_of_100_megapixels_take_bounded_memory_one_after_the_other(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    picture = Image.fromarray(np.tile(speckle(500, 600), (17, 20))).convert("RGB")
    assert picture.width * picture.height > 100e6
    for n in range(2):
        picture.save(tmp_path / "in" / f"{n}.jpg", quality=30 + n)
    picture.crop((0, 0, 400, 300)).save(tmp_path / "in" / "small.jpg")
    command = [sys.executable, "-c", PEAK_OF_LARGE_PHOTOS, str(tmp_path / "in"), str(tmp_path / "work")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    sizes, peak_kb = done.stdout.splitlines()
    assert all(45e6 < int(size) <= 50e6 for size in sizes.split()[:2])
    # Decoded once in colour, 3 bytes a pixel, beside the half of it that is kept: 4.5 bytes; libjpeg adds its own.
    assert int(peak_kb) * 1024 < 6.0 * picture.width * picture.height


@pytest.mark.parametrize(("free_gb", "threads"), [(100.0, 2), (4.0, 1), (0.5, 1)])
def test_large_photos_are_searched_one_at_a_time_where_memory_is_short(
    free_gb: float, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda pid: {0, 1})
    assert sift_threads([(8660, 5773)], int(1e9 * free_gb)) == threads
    assert sift_bytes([(8660, 5773)], 1) < 2.1e9


def test_a_second_run_converts_nothing_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "in", {f"{i}.tif": pixels.astype(np.uint16) * 257 for i, pixels in enumerate(pan(3, 40))})
    first = prepared(tmp_path / "in", tmp_path / "work")

    def refuse(*args: object) -> None:
        raise AssertionError("converted again")

    monkeypatch.setattr("aquanav_tools.reconstruct.intake.prepare.upright", refuse)
    assert prepared(tmp_path / "in", tmp_path / "work").photos == first.photos
