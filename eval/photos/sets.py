"""The photo sets of the benchmark: rendered dives whose truth is known, and real photos."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np

from aquanav_tools.photograph.conditions import ConditionName
from aquanav_tools.types import Array
from eval.photos.depth_truth import depth_centres

BASELINE_PHOTOS = 0
"""As many photos as the condition asks for."""


@dataclass(frozen=True)
class PhotoSetCase:
    """One row of the table."""

    name: str
    condition: str = ""
    """Of the rendered dive; empty for real photos."""
    photos: int = BASELINE_PHOTOS
    """Of the rendered dive, when not its condition's number."""
    folder: str = ""
    """Of real photos, within the data folder."""
    images: tuple[str, str] = ("", "*")
    """Sub-folder and pattern of the photos in it."""
    every: int = 1
    """Every so many-th of these photos is taken: frames of a film show more overlap than a build needs."""
    flags: tuple[str, ...] = ("--passage-height", "3")
    """What the command is given beside real photos."""
    reference: Callable[[Path], dict[str, Array]] | None = None
    """Reads (3,) camera centres by photo, in any frame, from the data folder's folder."""
    is_metric: bool = True
    """Whether the reference is in metres."""
    has_depth: bool = False
    """Whether a depth camera's maps lie beside the photos (`depth_truth`)."""
    is_loop: bool = False
    """Whether the last photo shows the place of the first."""


def fountain_centres(folder: Path) -> dict[str, Array]:
    """Return the surveyed camera centres of fountain-P11, m.

    A camera file holds K in three lines, a line of zeros, R in three lines, then the centre.
    """
    return {
        path.name.removesuffix(".camera"): np.array(path.read_text().splitlines()[7].split(), float)
        for path in sorted((folder / "gt_dense_cameras_fullres").glob("*.camera"))
    }


def saharov_centres(folder: Path) -> dict[str, Array]:
    """Return the camera centres of a peer's reconstruction, in its own unit (Bundler v0.3).

    After the header and the two counts each camera takes five lines: focal length and distortion, R in three, t.
    """
    lines = (folder / "cameras.out").read_text().splitlines()
    names = (folder / "ordered_filenames.txt").read_text().split()
    centres = {}
    for index in range(int(lines[1].split()[0])):
        rows = np.array([line.split() for line in lines[3 + 5 * index : 7 + 5 * index]], float)
        centres[names[index]] = -rows[:3].T @ rows[3]
    return centres


RENDERED = tuple(PhotoSetCase(name, condition=name) for name in get_args(ConditionName))
REAL = (
    PhotoSetCase(
        "fountain-P11",
        folder="img_strecha_fountain_p11_half",
        images=("images", "*.jpg"),
        reference=fountain_centres,
    ),
    PhotoSetCase("saharov32", folder="img_saharov32", images=("", "*.JPG"), reference=saharov_centres, is_metric=False),
    PhotoSetCase("workshop", folder="img_workshop", images=("images", "*.jpg")),
    PhotoSetCase(
        "office-corridor",
        folder="img_office_corridor",
        images=("images", "*.jpg"),
        every=2,
        # Partition walls up to where the camera was carried, and no photo of the ceiling.
        flags=("--passage-height", "2.5", "--accept-open"),
        is_loop=True,
    ),
    PhotoSetCase(
        "redkitchen",
        folder="img_redkitchen",
        images=("images", "*.jpg"),
        every=4,
        # Its camera looks into a fifth of all directions, which is refused unless the user says otherwise.
        flags=("--passage-height", "2.5", "--accept-open"),
        reference=depth_centres,
        has_depth=True,
    ),
)
CASES = (*RENDERED, *REAL)
