"""Photos of a synthetic cave, with everything that is true about them written beside them."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from aquanav_tools.cave.synthetic.caves import SyntheticCave
from aquanav_tools.reconstruct.capture import Camera, CaptureOptions, plan_capture
from aquanav_tools.reconstruct.images import (
    EXIF_IFD,
    FILM_DIAGONAL_MM,
    FOCAL_LENGTH_35MM_TAG,
    FOCAL_LENGTH_TAG,
    PhotoSet,
    read_photos,
)
from aquanav_tools.types import Array, Mesh, Progress, ignore_progress

_CROP_FACTOR = 5.6
"""Film diagonal over sensor diagonal of the action camera we pretend to be (1/2.3 inch)."""
_ABSORPTION = np.array([0.22, 0.06, 0.05])
"""Of clear cave water for red, green and blue, 1/m (order of Smith and Baker, 1981, for the clearest waters)."""
_VEIL = 0.0012


@dataclass(frozen=True)
class RenderOptions:
    """The camera, its lamp and the way it is carried."""

    width: int = 960
    """px."""
    height: int = 720
    """px."""
    focal_35mm: int = 16
    """Focal length, as on 35 mm film, mm; 16 sees 95 degrees across in a 4:3 photo."""
    noise: float = 1.0
    """Sensor noise, relative to a small camera's in lamp light."""
    seed: int = 0
    """Picks texture and noise."""
    capture: CaptureOptions = field(default_factory=CaptureOptions)

    def __post_init__(self) -> None:
        if min(self.width, self.height) < 64 or self.focal_35mm < 1 or self.noise < 0:
            raise ValueError(
                f"RenderOptions needs a size of 64 px or more, a focal length and no negative noise: {self}."
            )

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return float(self.focal_35mm * np.hypot(self.width, self.height) / FILM_DIAGONAL_MM)


class RayScene:
    """A mesh that rays can be shot at."""

    def __init__(self, mesh: Mesh) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        solid = mesh.to_trimesh()
        self._normals = np.asarray(solid.vertex_normals, dtype=np.float32)
        self._faces = mesh.faces
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, mesh.triangles.astype(np.float32))

    def cast(self, origin: Array, rays: Array) -> tuple[Array, Array]:
        """Return (N,) how many times each (N, 3) ray fits to the first hit (NaN without), and (N, 3) smooth normals."""
        origins = np.broadcast_to(origin.astype(np.float32), rays.shape)
        hit = self._scene.run(np.ascontiguousarray(origins), rays.astype(np.float32), output=1)
        is_hit = hit["primID"] >= 0
        corners = self._faces[np.where(is_hit, hit["primID"], 0)]
        u, v = hit["u"][:, None], hit["v"][:, None]
        normals = (1.0 - u - v) * self._normals[corners[:, 0]]
        normals += u * self._normals[corners[:, 1]] + v * self._normals[corners[:, 2]]
        return np.where(is_hit, hit["tfar"], np.nan).astype(np.float64), normals.astype(np.float64)


def render_photos(
    cave: SyntheticCave, folder: Path, options: RenderOptions, progress: Progress = ignore_progress
) -> PhotoSet:
    """Write photos of the cave into a folder and return them.

    Beside them lie `positions.csv` (name, x, y, z of the camera in metres, as a survey would give) and `truth.json`
    (camera matrix and poses).
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("dive_*.jpg"):
        old.unlink()
    cameras = plan_capture(cave.centreline, options.capture)
    names = [f"dive_{index + 1}.jpg" for index in range(len(cameras))]
    scene = RayScene(cave.mesh)
    for index, (name, camera) in enumerate(zip(names, cameras, strict=True)):
        light = _photograph(scene, camera, options)
        rng = np.random.default_rng([options.seed, index])
        Image.fromarray(_develop(light, options.noise, rng)).save(folder / name, quality=92, exif=_exif(options))
        progress(index + 1, len(cameras))
    _write_truth(folder, names, cameras, options)
    return read_photos(folder)


def pixel_rays(width: int, height: int, focal_px: float) -> Array:
    """Return (H * W, 3) rays of depth 1 in the camera frame through the pixel centres, row by row."""
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([(u - width / 2) / focal_px, (v - height / 2) / focal_px, np.ones_like(u)], axis=-1)
    return rays.reshape(-1, 3)


def _photograph(scene: RayScene, camera: Camera, options: RenderOptions) -> npt.NDArray[np.float32]:
    """Return the (H, W, 3) light on the sensor."""
    from aquanav_tools.reconstruct.shading import shade

    rays = pixel_rays(options.width, options.height, options.focal_px) @ camera.cam_from_world
    depth, normals = scene.cast(camera.centre, rays)
    points = camera.centre + rays * depth[:, None]
    # Normals of the cave point out of the water; light comes from within.
    right, down, ahead = camera.cam_from_world
    lamp = camera.centre + 0.12 * right - 0.12 * down
    angle = 1.0 / options.focal_px
    light = shade(points, -normals, lamp, ahead, angle, _ABSORPTION, _VEIL, options.seed)
    image: npt.NDArray[np.float32] = light.reshape(options.height, options.width, 3)
    return image * _vignette(options.width, options.height)


def _vignette(width: int, height: int) -> npt.NDArray[np.float32]:
    """Return (H, W, 1) how much of the light passes the lens: less towards the corners."""
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    return (1.0 - 0.2 * (x * x + y * y))[..., None].astype(np.float32)


def _develop(light: npt.NDArray[np.float32], noise: float, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """Return the photo: exposed for the middle tones, with sensor noise, highlights rolled off, gamma 2.2."""
    exposed = light * (0.2 / np.percentile(light, 65))
    exposed = exposed / (1.0 + 0.4 * exposed)
    grain = rng.standard_normal(exposed.shape, dtype=np.float32) * np.sqrt(1e-5 + 2e-4 * exposed)
    developed = np.clip(exposed + noise * grain, 0.0, 1.0) ** (1.0 / 2.2)
    return (255.0 * developed + 0.5).astype(np.uint8)


def _exif(options: RenderOptions) -> Image.Exif:
    exif = Image.Exif()
    exif[EXIF_IFD] = {
        FOCAL_LENGTH_TAG: round(options.focal_35mm / _CROP_FACTOR, 2),
        FOCAL_LENGTH_35MM_TAG: options.focal_35mm,
    }
    return exif


def _write_truth(folder: Path, names: list[str], cameras: list[Camera], options: RenderOptions) -> None:
    rows = [
        f"{name},{','.join(f'{c:.4f}' for c in camera.centre)}" for name, camera in zip(names, cameras, strict=True)
    ]
    (folder / "positions.csv").write_text("\n".join(["name,x,y,z", *rows]) + "\n")
    truth = {
        "width": options.width,
        "height": options.height,
        "focal_px": options.focal_px,
        "cameras": [
            {"name": name, "centre": camera.centre.tolist(), "cam_from_world": camera.cam_from_world.tolist()}
            for name, camera in zip(names, cameras, strict=True)
        ],
    }
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))
