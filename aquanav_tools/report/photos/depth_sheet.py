"""Examples of depth maps: photo, depth, normals and confidence side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.report.figures import INK, MUTED, new_figure, save_figure
from aquanav_tools.types import Array

DPI = 130
WIDTH_IN = 11.0
MARGIN_IN = 0.1
GUTTER_IN = 0.08
HEAD_IN = 0.34
CAPTION_IN = 0.26
FOOT_IN = 0.62
COLUMNS = ("Photo", "Depth", "Normals", "Confidence")
UNSURE = np.array([0.93, 0.95, 0.96])
"""What is drawn where the depth is not trusted."""


@dataclass(frozen=True, eq=False)
class DepthExample:
    """One photo with what was measured in it."""

    name: str
    photo: npt.NDArray[np.uint8]
    """(H, W, 3)."""
    depth: Array
    """(H, W) along the camera's axis, m."""
    normals: Array
    """(H, W, 3) unit, camera frame: x right, y down, z ahead."""
    confidence: Array
    """(H, W) in [0, 1]."""
    is_sure: npt.NDArray[np.bool_]
    """(H, W) where the depth goes into the cloud, as far as one photo tells."""


def draw_depths(examples: Sequence[DepthExample], path: Path) -> None:
    """Write a row per example as a picture; depth shares one scale."""
    cell = (WIDTH_IN - 2 * MARGIN_IN - 3 * GUTTER_IN) / 4
    heights = [cell * example.photo.shape[0] / example.photo.shape[1] for example in examples]
    page = HEAD_IN + sum(heights) + CAPTION_IN * len(examples) + FOOT_IN
    figure = new_figure(WIDTH_IN, page)
    sure = np.concatenate([example.depth[example.is_sure] for example in examples])
    near, far = np.percentile(sure, (1.0, 99.0)) if len(sure) else (0.0, 1.0)
    bottom = page - HEAD_IN
    shown: Any = None
    for row, (example, height) in enumerate(zip(examples, heights, strict=True)):
        bottom -= height
        for column in range(4):
            left = MARGIN_IN + column * (cell + GUTTER_IN)
            axes = figure.add_axes((left / WIDTH_IN, bottom / page, cell / WIDTH_IN, height / page))
            axes.set_axis_off()
            drawn = _draw(axes, example, column, near, far)
            shown = drawn if column == 1 else shown
            if row == 0:
                axes.set_title(COLUMNS[column], loc="left", fontsize=11, color=INK, fontweight="bold", pad=5)
        note = f"{example.name}: a depth for {example.is_sure.mean():.0%} of its pixels"
        figure.text(MARGIN_IN / WIDTH_IN, (bottom - 0.05) / page, note, va="top", fontsize=9, color=MUTED)
        bottom -= CAPTION_IN
    _draw_keys(figure, shown, cell, page)
    save_figure(figure, path, DPI)


def _draw(axes: Any, example: DepthExample, column: int, near: float, far: float) -> Any:
    if column == 0:
        return axes.imshow(example.photo)
    if column == 1:
        axes.set_facecolor(tuple(UNSURE))
        depth = np.ma.masked_where(~example.is_sure, example.depth)
        picture = axes.imshow(depth, cmap="viridis_r", vmin=near, vmax=far, interpolation="nearest")
        axes.imshow(_grey(~example.is_sure), interpolation="nearest")
        return picture
    if column == 2:
        colours = normal_colours(example.normals)
        return axes.imshow(np.where(example.is_sure[..., None], colours, UNSURE), interpolation="nearest")
    return axes.imshow(example.confidence, cmap="cividis", vmin=0.0, vmax=1.0, interpolation="nearest")


def _grey(is_unsure: npt.NDArray[np.bool_]) -> Array:
    return np.dstack([np.broadcast_to(UNSURE, (*is_unsure.shape, 3)), is_unsure.astype(float)])


def normal_colours(normals: Array) -> Array:
    """Return (H, W, 3) colours in [0, 1]: red to the right, green upwards, blue towards the camera."""
    return np.clip(0.5 + 0.5 * normals * np.array([1.0, -1.0, -1.0]), 0.0, 1.0)


def _draw_keys(figure: Any, depth: Any, cell: float, page: float) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    bars = ((1, depth, "depth, m; pale: not trusted"), (3, ScalarMappable(Normalize(0.0, 1.0), "cividis"), None))
    for column, mappable, label in bars:
        left = MARGIN_IN + column * (cell + GUTTER_IN)
        axes = figure.add_axes((left / WIDTH_IN, 0.42 / page, 0.9 * cell / WIDTH_IN, 0.1 / page))
        bar = figure.colorbar(mappable, cax=axes, orientation="horizontal")
        bar.set_label(label or "confidence: likeness to other photos (NCC)", fontsize=9, color=MUTED, labelpad=1)
        bar.outline.set_visible(False)
        axes.tick_params(labelsize=8, colors=INK, length=2, pad=1)
    left = MARGIN_IN + 2 * (cell + GUTTER_IN)
    text = "red: faces right, green: up,\nblue: the camera"
    figure.text(left / WIDTH_IN, 0.5 / page, text, va="top", fontsize=9, color=MUTED)
