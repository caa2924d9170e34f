"""COLMAP's own command line on the same photos: features, exhaustive matching and incremental mapping on the CPU.

It is no dependency of ours; Debian's package `colmap` has it.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

from aquanav_tools.reconstruct.colmap import load_pycolmap
from eval.child import run_child

SUFFIXES = {".jpg", ".jpeg", ".png", ".tif", ".tiff"}


def run_colmap(photos: Path, folder: Path, timeout: float) -> dict[str, Any]:
    """Return what COLMAP makes of a folder of photos with its defaults and one camera for all, and what it cost.

    Args:
        photos: a folder; files that are no photos are not handed on.
        folder: where its database and models go.
        timeout: for each of its three steps, s.
    """
    os.environ["QT_QPA_PLATFORM"] = "offscreen"  # its feature extractor asks for a screen even on the CPU
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "models").mkdir(parents=True)
    images = folder / "images"
    images.mkdir()
    for path in sorted(photos.iterdir()):
        if path.suffix.lower() in SUFFIXES:
            (images / path.name).symlink_to(path.resolve())
    source = ["--database_path", str(folder / "database.db")]
    steps = {
        "features": ["feature_extractor", *source, "--image_path", str(images)]
        + ["--ImageReader.single_camera", "1", "--SiftExtraction.use_gpu", "0"],
        "matching": ["exhaustive_matcher", *source, "--SiftMatching.use_gpu", "0"],
        "cameras": ["mapper", *source, "--image_path", str(images), "--output_path", str(folder / "models")],
    }
    result: dict[str, Any] = {"seconds": {}, "cpu_seconds": 0.0, "peak_gb": 0.0}
    for name, arguments in steps.items():
        ended = run_child(["colmap", *arguments], timeout)
        result["seconds"][name] = ended.seconds
        result["cpu_seconds"] += ended.cpu_seconds
        result["peak_gb"] = max(result["peak_gb"], ended.peak_gb)
        if ended.exit_code != 0:
            lines = ended.errors.strip().splitlines() or ["no message"]
            return result | {"outcome": f"{name} ended with {ended.exit_code}: {lines[-1]}", "cameras": []}
    return result | {"outcome": "built", "cameras": _largest(folder / "models")}


def _largest(folder: Path) -> list[dict[str, Any]]:
    """Return the cameras of the largest model, in its own frame."""
    models = [load_pycolmap().Reconstruction(path) for path in sorted(folder.iterdir()) if path.is_dir()]
    if not models:
        return []
    model = max(models, key=lambda model: model.num_reg_images())
    images = [model.images[image_id] for image_id in sorted(model.reg_image_ids())]
    return [
        {
            "name": image.name,
            "centre": image.projection_center().tolist(),
            "cam_from_world": image.cam_from_world().rotation.matrix().tolist(),
        }
        for image in images
    ]
