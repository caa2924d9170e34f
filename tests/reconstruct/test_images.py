from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.images import natural_key, read_photos
from tests.reconstruct.scenes import SMALL_RENDER


def write_photo(path: Path, size: tuple[int, int] = (64, 48), seed: int = 0) -> None:
    pixels = np.random.default_rng(seed).integers(0, 255, (size[1], size[0], 3), dtype=np.uint8)
    Image.fromarray(pixels).save(path)


def write_photos(folder: Path, *names: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        write_photo(folder / name)


def test_photos_come_in_natural_order_and_other_files_are_left_alone(tmp_path: Path) -> None:
    write_photos(tmp_path, "b10.jpg", "b2.JPG", "a1.png", "b1.tif")
    (tmp_path / "notes.txt").write_text("dive log")
    assert read_photos(tmp_path).names == ["a1.png", "b1.tif", "b2.JPG", "b10.jpg"]


def test_natural_order_takes_digits_as_numbers() -> None:
    assert sorted(["x11", "x2", "x1b", "x1"], key=natural_key) == ["x1", "x1b", "x2", "x11"]


def test_focal_length_of_rendered_photos_is_read_back_from_exif(small_photos) -> None:  # type: ignore[no-untyped-def]
    _, photos = small_photos
    assert all(photo.focal_px == pytest.approx(SMALL_RENDER.focal_px) for photo in photos.photos)


def test_photos_of_another_size_get_a_camera_of_their_own(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.png", "b.png")
    write_photo(tmp_path / "c.png", (48, 64))
    groups = read_photos(tmp_path).by_camera()
    assert [[photo.name for photo in group] for group in groups] == [["a.png", "b.png"], ["c.png"]]


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


def test_folder_with_other_files_says_what_it_found(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.png")
    (tmp_path / "b.heic").touch()
    with pytest.raises(InputError, match=r"holds 1 photos \(it also holds 1 other files: \.heic\)"):
        read_photos(tmp_path)


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_truncated_photo_is_named_before_any_work(tmp_path: Path, suffix: str) -> None:
    write_photos(tmp_path, "a.png", "b.png", f"cut{suffix}")
    whole = (tmp_path / f"cut{suffix}").read_bytes()
    (tmp_path / f"cut{suffix}").write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(InputError, match=rf"cut\{suffix} cannot be read.*Copy it from the camera again"):
        read_photos(tmp_path)


def test_text_with_the_suffix_of_a_photo_is_named(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.png", "b.png")
    (tmp_path / "c.jpg").write_text("not a photo")
    with pytest.raises(InputError, match=r"c\.jpg cannot be read"):
        read_photos(tmp_path)


def test_names_with_spaces_are_refused_with_the_way_out(tmp_path: Path) -> None:
    write_photos(tmp_path, "a.png", "b.png", "c d.png")
    with pytest.raises(InputError, match=r"1 photo names .* hold spaces, the first is 'c d\.png'.*Rename"):
        read_photos(tmp_path)
