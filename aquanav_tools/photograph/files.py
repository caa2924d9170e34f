"""What a photographed dive leaves in its folder: photos with EXIF or a video, and the truth."""

from __future__ import annotations

import datetime
import json
import shutil
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import ExifTags, Image

from aquanav_tools.photograph.lens import Lens
from aquanav_tools.photograph.options import CameraOptions
from aquanav_tools.photograph.trajectory import Shot
from aquanav_tools.photograph.water import FloatImage
from aquanav_tools.synthetic.caves import SyntheticCave
from aquanav_tools.text_files import read_json
from aquanav_tools.types import Array

VIDEO = "dive.mp4"
TRUTH = "truth.json"
DEPTH_DIR = "truth_depth"
CROP_FACTOR = 5.6
"""Film diagonal over sensor diagonal of the action camera we pretend to be (1/2.3 inch)."""
FIRST_PHOTO = datetime.datetime(2026, 1, 1, 10, 0, 0)
LAST_NUMBER = 9999
"""Cameras number files with four digits and start again at 1 (Design rule for Camera File system, JEITA CP-3461)."""


def photo_names(count: int, first_number: int | None) -> list[str]:
    """Return the names of the photos in the order they are taken."""
    if first_number is None:
        return [f"dive_{index + 1}.jpg" for index in range(count)]
    return [f"IMG_{(first_number - 1 + index) % LAST_NUMBER + 1:04d}.JPG" for index in range(count)]


def clear(folder: Path) -> None:
    """Make the folder, and delete from it what an earlier dive wrote there."""
    folder.mkdir(parents=True, exist_ok=True)
    truth = folder / TRUTH
    if truth.exists():
        for camera in read_json(truth)["cameras"]:
            (folder / Path(camera["name"]).name).unlink(missing_ok=True)
    (folder / VIDEO).unlink(missing_ok=True)
    if (folder / DEPTH_DIR).exists():
        shutil.rmtree(folder / DEPTH_DIR)


def write_photo(path: Path, pixels: npt.NDArray[np.uint8], options: CameraOptions, time: float) -> None:
    """Write an (H, W, 3) RGB photo as JPEG with EXIF."""
    Image.fromarray(pixels).save(path, format="JPEG", quality=options.quality, exif=_exif(options, time))


def _exif(options: CameraOptions, time: float) -> Image.Exif:
    """Return what a camera records: itself, its lens, its shutter, and when, to the millisecond."""
    base = ExifTags.Base
    taken = FIRST_PHOTO + datetime.timedelta(milliseconds=round(1000.0 * time))
    exif = Image.Exif()
    exif[base.Make] = "aquanav"
    exif[base.Model] = f"synthetic {options.lens}"
    exif[ExifTags.IFD.Exif] = {
        base.ExposureTime: options.exposure_s,
        base.DateTimeOriginal: taken.strftime("%Y:%m:%d %H:%M:%S"),
        base.SubsecTimeOriginal: f"{taken.microsecond // 1000:03d}",
        base.FocalLength: round(options.equivalent_mm / CROP_FACTOR, 2),
        base.FocalLengthIn35mmFilm: options.equivalent_mm,
    }
    return exif


def write_depth(folder: Path, name: str, depth: FloatImage) -> None:
    """Write a photo's (H, W) depth along the camera's axis, m, NaN where no rock is."""
    (folder / DEPTH_DIR).mkdir(exist_ok=True)
    np.savez_compressed(folder / DEPTH_DIR / f"{Path(name).stem}.npz", depth=depth)


def write_truth(folder: Path, names: list[str], shots: list[Shot], lens: Lens, cave: SyntheticCave) -> None:
    """Write positions.csv, truth.json and the two surfaces."""
    rows = [f"{name},{','.join(f'{c:.4f}' for c in shot.centre)}" for name, shot in zip(names, shots, strict=True)]
    (folder / "positions.csv").write_text("\n".join(["name,x,y,z", *rows]) + "\n")
    truth = {
        "width": lens.width,
        "height": lens.height,
        "model": lens.model,
        "parameters": lens.parameters,
        "focal_px": lens.focal_px,
        "cameras": [_pose(name, shot) for name, shot in zip(names, shots, strict=True)],
    }
    (folder / TRUTH).write_text(json.dumps(truth, indent=1))
    cave.truth.to_trimesh().export(folder / "truth_water.ply")
    cave.mesh.to_trimesh().export(folder / "truth_wall.ply")


def _pose(name: str, shot: Shot) -> dict[str, object]:
    """Return a shot as COLMAP has it (rotation, its quaternion w x y z, translation), with the way the camera moved."""
    return {
        "name": name,
        "time": shot.time,
        "centre": shot.centre.tolist(),
        "cam_from_world": shot.cam_from_world.tolist(),
        "quaternion": quaternion(shot.cam_from_world).tolist(),
        "translation": (-shot.cam_from_world @ shot.centre).tolist(),
        "velocity": shot.velocity.tolist(),
        "spin": shot.spin.tolist(),
    }


def quaternion(rotation: Array) -> Array:
    """Return the (4,) unit quaternion (w, x, y, z), w not negative, of a (3, 3) rotation (Shepperd, 1978)."""
    trace = np.trace(rotation)
    # Row k holds 4 q_k q; the one with the largest q_k is the best conditioned.
    r = rotation
    rows = np.array(
        [
            [1 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], 1 + 2 * r[0, 0] - trace, r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1 + 2 * r[1, 1] - trace, r[1, 2] + r[2, 1]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 + 2 * r[2, 2] - trace],
        ]
    )
    best = rows[np.argmax(np.diag(rows))]
    unit: Array = best / np.linalg.norm(best)
    return unit if unit[0] >= 0 else -unit
