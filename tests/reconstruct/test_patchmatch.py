"""PatchMatch against a plane whose depth is known in closed form."""

from __future__ import annotations

import numpy as np

from aquanav_tools.reconstruct.patchmatch import Reference, Search, Sources, match_patches

FOCAL, WIDTH, HEIGHT, DEPTH = 60.0, 64, 48, 2.0


def plane_image(shift_x: float) -> np.ndarray:
    """A camera moved by `shift_x` along x before a textured wall at DEPTH: the same waves, moved by the disparity."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    x = (u - WIDTH / 2) / FOCAL * DEPTH + shift_x
    y = (v - HEIGHT / 2) / FOCAL * DEPTH
    waves = np.sin(13.0 * x + 5.0 * y) + np.sin(7.0 * y - 11.0 * x + 1.0) + np.sin(17.0 * y + 2.0 * x)
    return (0.5 + 0.15 * waves).astype(np.float32)


def test_depth_and_normal_of_a_wall_are_found_from_random_planes(rng: np.random.Generator) -> None:
    matrix = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1.0]])
    offsets = (-0.25, 0.25)
    images = np.stack([plane_image(offset) for offset in offsets])
    turns = np.tile(np.eye(3, dtype=np.float32).reshape(1, 9), (2, 1))
    shifts = np.array([matrix @ [-offset, 0.0, 0.0] for offset in offsets], np.float32)
    sources = Sources(images, np.array([[HEIGHT, WIDTH]] * 2), turns, shifts)
    inverse = np.array([1 / FOCAL, 1 / FOCAL, -WIDTH / 2 / FOCAL, -HEIGHT / 2 / FOCAL], np.float32)
    depth = rng.uniform(1.0, 4.0, (HEIGHT, WIDTH)).astype(np.float32)
    normals = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    normals[..., 2] = -1.0
    search = Search(radius=3, stride=1, best=1, nearest=1.0, farthest=4.0, seed=0)
    cost = match_patches(Reference(plane_image(0.0), inverse), sources, depth, normals, search, iterations=4)
    inside = np.s_[6:-6, 12:-12]
    assert np.median(cost[inside]) < 0.02
    assert np.median(np.abs(depth[inside] - DEPTH)) < 0.02  # a disparity of 7.5 px to a fifteenth of a pixel
    assert np.median(normals[inside][:, :, 2]) < -0.9
