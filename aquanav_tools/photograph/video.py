"""Files of moving pictures: videos for players and for browsers, and animated pictures for pages that show no video."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from PIL import Image

from aquanav_tools.errors import ResourceError
from aquanav_tools.libraries import require

CODECS = {
    ".mp4": ("libx264", {"preset": "ultrafast", "crf": "20"}),
    ".webm": ("libvpx", {"deadline": "realtime", "cpu-used": "16"}),
}
"""By suffix: H.264, and VP8, which every browser shows. Their fastest options: half of the time that the next ones
take, and 1 to 2 dB more noise."""
BITS_PER_PIXEL = 1.0
"""Of VP8: with its own default rock dissolves; and with a quality instead, it takes five times as long."""
WEBP_QUALITY = 60
"""Of animated WebP, up to 100."""


class VideoFile:
    """An MP4 or a WebM; use it as a context."""

    def __init__(self, path: Path, frames_per_second: float, size: tuple[int, int]) -> None:
        """Open the file for frames of a size, px, of which an odd side gets its last row or column twice."""
        require("A film as MP4 or WebM", "av", otherwise=", or make it a .webp or .gif")
        import av

        codec, options = CODECS[path.suffix.lower()]
        rate = Fraction(frames_per_second).limit_denominator(1000)
        self._path, self._odd = path, (size[1] % 2, size[0] % 2)
        with self._explained():
            self._file = av.open(str(path), "w")
            self._stream = cast("Any", self._file.add_stream(codec, rate, options=options))
            self._stream.width, self._stream.height = size[0] + self._odd[1], size[1] + self._odd[0]
            self._stream.pix_fmt = "yuv420p"
            self._stream.thread_count = 1  # several wait for each other; and one gives the same bytes on every machine
            if codec == "libvpx":
                self._stream.bit_rate = round(BITS_PER_PIXEL * size[0] * size[1] * frames_per_second)
            self._file.start_encoding()

    def __enter__(self) -> VideoFile:
        return self

    def write(self, pixels: npt.NDArray[np.uint8]) -> None:
        """Add an (H, W, 3) RGB frame.

        Raises:
            ResourceError: it cannot be written.
        """
        import av

        even = np.pad(pixels, ((0, self._odd[0]), (0, self._odd[1]), (0, 0)), mode="edge") if any(self._odd) else pixels
        with self._explained():
            self._file.mux(self._stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(even), "rgb24")))

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        with self._explained():
            if error is None:
                self._file.mux(self._stream.encode())
            self._file.close()

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        import av

        try:
            yield
        except (av.FFmpegError, av.codec.codec.UnknownCodecError, OSError) as cause:
            codec, _ = CODECS[self._path.suffix.lower()]
            raise ResourceError(
                f"The video {self._path} cannot be written: {cause}. The folder may be full or read-only, or this PyAV "
                f"({av.__version__}) was built without {codec}: install the wheel of av, or make a .webp or .gif."
            ) from cause


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
