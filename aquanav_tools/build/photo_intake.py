"""From what the user hands in, a folder of photos or a video, to photos that are worth hours of work."""

from __future__ import annotations

import dataclasses
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.machine import free_memory
from aquanav_tools.provenance import file_hash
from aquanav_tools.reconstruct.images import PhotoSet, read_photos
from aquanav_tools.reconstruct.intake.forecast import check_disk, check_memory, forecast
from aquanav_tools.reconstruct.intake.options import VIDEO_SUFFIXES
from aquanav_tools.reconstruct.intake.preflight import preflight
from aquanav_tools.reconstruct.intake.video import open_video, take_frames
from aquanav_tools.reconstruct.reconstruction import ReconstructOptions


@dataclass(frozen=True)
class Intake:
    """What a build from photos begins with."""

    photos: PhotoSet
    inputs: dict[str, str]
    """Hash of every file handed in."""
    facts: dict[str, Any]
    """For the report."""


def take_in(options: BuildOptions, settings: ReconstructOptions, work_dir: Path, journal: Journal) -> Intake:
    """Return the photos of a folder, or the frames of a video, judged and with a forecast announced.

    Args:
        options: Of the build.
        settings: Of the photo stages, for the forecast.
        work_dir: Where frames of a video are kept.
        journal: Is warned of what is wrong with which photos.

    Raises:
        InputError: there are too few usable photos, or the video cannot be read.
        ResourceError: the machine has no memory, or the disk no room, for the work.
    """
    inputs: dict[str, str] = {}
    facts: dict[str, Any] = {}
    folder = options.input
    if options.input.suffix.lower() in VIDEO_SUFFIXES and options.input.is_file():
        inputs[options.input.name] = file_hash(options.input)
        folder, facts["video"] = _frames(options, work_dir / f"frames-{inputs[options.input.name][:16]}", journal)
    with journal.stage("Reading the photos") as progress:
        read = dataclasses.replace(read_photos(folder, progress), intake=options.intake)
    with journal.stage("Looking at the photos") as progress:
        found = preflight(read, progress)
    inputs |= {name: file_hash(found.photos.path(name)) for name in found.photos.names}
    for caution in found.cautions:
        journal.warn(caution.code, caution.message)
        journal.announce(f"Look ({caution.code}): {caution.message}")
    expected = forecast(found.photos, settings.features, settings.matching, settings.depth)
    journal.announce(f"{len(found.photos.photos)} photos, {options.quality} quality. {expected}")
    check_memory(expected, free_memory())
    check_disk(expected, shutil.disk_usage(_existing(work_dir)).free, work_dir)
    facts["forecast"] = dataclasses.asdict(expected)
    facts["left_out"] = [dataclasses.asdict(one) for one in found.photos.left_out]
    facts["preflight"] = [dataclasses.asdict(finding) for finding in found.findings]
    return Intake(found.photos, inputs, facts)


def _frames(options: BuildOptions, folder: Path, journal: Journal) -> tuple[Path, dict[str, Any]]:
    video = open_video(options.input)
    folder = folder.with_name(f"{folder.name}-{options.intake.frame_step:g}")
    with journal.stage("Choosing frames of the video") as progress:
        frames = take_frames(video, folder, options.intake.frame_step, progress)
    if frames.num_readable < 0.98 * video.num_frames:
        journal.warn(
            "short-video",
            f"Only {frames.num_readable} of the {video.num_frames} frames that {video.path.name} promises can be read; "
            "the rest is missing. The file may be cut short: copy it from the camera again.",
        )
    facts = {"frames_kept": frames.num_kept, "frames_readable": frames.num_readable, "frames": video.num_frames}
    return folder, facts


def _existing(folder: Path) -> Path:
    """Return a folder, or the nearest one above it that exists."""
    return next(path for path in (folder, *folder.resolve().parents) if path.is_dir())
