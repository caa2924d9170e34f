"""What the intake can be told. Light to import: the command line is made from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

VIDEO_SUFFIXES = (".mp4", ".mov", ".avi", ".mkv")
Quality = Literal["draft", "standard", "high"]
"""What the photo stages aim at."""


@dataclass(frozen=True)
class IntakeOptions:
    """The camera, what it was housed in, and what is done to its photos."""

    lens: Literal["standard", "fisheye"] = "standard"
    """Fisheye: action cameras in their wide setting, and lenses that see more than about 120 degrees."""
    housing: Literal["none", "flat-port", "dome"] = "none"
    """What was between the lens and the water. Behind a flat port the focal length grows by a third."""
    enhance: Literal["off", "features", "all"] = "off"
    """Equalise local contrast (turbid water, dim light): for the search of features alone, or for depth and colours
    as well."""
    frame_step: float = 0.05
    """Of a video, a frame is kept each time the picture has moved on by this share of its width."""

    def __post_init__(self) -> None:
        if not 0.01 <= self.frame_step <= 0.15:
            raise ValueError(f"frame_step = {self.frame_step} is outside [0.01, 0.15]; beyond it, motion is lost.")
        if self.lens == "fisheye" and self.housing == "flat-port":
            raise ValueError("lens = fisheye behind housing = flat-port: a flat port shows no more than 97 degrees.")
