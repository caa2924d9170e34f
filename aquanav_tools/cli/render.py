"""aquanav render: photos or a video of a synthetic cave, with the truth beside them."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from aquanav_tools.cli.command import NO_TERMINAL
from aquanav_tools.errors import InputError
from aquanav_tools.libraries import require
from aquanav_tools.photograph.conditions import CONDITIONS, Condition, ConditionName
from aquanav_tools.photograph.options import DiveOptions, LensName

if TYPE_CHECKING:
    from aquanav_tools.types import Progress

FRAME_RATE = 5.0
"""Of a video unless --photos says otherwise, 1/s: a swimming diver's pictures a handbreadth apart."""
PHOTOS_ONLY: tuple[ConditionName, ...] = ("wide-steps", "three-passes")
"""No single continuous swim."""


@dataclass(frozen=True)
class Render:
    """Photograph a synthetic cave by lamp light: input for aquanav-build-cave.

    Conditions: clear (the demo: spring water, textured limestone); poor-texture (mud on the walls, a noisy sensor);
    turbid (backscatter, green water); dark (a weak lamp: blur and noise); loop (out along one wall, back along the
    other); forward-only (swims through looking ahead); wide-steps (stations 1.5 m apart); three-passes (three dives).

    The truth lies beside the photos: positions.csv (camera positions, as a survey would give), truth.json (lens,
    poses, times), truth_water.ply (the closed water), truth_wall.ply (the wall that can be seen).
    """

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for the photos or the video, and the truth. An earlier dive in it is deleted."""
    condition: ConditionName = "clear"
    """What the cave, the water and the dive are like."""
    photos: int | None = None
    """How many photos, or frames of a video; by default as many as the condition needs (60 to 105), or 5 frames
    per second."""
    size: str = "960x720"
    """Width and height of a photo, px."""
    lens: LensName = "pinhole"
    """pinhole sees 95 degrees across; fisheye is an action camera that sees 125 (COLMAP's OPENCV_FISHEYE)."""
    video: bool = False
    """Write one MP4, dive.mp4, instead of photos. Where the condition has stations, the diver swims and pans."""
    first_number: int | None = None
    """Name photos as a camera does, from this number: 9998 gives IMG_9998.JPG, IMG_9999.JPG, IMG_0001.JPG."""
    depth: bool = False
    """Also write each photo's true depth, in metres along the camera's axis (truth_depth/*.npz)."""
    seed: int = 0
    """Picks the cave, its rock and the noise; the same seed gives the same photos."""


def run_render(options: Render) -> None:
    """Photograph or film the cave and say what to do with the result."""
    from tqdm import tqdm

    from aquanav_tools.synthetic.caves import CaveOptions, demo_cave

    require("aquanav render", "cv2")
    from aquanav_tools.photograph.dive import film, photograph
    from aquanav_tools.photograph.trajectory import plan_capture

    condition = CONDITIONS[options.condition]
    dive = _dive(options, condition)
    cave = demo_cave(CaveOptions(seed=options.seed, length=condition.cave_length))
    if options.video and options.photos is None:
        seconds = plan_capture(cave.centreline, dive.capture)[-1].time
        dive = replace(dive, capture=replace(dive.capture, photos=round(FRAME_RATE * seconds) + 1))
    with tqdm(unit="frame" if options.video else "photo", disable=NO_TERMINAL) as bar:
        if options.video:
            film(cave, options.out, dive, _shown(bar))
        else:
            photograph(cave, options.out, dive, _shown(bar), with_depth=options.depth)
    size = f"{dive.camera.width} x {dive.camera.height} px"
    if options.video:
        print(f"A video of {dive.capture.photos} frames of {size} lies in {options.out}: {condition.explanation}.")
        return
    print(f"{dive.capture.photos} photos of {size} lie in {options.out}: {condition.explanation}.")
    print(f"Build a scenario from them: aquanav-build-cave {options.out} --positions {options.out / 'positions.csv'}")


def _dive(options: Render, condition: Condition) -> DiveOptions:
    """Return the condition's dive as the command line wants it."""
    if options.video and (options.first_number is not None or options.depth):
        raise InputError("--first-number and --depth are for photos, not for a --video. Leave them out.")
    if options.video and options.condition in PHOTOS_ONLY:
        raise InputError(f"{options.condition} is no single swim that a video could show. Choose another --condition.")
    size = re.fullmatch(r"(\d+)x(\d+)", options.size)
    if size is None:
        raise InputError(f"--size '{options.size}' is no size. Give width and height in pixels, such as 1280x960.")
    dive, capture = condition.dive, replace(condition.dive.capture, seed=options.seed)
    if options.video:
        capture = replace(capture, path="sweep" if capture.path == "stations" else capture.path)
    try:
        if options.photos is not None:
            capture = replace(capture, photos=options.photos)
        width, height = (int(number) for number in size.groups())
        camera = replace(dive.camera, lens=options.lens, width=width, height=height, first_number=options.first_number)
    except ValueError as cause:
        raise InputError(f"{cause} Change --photos, --size or --first-number.") from cause
    return replace(dive, camera=camera, capture=capture, seed=options.seed)


def _shown(bar) -> Progress:  # type: ignore[no-untyped-def]  # tqdm ships no types
    def show(done: int, total: int) -> None:
        bar.total = total
        bar.update(done - bar.n)

    return show
