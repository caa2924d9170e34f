"""Photos or a video of a synthetic cave, with everything that is true about them written beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aquanav_tools.photograph import files
from aquanav_tools.photograph.lens import Lens, make_lens
from aquanav_tools.photograph.options import DiveOptions
from aquanav_tools.photograph.scene import SmoothScene
from aquanav_tools.photograph.sensor import blur_by_motion, develop, image_motion, moving_points, vignette
from aquanav_tools.photograph.trajectory import Shot, plan_capture
from aquanav_tools.photograph.video import VideoFile
from aquanav_tools.photograph.water import FloatImage, blur_ahead, transmission, veil_image
from aquanav_tools.synthetic.caves import SyntheticCave
from aquanav_tools.types import Array, Mesh, Progress, ignore_progress


class Photographer:
    """A cave (normals out of the water), a camera and a lamp: takes one photo after the other."""

    def __init__(self, cave: Mesh, options: DiveOptions) -> None:
        self._scene, self._options = SmoothScene(cave), options
        self.lens: Lens = make_lens(options.camera)
        self._rays = self.lens.rays()
        self._vignette = vignette(self.lens)

    def expose(self, shot: Shot) -> tuple[FloatImage, FloatImage]:
        """Return the (H, W, 3) light on the sensor and the (H, W) depth along the camera's axis, m (NaN: no rock)."""
        size = (self.lens.height, self.lens.width)
        rays = self._rays @ shot.cam_from_world
        distance, normals = self._scene.cast(shot.centre, rays)
        points = shot.centre + rays * distance[:, None]
        light = self._light(shot, points, normals, distance)
        seen = moving_points(self._rays, distance)
        motion = image_motion(self.lens, shot, seen, self._options.camera.exposure_s)
        light = blur_by_motion(light, motion.reshape(*size, 2)) * self._vignette
        return light, (distance * self._rays[:, 2]).reshape(size).astype(np.float32)

    def _light(self, shot: Shot, points: Array, normals: Array, distance: Array) -> FloatImage:
        """Return the (H, W, 3) light that reaches the lens from (H * W, 3) points; NaN where it looks out."""
        from aquanav_tools.photograph.rock import beam, shade

        options, size = self._options, (self.lens.height, self.lens.width)
        right, down, ahead = shot.cam_from_world
        lamp = shot.centre + options.lamp.right * right - options.lamp.up * down
        # Normals of the cave point out of the water; light comes from within.
        light = shade(points, -normals, lamp, ahead, 1.0 / self.lens.focal_px, options.texture, options.seed)
        from_lamp = points - lamp
        way = distance + np.sqrt(np.einsum("ij,ij->i", from_lamp, from_lamp))
        light *= np.nan_to_num(transmission(way, options.water))
        image = blur_ahead(light.reshape(*size, 3), distance.reshape(size), options.water, self.lens.focal_px)
        veil = beam(self._rays[:, 2]).astype(np.float32)[:, None] * veil_image(
            distance, options.water, options.lamp.separation
        )
        return (image + veil.reshape(image.shape)) * np.float32(options.lamp.power)


def photograph(
    cave: SyntheticCave,
    folder: Path,
    options: DiveOptions,
    progress: Progress = ignore_progress,
    *,
    with_depth: bool = False,
) -> list[Path]:
    """Write photos of the cave into a folder and return them in the order they were taken.

    Beside them lie `positions.csv` (name, x, y, z of the camera in metres, as a survey would give), `truth.json`
    (lens, poses, times), `truth_water.ply` (the closed water), `truth_wall.ply` (the wall that can be seen), and in
    `truth_depth` the depth of every photo where asked for. What an earlier dive wrote there is deleted. The same
    options give the same pixels; the bytes of a JPEG depend on Pillow's libjpeg.
    """
    shots = plan_capture(cave.centreline, options.capture)
    names = files.photo_names(len(shots), options.camera.first_number)
    files.clear(folder)
    photographer = Photographer(cave.mesh, options)
    for index, (name, shot) in enumerate(zip(names, shots, strict=True)):
        light, depth = photographer.expose(shot)
        pixels = develop(light, options.camera, np.random.default_rng([options.seed, index]))
        files.write_photo(folder / name, pixels, options.camera, shot.time)
        if with_depth:
            files.write_depth(folder, name, depth)
        progress(index + 1, len(shots))
    files.write_truth(folder, names, shots, photographer.lens, cave)
    return [folder / name for name in names]


def film(cave: SyntheticCave, folder: Path, options: DiveOptions, progress: Progress = ignore_progress) -> Path:
    """Write a video of the cave into a folder and return it; `options.capture.photos` counts its frames.

    The same truth lies beside it as beside photos; frames are called frame_0 and so on. The same options give the
    same pixels; what the encoder makes of them depends on the ffmpeg inside PyAV.

    Raises:
        ValueError: the path has stops, which no video shows.
    """
    if options.capture.path in ("stations", "passes"):
        raise ValueError(f"A video needs one continuous swim, and {options.capture.path} is none.")
    shots = plan_capture(cave.centreline, options.capture)
    names = [f"frame_{index}" for index in range(len(shots))]
    files.clear(folder)
    photographer = Photographer(cave.mesh, options)
    rate = (len(shots) - 1) / (shots[-1].time - shots[0].time)
    with VideoFile(folder / files.VIDEO, rate, (options.camera.width, options.camera.height)) as video:
        for index, shot in enumerate(shots):
            light, _ = photographer.expose(shot)
            video.write(develop(light, options.camera, np.random.default_rng([options.seed, index])))
            progress(index + 1, len(shots))
    files.write_truth(folder, names, shots, photographer.lens, cave)
    return folder / files.VIDEO
