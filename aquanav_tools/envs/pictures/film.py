"""Films: a picture of every state of an episode, with its numbers on it."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from aquanav_tools.errors import InputError
from aquanav_tools.photograph.video import AnimationFile, VideoFile
from aquanav_tools.types import Array, Progress, ignore_progress

FILM_SIZES = {".mp4": (640, 480), ".webm": (400, 300), ".gif": (320, 240), ".webp": (480, 360)}
"""px, by the suffix of a film's file: a frame takes 20 kB but in a GIF, which has no motion compression, 40 kB."""
BAR_SHARE, MIN_BAR = 0.085, 26
"""Height of the bar with the numbers, of the picture's, and at least, px."""
BAR = 0.35
"""How much of the picture shows through the bar."""
INK, LABEL, ALARM = (240, 245, 247), (165, 190, 200), (255, 92, 80)
SHOWN_FOR = 0.5
"""A contact colours its field so long, s."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A moment of an episode, as a film shows it."""

    state: Array
    """(7,) or more: position, m, and quaternion (w, x, y, z), body to world."""
    time: float
    """Since the episode's beginning, s."""
    clearance: float
    """From the hull to the nearest wall, m."""
    num_contacts: int
    """So far."""
    is_touching: bool
    """Whether a contact began or lasted within the last SHOWN_FOR seconds."""
    progress: float
    """Along the way to the goal, m."""
    speed: float
    """Over ground, m/s."""


class Camera(Protocol):
    """Takes the pictures of a film."""

    size: tuple[int, int]
    """Width and height, px."""

    def picture(self, state: Array, time: float) -> npt.NDArray[np.uint8]:
        """Return the (H, W, 3) picture, RGB, of a vehicle at a state at a time, s; times rise from call to call."""


def film_size(path: Path) -> tuple[int, int]:
    """Return width and height of a film for a file, px.

    Raises:
        InputError: there are no films with its suffix, or its folder is not there.
    """
    size = FILM_SIZES.get(path.suffix.lower())
    if size is None:
        *some, last = FILM_SIZES
        raise InputError(
            f"There are no films like {path.name}. Give it a name that ends in {', '.join(some)} or {last}."
        )
    if not path.parent.is_dir():
        raise InputError(f"There is no folder {path.parent} for the film {path.name}. Make it first.")
    return size


def film(
    camera: Camera,
    frames: Sequence[Frame],
    path: Path,
    frames_per_second: float,
    progress: Progress = ignore_progress,
) -> None:
    """Write a film of an episode: MP4 for players, WebM for browsers, GIF or WebP for pages that show no video.

    Raises:
        InputError: the file has another suffix.
        ResourceError: it cannot be written.
    """
    film_size(path)
    unfinished = path.with_name(f"unfinished-{path.name}")
    is_video = path.suffix.lower() in (".mp4", ".webm")
    try:
        with (
            VideoFile(unfinished, frames_per_second, camera.size)
            if is_video
            else AnimationFile(unfinished, frames_per_second)
        ) as file:
            _write(file, camera, frames, progress)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def _write(file: VideoFile | AnimationFile, camera: Camera, frames: Sequence[Frame], progress: Progress) -> None:
    """Write a film's frames; each picture is taken while the one before it is encoded."""
    with ThreadPoolExecutor(1) as encoder:
        writing: Future[None] | None = None
        for index, frame in enumerate(frames):
            picture = annotate(camera.picture(frame.state, frame.time), frame)
            if writing is not None:
                writing.result()
            writing = encoder.submit(file.write, picture)
            progress(index + 1, len(frames))
        if writing is not None:
            writing.result()


def annotate(picture: npt.NDArray[np.uint8], frame: Frame) -> npt.NDArray[np.uint8]:
    """Return an (H, W, 3) picture with a bar at its foot: time, clearance, contacts, progress and speed."""
    height, width = picture.shape[:2]
    bar = max(round(BAR_SHARE * height), MIN_BAR)
    band = Image.fromarray((BAR * picture[height - bar :]).astype(np.uint8))
    small, large = round(0.30 * bar), round(0.46 * bar)
    fields = _fields(frame)
    for number, (label, value, colour) in enumerate(fields):
        left = round((number + 0.18) * width / len(fields))
        band.paste(LABEL, (left, round(0.06 * bar)), _shape(label, small))
        band.paste(colour, (left, round(0.42 * bar)), _shape(value, large))
    return np.concatenate([picture[: height - bar], np.asarray(band)])


@functools.lru_cache(1024)
def _shape(text: str, size: int) -> Image.Image:
    """Return a text's shape, white on black: most of a film's texts come again, and drawing letters takes most time."""
    _, _, right, bottom = _font(size).getbbox(text)
    shape = Image.new("L", (max(math.ceil(right), 1), max(math.ceil(bottom), 1)))
    ImageDraw.Draw(shape).text((0, 0), text, 255, _font(size))
    return shape


def _fields(frame: Frame) -> tuple[tuple[str, str, tuple[int, int, int]], ...]:
    alarm = ALARM if frame.is_touching else INK
    return (
        ("time", f"{frame.time:.1f} s", INK),
        ("clearance", f"{frame.clearance:.2f} m", alarm),
        ("contacts", str(frame.num_contacts), alarm),
        ("progress", f"{frame.progress:.1f} m", INK),
        ("speed", f"{frame.speed:.1f} m/s", INK),
    )


@functools.cache
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(max(size, 9))
