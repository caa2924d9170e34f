"""Photos from a video: the sharpest frame each time the picture has moved on far enough."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.images import MIN_PHOTOS
from aquanav_tools.reconstruct.intake.decode import GreyImage
from aquanav_tools.reconstruct.intake.flow import Flow
from aquanav_tools.reconstruct.intake.sharpness import sharpness
from aquanav_tools.types import Progress, ignore_progress

_LOOKS_PER_SECOND = 10.0
"""Frames looked at; a diver at 0.5 m/s moves 5 cm between them."""
_SMALL_PX = 400
"""Longer side at which frames are judged."""
_WINDOW = 2.0
"""The frame is chosen while the motion since the last one is between 1 and this many steps."""
_QUALITY = 95
_DONE = "done.txt"


@dataclass(frozen=True)
class Video:
    """What a video file says about itself."""

    path: Path
    width: int
    height: int
    frames_per_second: float
    num_frames: int
    """As its header claims; fewer may be readable."""


@dataclass(frozen=True)
class Frames:
    """Frames chosen from a video."""

    folder: Path
    num_kept: int
    num_readable: int
    """Frames of the video that could be decoded."""


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A frame that may be kept."""

    sharpness: float
    index: int
    frame: Any
    small: GreyImage


def open_video(path: Path) -> Video:
    """Return what a video file says about itself, after decoding its first frame.

    Raises:
        InputError: it cannot be opened, or holds no picture.
    """
    import cv2

    reader = _reader(path)
    is_readable, _ = reader.read()
    rate = float(reader.get(cv2.CAP_PROP_FPS))
    count = int(reader.get(cv2.CAP_PROP_FRAME_COUNT))
    size = int(reader.get(cv2.CAP_PROP_FRAME_WIDTH)), int(reader.get(cv2.CAP_PROP_FRAME_HEIGHT))
    if not is_readable or not rate > 0.0:
        raise InputError(
            f"No frame of the video {path} can be decoded. The file is damaged, its recording was not closed, or its "
            "codec is unknown. Copy it from the camera again, or convert it with: ffmpeg -i VIDEO -c:v libx264 out.mp4"
        )
    return Video(path, *size, rate, max(count, 1))


def take_frames(video: Video, folder: Path, step: float, progress: Progress = ignore_progress) -> Frames:
    """Write the frames worth keeping into a folder as photos named by their time, and return how many there are.

    The motion between frames is the median displacement of corners followed by optical flow. Once it exceeds `step`,
    frames compete; the sharpest of those before twice that motion is kept. A second call takes up where a killed one
    stopped: frames depend on the last one kept alone.

    Args:
        video: From `open_video`.
        folder: It belongs to one video and one step.
        step: Motion from one kept frame to the next, as a share of the picture's width.
        progress: Shows the frames looked at.

    Raises:
        InputError: fewer than MIN_PHOTOS frames are worth keeping.
    """
    folder.mkdir(parents=True, exist_ok=True)
    done = folder / _DONE
    if not done.exists():
        kept = sorted(int(path.stem.split("-")[1]) for path in folder.glob("frame-*.jpg"))
        readable = _choose(video, folder, step, kept[-1] if kept else None, progress)
        done.write_text(f"{readable}\n")
    count = len(list(folder.glob("frame-*.jpg")))
    frames = Frames(folder, count, int(done.read_text()))
    if count < MIN_PHOTOS:
        raise InputError(
            f"Only {count} frames of the video {video.path} are worth keeping, of {frames.num_readable} that can be "
            f"read: the camera hardly moves, or the file ends early (its header promises {video.num_frames} frames). "
            "Film while swimming, or copy the file from the camera again."
        )
    return frames


def _choose(video: Video, folder: Path, step: float, last: int | None, progress: Progress) -> int:
    """Write the frames after a last kept one, and return how many frames can be read."""
    stride = max(1, round(video.frames_per_second / _LOOKS_PER_SECOND))
    flow: Flow | None = None
    best: _Candidate | None = None
    index = -1
    for index, frame in _read(video, stride, last or 0):
        progress(min(index, video.num_frames), video.num_frames)
        if frame is None:
            continue
        small = _small(frame)
        if flow is None and last is None:
            _write(frame, video, index, folder)
        if flow is None or flow.is_blind:
            flow = Flow(small)
            continue
        motion = flow.motion_to(small) / step
        if best is not None and motion > _WINDOW:
            _write(best.frame, video, best.index, folder)
            flow = Flow(best.small)
            motion = flow.motion_to(small) / step
            best = None
        candidate = _Candidate(sharpness(small), index, frame, small)
        if motion >= 1.0 and (best is None or candidate.sharpness > best.sharpness):
            best = candidate
    if best is not None:
        _write(best.frame, video, best.index, folder)
    return index + 1


def _read(video: Video, stride: int, first: int) -> Iterator[tuple[int, Any]]:
    """Yield the number of each frame, and every `stride`-th one from a first one on itself, else None.

    Frames are counted rather than sought: seeking is exact for few codecs.
    """
    reader = _reader(video.path)
    index = 0
    while reader.grab():
        is_looked_at = index >= first and (index - first) % stride == 0
        yield index, reader.retrieve()[1] if is_looked_at else None
        index += 1


def _reader(path: Path) -> Any:
    import cv2

    reader = cv2.VideoCapture(str(path))
    if not reader.isOpened():
        raise InputError(
            f"The video {path} cannot be opened. The file is damaged, or its recording was not closed (the camera ran "
            "out of power?). Copy it from the camera again, or repair it with the camera maker's tool."
        )
    return reader


def _small(frame: Any) -> GreyImage:
    import cv2

    scale = _SMALL_PX / max(frame.shape[:2])
    size = (max(1, round(frame.shape[1] * scale)), max(1, round(frame.shape[0] * scale)))
    grey: GreyImage = cv2.cvtColor(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY)
    return grey


def _write(frame: Any, video: Video, index: int, folder: Path) -> None:
    """Write a frame under its number and time; the number comes first, so that names sort by it."""
    import cv2

    seconds = index / video.frames_per_second
    path = folder / f"frame-{index:06d}-{int(seconds // 60):02d}m{seconds % 60:06.3f}s.jpg"
    unfinished = path.with_name(f"unfinished-{path.name}")
    _, encoded = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    unfinished.write_bytes(encoded.tobytes())  # OpenCV's own writer ignores a full disk
    os.replace(unfinished, path)
