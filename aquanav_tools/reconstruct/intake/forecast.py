"""What a reconstruction will take: time, memory and disk, from rates measured before it starts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from aquanav_tools.errors import ResourceError
from aquanav_tools.machine import free_memory, num_cores
from aquanav_tools.reconstruct.depth import DepthOptions
from aquanav_tools.reconstruct.features import FeatureOptions
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.intake.memory import SIFT_SIDE, shrunk_px, sift_bytes, sift_threads
from aquanav_tools.reconstruct.matching import MatchOptions, expected_pairs
from aquanav_tools.store import MIN_FREE


@dataclass(frozen=True)
class _Rates:
    """CPU seconds, from `stages` in build.json of the demo (65 photos of 960 x 720 px) and of 85 photos at wide steps.

    Two cores of a cloud server that others used too, pycolmap 4.2. An idle desktop takes half of the time.
    """

    features_per_mp: float = 2.5
    """Demo 2.4, wide steps 2.5."""
    pair: float = 0.08
    """At 4096 keypoints per photo, with its verification; it grows with their square. Rendered sets 0.04 to 0.12."""
    mapping_per_photo: float = 0.4
    """One core. Demo 0.31, rendered sets 0.13 to 1.4: the more, the more photos overlap."""
    depth_per_photo: float = 3.0
    """At 480 px and 8 sources; it grows with the pixels and the sources. Demo 3.2."""
    fusion_per_photo: float = 0.4
    """At 480 px. Demo 0.30, rendered sets 0.4 to 0.8."""


_RATES = _Rates()
_BASE_GB = 0.7
"""Libraries, database and fusion."""
_DATABASE_BYTES = 0.75e6
"""Per photo with 4096 keypoints, matches included."""
_DEPTH_BYTES = 33.0
"""Per pixel: depth, normals, both once more in COLMAP's format, and the undistorted photo."""
_COPY_BYTES = 0.9
"""Per pixel of a converted photo."""


@dataclass(frozen=True)
class Forecast:
    """What the photo stages will need on this machine."""

    cores: int
    pairs: int
    seconds: dict[str, float]
    """Wall time of each stage."""
    memory_gb: float
    disk_gb: float

    def __str__(self) -> str:
        stages = ", ".join(f"{name} {_duration(value)}" for name, value in self.seconds.items())
        return (
            f"On {self.cores} cores this takes about {_duration(sum(self.seconds.values()))} ({stages}; {self.pairs} "
            f"pairs), up to {self.memory_gb:.1f} GB of memory and {self.disk_gb:.1f} GB of disk; by measured rates, "
            "right to a factor of two unless the machine is busy. Closing the cave comes on top."
        )


def forecast(photos: PhotoSet, features: FeatureOptions, matching: MatchOptions, depth: DepthOptions) -> Forecast:
    """Return what the reconstruction of a photo set will take."""
    cores = num_cores()
    count = len(photos.photos)
    pairs = expected_pairs(count, matching)
    keypoints = features.max_features / 4096.0
    sizes = [(photo.width, photo.height) for photo in photos.photos]
    sift_px = [shrunk_px(*size, SIFT_SIDE) for size in sizes]
    depth_px = [shrunk_px(*size, depth.width) for size in sizes]
    seconds = {
        "features": sum(sift_px) / 1e6 * _RATES.features_per_mp / cores,
        "matching": pairs * _RATES.pair * keypoints**2 / cores,
        "cameras": count * _RATES.mapping_per_photo,
        "depth": sum(depth_px) / (480 * 360) * _RATES.depth_per_photo * depth.sources / 8 / cores,
        "fusion": sum(depth_px) / (480 * 360) * _RATES.fusion_per_photo / cores,
    }
    memory = _BASE_GB + sift_bytes(sizes, min(sift_threads(sizes, free_memory()), count)) / 1e9
    disk = count * _DATABASE_BYTES * keypoints + sum(depth_px) * _DEPTH_BYTES + _copied_px(photos) * _COPY_BYTES
    return Forecast(cores, pairs, seconds, memory, disk / 1e9)


def check_disk(expected: Forecast, free_bytes: int, folder: Path) -> None:
    """Refuse work that the disk has no room for.

    Raises:
        ResourceError: less is free than the forecast says, with a tenth to spare and what must stay free.
    """
    if free_bytes < 1.1e9 * expected.disk_gb + MIN_FREE:
        raise ResourceError(
            f"The disk under {folder} has {free_bytes / 1e9:.2f} GB free, and the reconstruction will write about "
            f"{expected.disk_gb:.2f} GB; {MIN_FREE / 1e9:.1f} GB must stay free. Make room, write to another disk with "
            "-o, or take fewer photos."
        )


def check_memory(expected: Forecast, free_bytes: int) -> None:
    """Refuse work that the machine has no memory for.

    Raises:
        ResourceError: less is free than the forecast says.
    """
    if free_bytes < 1e9 * expected.memory_gb:
        raise ResourceError(
            f"{free_bytes / 1e9:.1f} GB of memory are free, and the reconstruction will take {expected.memory_gb:.1f} "
            "GB. Large photos need it. Close other programs, or shrink the photos."
        )


def _copied_px(photos: PhotoSet) -> int:
    """Return the pixels of all copies that preparing the photos will write."""
    copies = {"off": 0, "features": 1, "all": 0}[photos.intake.enhance]
    is_copied = photos.intake.enhance == "all"
    return sum(photo.width * photo.height * (copies + (is_copied or not photo.is_plain)) for photo in photos.photos)


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
