"""Frames from a video whose every frame is known: where it looks, and whether it is blurred."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.images import read_photos
from aquanav_tools.reconstruct.intake.video import open_video, take_frames
from tests.reconstruct.pictures import speckle

STEP = 0.05
SPEED_PX = 4
MOVING = 70
"""Frames in which the camera moves; in the rest it stands."""


def write_video(path: Path, codec: str = "MJPG", frames: int = 100) -> None:
    """Pan over a wall at 4 of 400 px per frame, 30 frames per second; of six frames, the last three are blurred."""
    wall = speckle(300, 400 + SPEED_PX * MOVING, seed=3)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), 30.0, (400, 300))
    for index in range(frames):
        left = SPEED_PX * min(index, MOVING)
        view = wall[:, left : left + 400]
        view = cv2.blur(view, (15, 1)) if index % 6 >= 3 else view
        writer.write(cv2.cvtColor(view, cv2.COLOR_GRAY2BGR))
    writer.release()


def numbers(folder: Path) -> list[int]:
    return [int(name.split("-")[1]) for name in read_photos(folder).names]


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "dive.avi"
    write_video(path)
    return path


@pytest.fixture(scope="module")
def frames(film: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("film") / "frames"
    take_frames(open_video(film), folder, STEP)
    return folder


def test_frames_are_kept_about_every_step_and_none_while_the_camera_stands(frames: Path) -> None:
    kept = numbers(frames)
    moved = np.diff(np.minimum(kept, MOVING)) * SPEED_PX / 400
    assert kept[0] == 0
    assert np.all((moved >= 0.9 * STEP) & (moved <= 2.1 * STEP))
    assert sum(index > MOVING for index in kept) <= 1


def test_the_sharp_frames_are_kept(frames: Path) -> None:
    assert all(index % 6 < 3 for index in numbers(frames))


def test_names_tell_the_time(frames: Path) -> None:
    name = read_photos(frames).names[1]
    assert float(name.split("m")[-1].removesuffix("s.jpg")) == pytest.approx(numbers(frames)[1] / 30.0, abs=1e-3)


@pytest.mark.parametrize(("suffix", "codec"), [("mp4", "mp4v"), ("mov", "mp4v"), ("mkv", "mp4v")])
def test_common_containers_are_read(tmp_path: Path, suffix: str, codec: str) -> None:
    path = tmp_path / f"a b.{suffix}"
    write_video(path, codec, frames=40)
    found = take_frames(open_video(path), tmp_path / "frames", STEP)
    assert found.num_readable == 40
    assert found.num_kept >= 4


def test_a_killed_run_goes_on_to_the_same_frames(film: Path, frames: Path, tmp_path: Path) -> None:
    first = {path.name: path.read_bytes() for path in frames.glob("*.jpg")}
    for name in sorted(first)[:3]:
        (tmp_path / name).write_bytes(first[name])
    (tmp_path / f"unfinished-{sorted(first)[3]}").write_bytes(b"half a frame")
    take_frames(open_video(film), tmp_path, STEP)
    assert {path.name: path.read_bytes() for path in tmp_path.glob("frame-*.jpg")} == first


def test_a_finished_run_reads_the_video_no_more(film: Path, frames: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    video = open_video(film)
    monkeypatch.setattr("aquanav_tools.reconstruct.intake.video._read", lambda *args: pytest.fail("read again"))
    assert take_frames(video, frames, STEP).num_readable == 100


def test_a_dark_beginning_does_not_end_the_film(tmp_path: Path) -> None:
    wall = speckle(300, 900, seed=3)
    writer = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (400, 300))
    for index in range(60):
        view = wall[:, 8 * index : 8 * index + 400] if index >= 15 else np.zeros((300, 400), np.uint8)
        writer.write(cv2.cvtColor(view, cv2.COLOR_GRAY2BGR))
    writer.release()
    assert take_frames(open_video(tmp_path / "v.avi"), tmp_path / "frames", STEP).num_kept >= 6


def test_a_file_that_is_no_video_is_refused(tmp_path: Path) -> None:
    (tmp_path / "v.mp4").write_text("no video")
    with pytest.raises(InputError, match=r"v\.mp4 cannot be opened.*Copy it from the camera again"):
        open_video(tmp_path / "v.mp4")


def test_a_video_cut_short_gives_the_frames_it_has(film: Path, tmp_path: Path) -> None:
    whole = film.read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) * 2 // 3])
    video = open_video(tmp_path / "cut.avi")
    found = take_frames(video, tmp_path / "frames", STEP)
    assert video.num_frames == 100  # as its header claims
    assert 50 < found.num_readable < 80
    assert found.num_kept >= 3


def test_a_video_with_hardly_a_frame_left_is_refused_with_numbers(film: Path, tmp_path: Path) -> None:
    (tmp_path / "cut.avi").write_bytes(film.read_bytes()[: len(film.read_bytes()) // 20])
    with pytest.raises(InputError, match=r"Only 1 frames .* are worth keeping, of \d that can be read"):
        take_frames(open_video(tmp_path / "cut.avi"), tmp_path / "frames", STEP)
