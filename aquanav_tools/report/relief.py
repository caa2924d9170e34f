"""Shaded cut-away images of a cavity, in parallel projection: no display and no graphics driver needed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aquanav_tools.report.raster import NO_FACE, rasterise
from aquanav_tools.types import Array, Mesh

MAX_PIXELS = 4_000_000
LIGHT = np.array([-0.45, 0.55, 0.70])
"""Direction to the light in the picture's frame (right, up, towards the viewer): from the upper left, as on maps."""
TINTS = np.array([[0.10, 0.32, 0.44], [0.22, 0.50, 0.60], [0.55, 0.74, 0.76], [0.84, 0.89, 0.86]])
"""Colours from the far side of the cave to the near side."""
NUM_TINTS = 1024
"""Shades between them: more than the eye or a byte per channel tell apart."""
MAX_RANKED = 100_000
"""About so many pixels tell how the depths are spread."""


@dataclass(frozen=True, eq=False)
class View:
    """A parallel projection: the picture's axes in the world."""

    right: Array
    """(3,) unit vector that points right in the picture."""
    up: Array
    """(3,) unit vector that points up in the picture, normal to `right`."""

    @property
    def towards(self) -> Array:
        """(3,) unit vector out of the picture, to the viewer."""
        return np.cross(self.right, self.up)

    def project(self, points: Array) -> Array:
        """Return (..., 2) picture coordinates, m, of (..., 3) world points."""
        return np.asarray(points) @ np.stack([self.right, self.up], axis=1)


@dataclass(frozen=True, eq=False)
class Relief:
    """A picture of the inside of a cavity, seen with the side towards the viewer cut away."""

    colours: npt.NDArray[np.float32]
    """(H, W, 4) red, green, blue and opacity in [0, 1]; the first row is the top."""
    extent: tuple[float, float, float, float]
    """Left, right, bottom and top edge in picture coordinates, m."""

    @property
    def width(self) -> float:
        """Metres across."""
        return self.extent[1] - self.extent[0]

    @property
    def height(self) -> float:
        """Metres from bottom to top."""
        return self.extent[3] - self.extent[2]


PLAN = View(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
"""From above, y up the page: north, where the coordinates are those of a map or a survey."""


def plan_and_section(centreline: Array) -> tuple[View, View]:
    """Return the plan (seen from above) and the long section (seen from the side) along a passage's main direction.

    Both share their `right`, the main horizontal direction of the (C, 3) centreline from its first to its last
    point, so that what is above each other on the page is the same place.
    """
    offsets = centreline[:, :2] - centreline[:, :2].mean(axis=0)
    main = np.linalg.svd(offsets, full_matrices=False)[2][0]
    if main @ (centreline[-1, :2] - centreline[0, :2]) < 0.0:
        main = -main
    right = np.array([main[0], main[1], 0.0])
    vertical = np.array([0.0, 0.0, 1.0])
    return View(right, np.cross(vertical, right)), View(right, vertical)


def cut_away(mesh: Mesh, view: View, pixel: float) -> Relief:
    """Return the relief of a closed mesh's inside at `pixel` metres per pixel, coarser beyond MAX_PIXELS pixels."""
    flat = view.project(mesh.vertices)
    low, high = flat.min(axis=0), flat.max(axis=0)
    low, high = low - 2 * pixel, high + 2 * pixel
    pixel = max(pixel, float(np.sqrt(np.prod(high - low) / MAX_PIXELS)))
    width, height = (int(n) for n in np.ceil((high - low) / pixel))
    depths, light = _rasterised(mesh, view, low, pixel, (width, height))
    extent = (low[0], low[0] + width * pixel, low[1], low[1] + height * pixel)
    return Relief(_shade(depths, light), tuple(float(edge) for edge in extent))  # type: ignore[arg-type]


def _rasterised(mesh: Mesh, view: View, low: Array, pixel: float, size: tuple[int, int]) -> tuple[Array, Array]:
    """Return (H, W) height towards the viewer, NaN beside the cave, and how well the wall is lit there, in [0, 1].

    Only faces whose outer side is turned away from the viewer are kept. That cuts the near side away, without the
    second cast from just behind the first hit that would have to guess how far "just behind" is.
    """
    axes = np.stack([view.right, view.up, view.towards], axis=1)
    corners = mesh.triangles @ axes
    inward = np.cross(corners[:, 2] - corners[:, 0], corners[:, 1] - corners[:, 0])
    kept = inward[:, 2] > 0.0
    corners, inward = corners[kept], inward[kept] / np.linalg.norm(inward[kept], axis=1, keepdims=True)
    light = np.clip(inward @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0)
    width, height = size
    corners[..., 0] = (corners[..., 0] - low[0]) / pixel
    corners[..., 1] = height - (corners[..., 1] - low[1]) / pixel
    faces, heights = rasterise(corners, width, height)
    is_hit = faces != NO_FACE
    return np.where(is_hit, heights, np.nan), np.where(is_hit, light[faces], 1.0)


def _shade(depths: Array, light: Array) -> npt.NDArray[np.float32]:
    """Return the (H, W, 4) colours: tint by depth, lit, hollows darker (a depth image minus its blur)."""
    is_hit = np.isfinite(depths)
    share = np.zeros(depths.shape, dtype=np.float32)
    share[is_hit] = _spread(depths[is_hit])
    steps = np.linspace(0.0, 1.0, NUM_TINTS)
    tints = np.stack([np.interp(steps, np.linspace(0.0, 1.0, len(TINTS)), column) for column in TINTS.T], axis=-1)
    tint = tints.astype(np.float32)[(share * (NUM_TINTS - 1)).astype(int)]
    width = 1 + int(0.025 * max(depths.shape))
    blurred = _blur(share, width) / np.maximum(_blur(is_hit.astype(np.float32), width), 1e-6)
    hollow = np.clip(1.0 - 0.9 * (blurred - share), 0.6, 1.15)

    colours = np.zeros((*depths.shape, 4), dtype=np.float32)
    colours[..., :3] = np.clip(tint * ((0.55 + 0.55 * light) * hollow).astype(np.float32)[..., None], 0.0, 1.0)
    colours[..., 3] = is_hit
    return colours


def _blur(image: npt.NDArray[np.float32], width: int) -> npt.NDArray[np.float32]:
    """Return the image under a window of `width` pixels, twice: close to a Gaussian at a cost without the width."""
    from scipy.ndimage import uniform_filter

    blurred: npt.NDArray[np.float32] = uniform_filter(
        uniform_filter(image, width, mode="constant"), width, mode="constant"
    )
    return blurred


def _spread(depths: Array) -> Array:
    """Return (N,) values in [0, 1], half by depth and half by rank, so that a flat floor still shows its shape."""
    some = depths[:: max(1, len(depths) // MAX_RANKED)]
    low, high = np.percentile(some, [1.0, 99.0])
    linear = np.clip((depths - low) / max(high - low, 1e-9), 0.0, 1.0)
    levels = np.quantile(some, np.linspace(0.0, 1.0, 257))
    rank = np.interp(depths, levels, np.linspace(0.0, 1.0, 257))
    spread: Array = 0.5 * linear + 0.5 * rank
    return spread
