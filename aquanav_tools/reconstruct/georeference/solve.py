"""The scale and the rotation that fit observations best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aquanav_tools.reconstruct.georeference.clues import Anchors, Clue, Lengths, Ups
from aquanav_tools.types import Array

NORMAL_95 = 1.959964
CHI2_2_95 = 5.991465
MAX_LOG_ERROR = 2.3
"""Uncertainties of the scale beyond a factor of ten are all the same."""
MAX_STEPS = 60
UNSEEN = 1e-14
"""Directions with less than this share of the largest information are not determined."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Scale and rotation with their uncertainty."""

    scale: float
    """Metres per unit of the model."""
    rotation: Array
    """(3, 3) of world_from_sfm."""
    covariance: Array
    """(4, 4) of log(scale) and of a turn of the world about x, y, z, rad; zero where nothing tells."""
    is_scaled: bool
    """Whether something tells the scale; it went to zero where depths count in the wrong direction."""

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of the scale, relative; infinite where nothing tells it."""
        return float(np.sqrt(self.covariance[0, 0])) if self.is_scaled else np.inf

    @property
    def scale_error(self) -> float:
        """95 % interval of the scale, +- relative."""
        return float(np.expm1(min(NORMAL_95 * self.scale_sigma, MAX_LOG_ERROR)))

    @property
    def tilt(self) -> Array:
        """(2, 2) covariance of the up axis, rad^2."""
        return self.covariance[1:3, 1:3]

    @property
    def up_error_deg(self) -> float:
        """Radius of the 95 % cone about up, by the longer axis of its error, which errs on the wide side."""
        return float(np.rad2deg(np.sqrt(CHI2_2_95 * np.linalg.eigvalsh(self.tilt)[-1])))

    @property
    def up_in_sfm(self) -> Array:
        """(3,) unit vector."""
        return self.rotation[2]


def solve(sources: Sequence[tuple[Clue, Array]], scale: float, rotation: Array) -> Fit:
    """Return the best fit of clues with (N,) weights, one over the variance of their residuals, from a start nearby."""
    scale, rotation = descend(sources, scale, rotation, MAX_STEPS)
    total = np.sum([information(clue, weights, scale, rotation) for clue, weights in sources], axis=0)
    values, axes = np.linalg.eigh(total)
    seen = values > UNSEEN * values[-1]
    covariance: Array = (axes[:, seen] / values[seen]) @ axes[:, seen].T
    return Fit(scale, rotation, covariance, bool((axes[0, ~seen] ** 2).sum() < UNSEEN))


def start(clue: Clue, prior: Ups) -> tuple[float, Array]:
    """Return a scale and a rotation near those that fit a clue."""
    upright = upright_rotation(prior.sfm[0], np.array([1.0, 0.0, 0.0]))
    if isinstance(clue, Lengths):
        return float(np.median(clue.metres / clue.sfm)), upright
    if not isinstance(clue, Anchors):
        return 1.0, upright
    sfm, world = clue.sfm - clue.sfm.mean(axis=0), clue.world - clue.world.mean(axis=0)
    if not clue.is_full:
        known = np.isfinite(clue.spread)
        return _ratio(world[:, known], (sfm @ upright.T)[:, known]), upright
    pull = world.T @ sfm
    # A little of the cameras' up direction settles the turn about positions that lie on a line.
    pull += 1e-3 * np.linalg.norm(pull, 2) * np.outer([0.0, 0.0, 1.0], prior.sfm[0])
    left, _, right = np.linalg.svd(pull)
    handedness = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    return _ratio(world, sfm), left @ handedness @ right


def upright_rotation(up: Array, ahead: Array) -> Array:
    """Return the (3, 3) rotation that turns `up` to +z and the level part of `ahead` to +x, both (3,)."""
    axes = np.eye(3)[np.argsort(np.abs(up))]
    candidates = [np.cross(up, ahead), np.cross(up, axes[0])]
    level_y = candidates[0] if np.linalg.norm(candidates[0]) > 1e-3 * np.linalg.norm(ahead) else candidates[1]
    level_y = level_y / np.linalg.norm(level_y)
    return np.stack([np.cross(level_y, up), level_y, up])


def _ratio(world: Array, sfm: Array) -> float:
    """Return the ratio of the sizes of two sets of centred values."""
    return max(float(np.linalg.norm(world)), 1e-12) / max(float(np.linalg.norm(sfm)), 1e-12)


def descend(
    sources: Sequence[tuple[Clue, Array]], scale: float, rotation: Array, max_steps: int
) -> tuple[float, Array]:
    """Return scale and rotation after some Gauss-Newton steps towards the best fit, as in `solve`."""
    from scipy.spatial.transform import Rotation

    for _ in range(max_steps):
        rows, misfits = [], []
        for clue, weights in sources:
            factors = np.sqrt(weights)[:, None]
            misfits.append((factors * clue.residuals(scale, rotation, weights)).ravel())
            rows.append((factors[:, :, None] * clue.derivatives(scale, rotation, weights)).reshape(-1, 4))
        step = -np.linalg.lstsq(np.concatenate(rows), np.concatenate(misfits), rcond=1e-9)[0]
        step *= min(1.0, 0.7 / max(np.abs(step).max(), 1e-300))
        scale *= float(np.exp(step[0]))
        rotation = Rotation.from_rotvec(step[1:]).as_matrix() @ rotation
        if np.abs(step).max() < 1e-8:
            break
    return scale, rotation


def information(clue: Clue, weights: Array, scale: float, rotation: Array) -> Array:
    """Return the (4, 4) information of a clue's items with (N,) weights about log(scale) and the turn of the world."""
    rows = (np.sqrt(weights)[:, None, None] * clue.derivatives(scale, rotation, weights)).reshape(-1, 4)
    product: Array = rows.T @ rows
    return product
