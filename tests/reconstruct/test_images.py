"""Which files of a folder become photos, in which order, and what is said of the others."""

from __future__ import annotations

import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.errors import InputError, LibraryError
from aquanav_tools.reconstruct.images import list_left_out, read_photos
from aquanav_tools.reconstruct.intake import decode
from aquanav_tools.reconstruct.intake.exif import (
    EXIF_IFD,
    FOCAL_LENGTH_35MM_TAG,
    FOCAL_LENGTH_TAG,
    FOCAL_PLANE_RESOLUTION_TAG,
    FOCAL_PLANE_UNIT_TAG,
    MAKE_TAG,
    MODEL_TAG,
    ORIENTATION_TAG,
    PIXEL_WIDTH_TAG,
    TAKEN_TAG,
)
from tests.reconstruct.pictures import write_pan


def write_photo(path: Path, size: tuple[int, int] = (64, 48), seed: int = 0, exif: Image.Exif | None = None) -> None:
    pixels = np.random.default_rng(seed).integers(0, 255, (size[1], size[0], 3), dtype=np.uint8)
    Image.fromarray(pixels).save(path, exif=exif or Image.Exif())


def write_photos(folder: Path, *names: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        write_photo(folder / name)


def exif(tags: dict[int, object] | None = None, details: dict[int, object] | None = None) -> Image.Exif:
    record = Image.Exif()
    record.update(tags or {})
    record[EXIF_IFD] = details or {}
    return record


def left_out(folder: Path) -> dict[str, str]:
    return {one.name: one.reason for one in read_photos(folder).left_out}


def test_photos_come_in_natural_order_and_other_files_are_left_alone(tmp_path: Path) -> None:
    write_photos(tmp_path, "b10.jpg", "b2.JPG", "a1.png", "b1.tif")
    (tmp_path / "notes.txt").write_text("dive log")
    assert read_photos(tmp_path).names == ["a1.png", "b1.tif", "b2.JPG", "b10.jpg"]


def test_a_counter_that_rolled_over_is_followed_by_the_times_the_photos_were_taken(tmp_path: Path) -> None:
    for minute, name in enumerate(["DSC_9998.jpg", "DSC_9999.jpg", "DSC_0001.jpg", "DSC_0002.jpg"]):
        taken = {TAKEN_TAG: f"2026:05:01 10:{minute:02d}:00"}
        write_photo(tmp_path / name, exif=exif(details=taken))
    assert read_photos(tmp_path).names == ["DSC_9998.jpg", "DSC_9999.jpg", "DSC_0001.jpg", "DSC_0002.jpg"]


def test_focal_length_comes_from_its_equivalent_on_film(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.jpg", "b.jpg")
    write_photo(tmp_path / "c.jpg", (360, 240), exif=exif(details={FOCAL_LENGTH_35MM_TAG: 24}))
    # 360 x 240 px on 36 x 24 mm: 10 px per mm.
    assert [photo.focal_px for photo in read_photos(tmp_path).photos] == [None, None, pytest.approx(240.0)]


def test_focal_length_comes_from_millimetres_and_the_size_of_pixels_of_the_sensor(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.jpg", "b.jpg")
    sensor = {FOCAL_LENGTH_TAG: 8.0, FOCAL_PLANE_RESOLUTION_TAG: 1000.0, FOCAL_PLANE_UNIT_TAG: 3, PIXEL_WIDTH_TAG: 720}
    write_photo(tmp_path / "c.jpg", (360, 240), exif=exif(details=sensor))
    # 1000 px per cm is 100 per mm; the photo was made half as large since.
    assert read_photos(tmp_path).photos[2].focal_px == pytest.approx(400.0)


def test_photos_are_grouped_by_camera_size_and_focal_length(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.jpg", "b.jpg")
    write_photo(tmp_path / "c.jpg", (48, 64))
    write_photo(tmp_path / "d.jpg", exif=exif({MAKE_TAG: "Canon", MODEL_TAG: "G7"}))
    write_photo(tmp_path / "e.jpg", exif=exif({MAKE_TAG: "Canon", MODEL_TAG: "G7"}, {FOCAL_LENGTH_35MM_TAG: 24}))
    groups = read_photos(tmp_path).by_camera()
    assert [[photo.name for photo in group] for group in groups] == [
        ["a.jpg", "b.jpg"],
        ["c.jpg"],
        ["d.jpg"],
        ["e.jpg"],
    ]


def test_a_photo_held_upright_has_the_size_it_is_seen_at(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.jpg", "b.jpg")
    write_photo(tmp_path / "c.jpg", exif=exif({ORIENTATION_TAG: 6}))
    turned = read_photos(tmp_path).photos[2]
    assert (turned.width, turned.height, turned.is_plain) == (48, 64, False)


def test_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere does not exist.*Check the path"):
        read_photos(tmp_path / "nowhere")


def test_a_file_is_not_taken_for_a_folder(tmp_path: Path) -> None:
    write_photo(tmp_path / "a.png")
    with pytest.raises(InputError, match="is a file, not a folder"):
        read_photos(tmp_path / "a.png")


def test_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds 0 photos; at least 3 are needed"):
        read_photos(tmp_path)


def test_one_photo_is_refused(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.png")
    with pytest.raises(InputError, match=r"holds 1 photos; at least 3 are needed"):
        read_photos(tmp_path)


def test_a_folder_of_text_files_says_what_it_found(tmp_path: Path) -> None:
    for index in range(4):
        (tmp_path / f"{index}.txt").write_text("dive log")
    with pytest.raises(InputError, match=r"holds 0 photos \(it also holds 4 other files: \.txt\)"):
        read_photos(tmp_path)


def test_text_files_with_the_suffix_of_photos_are_refused_by_name(tmp_path: Path) -> None:
    for index in range(4):
        (tmp_path / f"{index}.jpg").write_text("dive log")
    with pytest.raises(InputError, match=r"Only 0 of the 4 photos .* 0\.jpg \(the file holds no picture in a known"):
        read_photos(tmp_path)


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_a_truncated_photo_is_left_out_by_name_and_the_others_are_used(tmp_path: Path, suffix: str) -> None:
    write_photos(tmp_path, "a.png", "b.png", "c.png", f"cut{suffix}")
    whole = (tmp_path / f"cut{suffix}").read_bytes()
    (tmp_path / f"cut{suffix}").write_bytes(whole[: len(whole) * 2 // 3])
    photos = read_photos(tmp_path)
    assert photos.names == ["a.png", "b.png", "c.png"]
    assert [one.name for one in photos.left_out] == [f"cut{suffix}"]
    assert "damaged" in photos.left_out[0].reason


def test_empty_files_and_text_are_left_out_with_their_reasons(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.png", "b.png", "c.png")
    (tmp_path / "empty.jpg").touch()
    (tmp_path / "text.jpg").write_text("not a photo")
    assert left_out(tmp_path) == {
        "empty.jpg": "the file is empty",
        "text.jpg": "the file holds no picture in a known format",
    }


def test_a_file_that_claims_a_giant_picture_is_left_out_before_it_is_decoded(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.png", "b.png", "c.png")
    chunks = [b"IHDR" + struct.pack(">IIBBBBB", 30_000, 30_000, 8, 2, 0, 0, 0), b"IDAT" + zlib.compress(b"")]
    framed = [struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk)) for chunk in chunks]
    (tmp_path / "bomb.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(framed))
    assert left_out(tmp_path) == {"bomb.png": "it claims more than 179 million pixels"}


def test_a_photo_of_100_megapixels_is_used_at_half_of_that(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.png", "b.png")
    record = exif(details={FOCAL_LENGTH_35MM_TAG: 24})
    Image.new("L", (12_000, 8_500), 90).save(tmp_path / "large.jpg", exif=record)
    photo = read_photos(tmp_path).photos[2]
    assert photo.width * photo.height <= decode.MAX_PIXELS
    assert photo.width / photo.height == pytest.approx(12_000 / 8_500, abs=1e-3)
    assert photo.focal_px == pytest.approx(24 * np.hypot(photo.width, photo.height) / np.hypot(36, 24), rel=1e-3)
    assert not photo.is_plain


def test_heic_without_its_library_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_photos(tmp_path, "a.png", "b.png", "c.png")
    (tmp_path / "d.heic").touch()
    monkeypatch.setitem(sys.modules, "pi_heif", None)
    with pytest.raises(LibraryError, match=r"HEIC.*pip install 'aquanav\[heic\]'.*export the photos as JPEG"):
        read_photos(tmp_path)


def test_small_copies_are_upright_and_400_px_long(tmp_path: Path) -> None:
    pictures = write_pan(tmp_path, 3)
    Image.fromarray(pictures[0]).resize((1600, 1200)).save(tmp_path / "large.jpg", exif=exif({ORIENTATION_TAG: 3}))
    small = read_photos(tmp_path).photos[0].thumbnail
    assert small is not None
    assert small.shape == (300, 400)
    np.testing.assert_allclose(small[::-1, ::-1], pictures[0], atol=40)  # JPEG, resampled twice
    assert np.corrcoef(small[::-1, ::-1].ravel(), pictures[0].ravel())[0, 1] > 0.95


def test_many_photos_left_out_are_listed_in_part(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.png", "b.png", "c.png")
    for index in range(7):
        (tmp_path / f"empty{index}.jpg").touch()
    text = list_left_out(read_photos(tmp_path).left_out)
    assert text.count("the file is empty") == 5
    assert text.endswith("; and 2 more")
