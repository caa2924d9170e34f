"""What is no set of photos of a cave ends in a sentence and an exit code, and writes nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from tests.build.test_scan_build import run
from tests.reconstruct.pictures import pan, speckle, write, write_pan


def one_photo(folder: Path) -> None:
    write_pan(folder, 1)


def identical_photos(folder: Path) -> None:
    write(folder, {f"p{n}.png": speckle(300, 400) for n in range(5)})


def text_files(folder: Path) -> None:
    for n in range(4):
        (folder / f"notes{n}.txt").write_text("no photo")


def text_called_photos(folder: Path) -> None:
    for n in range(4):
        (folder / f"p{n}.jpg").write_text("no photo")


def truncated_photos(folder: Path) -> None:
    for n, picture in enumerate(pan(4, 40)):
        Image.fromarray(picture).save(folder / f"p{n}.jpg")
        content = (folder / f"p{n}.jpg").read_bytes()
        (folder / f"p{n}.jpg").write_bytes(content[: len(content) // 2])


def giant_photos(folder: Path) -> None:
    for n in range(3):
        Image.new("L", (14_000, 13_000), 80 + n).save(folder / f"p{n}.jpg")


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (one_photo, "holds 1 photos; at least 3 are needed"),
        (identical_photos, "show 1 different picture: p1.png (the same picture as p0.png)"),
        (text_files, "holds 0 photos (it also holds 4 other files: .txt)"),
        (text_called_photos, "Only 0 of the 4 photos"),
        (truncated_photos, "p0.jpg (the file is damaged: "),
        (giant_photos, "p0.jpg (it claims more than 179 million pixels)"),
    ],
)
def test_what_is_no_set_of_photos_ends_in_a_sentence(make: Callable[[Path], None], told: str, tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    make(folder)
    result = run(folder, "-o", tmp_path / "out", "--passage-height", "2")
    assert result.returncode == 2
    assert told in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("content", [b"", b"no video", b"\x00\x00\x00\x18ftypmp42" + bytes(4000)])
def test_a_video_without_a_frame_ends_in_a_sentence(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "dive.mp4").write_bytes(content)
    result = run(tmp_path / "dive.mp4", "-o", tmp_path / "out", "--passage-height", "2")
    assert result.returncode == 2
    assert "dive.mp4 cannot be opened" in result.stderr or "No frame of the video" in result.stderr
    assert not (tmp_path / "out").exists()
