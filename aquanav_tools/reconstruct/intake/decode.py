"""Opening image files of all kinds: pictures upright, in 8 bits, of bounded size; damage told as a reason."""

from __future__ import annotations

import contextlib
import math
import struct
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image, UnidentifiedImageError

from aquanav_tools.libraries import require
from aquanav_tools.reconstruct.intake.exif import ORIENTATION_TAG
from aquanav_tools.types import BoolArray

GreyImage = npt.NDArray[np.uint8]
SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".heic", ".heif")
HEIC_SUFFIXES = (".heic", ".heif")
MAX_PIXELS = 50_000_000
"""Larger photos are used at reduced size: features are sought, and depth is found, on far fewer pixels."""
REFUSED_PIXELS = 178_956_970
"""Files that claim more are not decoded at all: Pillow's limit against decompression bombs."""
THUMBNAIL_PX = 400
"""Longer side of the small copies that photos are judged by."""

_TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
"""From the stored picture to the upright one, by the EXIF orientation (EXIF 2.32, tag 0x0112)."""


class UnusableError(Exception):
    """A file is no photo that can be used; the message is a reason without the file's name."""


def load_heic() -> None:
    """Teach Pillow to open HEIC.

    Raises:
        LibraryError: the library for it is not installed.
    """
    require("Opening HEIC photos", "pi_heif", otherwise=", or export the photos as JPEG")
    import pi_heif

    pi_heif.register_heif_opener()


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Image.Image]:
    """Yield an image whose pixels are not decoded yet; damage met in the body is told like that met on opening.

    Raises:
        UnusableError: the file is no image, damaged, or claims too many pixels.
    """
    if path.stat().st_size == 0:
        raise UnusableError("the file is empty")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of large pictures, and of odd tags, which nothing here relies on
            with Image.open(path) as image:
                yield image
    except Image.DecompressionBombError as error:
        raise UnusableError(f"it claims more than {REFUSED_PIXELS / 1e6:.0f} million pixels") from error
    except UnidentifiedImageError as error:
        raise UnusableError("the file holds no picture in a known format") from error
    except (OSError, SyntaxError, ValueError, EOFError, struct.error) as error:  # what Pillow raises for damaged files
        raise UnusableError(f"the file is damaged: {error}") from error


def used_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return the width and height at which a photo is used: its own up to MAX_PIXELS."""
    shrink = min(1.0, math.sqrt(MAX_PIXELS / (size[0] * size[1])))
    return max(1, math.floor(size[0] * shrink)), max(1, math.floor(size[1] * shrink))


def thumbnail(image: Image.Image) -> GreyImage:
    """Return the picture upright in grey, THUMBNAIL_PX along its longer side; reads the file to its last byte."""
    image.draft("L", (THUMBNAIL_PX, THUMBNAIL_PX))  # a JPEG is then decoded at up to an eighth
    small = grey_8_bit(image) if is_deep(image) else image.convert("L")
    small.thumbnail((THUMBNAIL_PX, THUMBNAIL_PX), Image.Resampling.BOX)
    return np.asarray(_turned(small, image))


def upright(image: Image.Image) -> Image.Image:
    """Return the picture upright, in 8 bits, grey or RGB on black where it is transparent, of bounded size."""
    size = used_size(image.size)
    image.draft(None, size)
    image.load()
    if is_deep(image):
        plain = grey_8_bit(image)
    elif has_alpha(image):
        plain = Image.alpha_composite(Image.new("RGBA", image.size, "black"), image.convert("RGBA")).convert("RGB")
    else:
        plain = image if image.mode in ("L", "RGB") else image.convert("RGB")
    if plain.size != size:
        plain = plain.resize(size, Image.Resampling.BOX)
    return _turned(plain, image)


def opacity(image: Image.Image) -> BoolArray | None:
    """Return the (H, W) flags of what `upright` shows that is not transparent; None where nothing can be."""
    if is_deep(image) or not has_alpha(image):
        return None
    alpha = image.convert("RGBA").getchannel("A").resize(used_size(image.size), Image.Resampling.NEAREST)
    return np.asarray(_turned(alpha, image)) > 0


def is_deep(image: Image.Image) -> bool:
    """Return whether grey values have more than 8 bits; colours are cut to 8 as Pillow decodes them."""
    return image.mode.startswith("I") or image.mode == "F"


def has_alpha(image: Image.Image) -> bool:
    """Return whether some of the picture may be transparent."""
    return image.mode in ("LA", "PA", "RGBA", "La", "RGBa") or "transparency" in image.info


def grey_8_bit(image: Image.Image) -> Image.Image:
    """Return grey values of 16 bits, or of floats in [0, 1], in 8 bits, all photos on one scale."""
    values = np.asarray(image, np.float32)
    scale = 255.0 if image.mode == "F" else 1.0 / 257.0
    return Image.fromarray(np.clip(values * scale, 0.0, 255.0).astype(np.uint8))


def _turned(picture: Image.Image, source: Image.Image) -> Image.Image:
    turn = _TURNS.get(source.getexif().get(ORIENTATION_TAG, 1))
    return picture if turn is None else picture.transpose(turn)
