"""Files of moving pictures: videos for players and for browsers, and animated pictures for pages that show no video."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import numpy as np
import numpy.typing as npt
from PIL import Image

from aquanav_tools.errors import ResourceError
from aquanav_tools.libraries import require, stderr_silenced

CODECS = {".mp4": "mp4v", ".webm": "VP80"}
"""By suffix: MPEG-4 part 2, which players know and browsers do not, and VP8, which browsers show. OpenCV's wheels
encode both everywhere, and H.264 nowhere."""
WEBP_QUALITY = 60
"""Of animated WebP, up to 100."""


class VideoFile:
    """An MP4 or a WebM; use it as a context."""

    def __init__(self, path: Path, frames_per_second: float, size: tuple[int, int]) -> None:
        require("A film as MP4 or WebM", "cv2", otherwise=", or make it a .webp or .gif")
        import cv2

        codec = cv2.VideoWriter.fourcc(*CODECS[path.suffix.lower()])
        with stderr_silenced():  # OpenCV says that it takes WebM's own tag instead of VP80
            self._writer = cv2.VideoWriter(str(path), codec, frames_per_second, size)
        if not self._writer.isOpened():
            raise ResourceError(
                f"OpenCV {cv2.__version__} cannot write the video {path}. The folder may be full or read-only, or "
                "this OpenCV was built without ffmpeg. Install opencv-python-headless, or render photos."
            )

    def __enter__(self) -> VideoFile:
        return self

    def write(self, pixels: npt.NDArray[np.uint8]) -> None:
        """Add an (H, W, 3) RGB frame."""
        self._writer.write(np.ascontiguousarray(pixels[..., ::-1]))

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        self._writer.release()


class AnimationFile:
    """An animated GIF or WebP that repeats for ever; use it as a context. Its frames are kept until it is written."""

    def __init__(self, path: Path, frames_per_second: float) -> None:
        self._path, self._duration_ms = path, 1000.0 / frames_per_second
        self._is_gif = path.suffix.lower() == ".gif"
        self._frames: list[Image.Image] = []

    def __enter__(self) -> AnimationFile:
        return self

    def write(self, pixels: npt.NDArray[np.uint8]) -> None:
        """Add an (H, W, 3) RGB frame; for a GIF it gets 256 colours of its own."""
        frame = Image.fromarray(pixels)
        if self._is_gif:
            # Median cut, the usual way, spends its colours on the rock and loses a hull of few pixels.
            frame = frame.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        self._frames.append(frame)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        if error is not None:
            return
        first, *others = self._frames
        times = {"duration": round(self._duration_ms), "loop": 0, "save_all": True, "append_images": others}
        if self._is_gif:
            # Each frame replaces the one before: differences would show through where the palettes differ.
            first.save(self._path, format="GIF", disposal=1, **times)
        else:
            first.save(self._path, format="WEBP", quality=WEBP_QUALITY, method=4, **times)
