"""The similarity that fits observations best, how well each source fits it alone, and what that says of its errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.georeference.clues import Anchors, Clue, Lengths, Ups
from aquanav_tools.types import Array, BoolArray

FAR_OFF = 4.5
"""Standard deviations beyond which an item is taken for a mistake; one sound item in 100,000 is that far off."""
CAUCHY = 2.385
"""Tuning constant of the Cauchy weights (95 % efficient for normal errors; Holland and Welsch, 1977)."""
NORMAL_95 = 1.959964
CHI2_2_95 = 5.991465
MAX_LOG_ERROR = 2.3
"""Uncertainties of the scale beyond a factor of ten are all the same."""
MAX_STEPS = 60
UNSEEN = 1e-12
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


@dataclass(frozen=True, eq=False)
class Weighed:
    """One source with errors found from how it fits alone."""

    clue: Clue
    """Without mistakes."""
    doubted: tuple[str, ...]
    """Labels of the mistakes."""
    sigma: float
    """Standard deviation of its residuals, widened for few items and for errors that run in the same direction."""
    rms: float
    """Root mean square of its residuals, in their unit (m for positions)."""
    alone: Fit
    """What it says without the other sources."""

    @property
    def weights(self) -> Array:
        """(N,) one over the variance of each item."""
        return np.full(len(self.clue.labels), self.sigma**-2)


def weigh(clue: Clue, prior: Ups) -> Weighed:
    """Return a source with its mistakes left out and the errors of the rest.

    Args:
        clue: The source.
        prior: How the photographer held the camera: settles what the source leaves open.

    Raises:
        InputError: it has too few items to tell their errors, or the model does not fit them.
    """
    weights, sigma = np.ones(len(clue.labels)), _first_sigma(clue)
    scale, rotation = start(clue, prior)
    for _ in range(30):
        scale, rotation = _descend([(clue, weights / sigma**2), (prior, np.ones(1))], scale, rotation, 3)
        residuals = clue.residuals(scale, rotation, weights)
        lengths = np.linalg.norm(residuals, axis=1)
        before, sigma = sigma, _robust_sigma(clue, lengths, residuals.shape[1])
        weights = 1.0 / (1.0 + (lengths / (CAUCHY * sigma)) ** 2)
        if abs(before - sigma) <= 1e-3 * sigma:
            break
    keep: BoolArray = lengths <= FAR_OFF * sigma
    kept, doubted = clue.only(keep), clue.only(~keep).labels
    return _calibrate(kept, doubted, prior, scale, rotation, sigma)


def solve(sources: Sequence[tuple[Clue, Array]], scale: float, rotation: Array) -> Fit:
    """Return the best fit of clues with (N,) weights, one over the variance of their residuals, from a start nearby."""
    scale, rotation = _descend(sources, scale, rotation, MAX_STEPS)
    information = np.sum([_information(clue, weights, scale, rotation) for clue, weights in sources], axis=0)
    values, axes = np.linalg.eigh(information)
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


def _calibrate(
    clue: Clue, doubted: tuple[str, ...], prior: Ups, scale: float, rotation: Array, sigma: float
) -> Weighed:
    """Return the source with the standard deviation that makes its residuals what they are."""
    from scipy.stats import t

    ones = np.ones(len(clue.labels))
    for _ in range(4):
        sources = [(clue, ones / sigma**2), (prior, np.ones(1))]
        fit = solve(sources, scale, rotation)
        scale, rotation = fit.scale, fit.rotation
        residuals = clue.residuals(scale, rotation, ones)
        taken = float(np.trace(fit.covariance @ _information(clue, ones / sigma**2, scale, rotation)))
        freedom = residuals.size - clue.num_offsets - taken
        if clue.is_error_known:
            sigma = max(1.0, float(np.sqrt((residuals**2).sum() / max(freedom, 1.0))))
        else:
            _require_freedom(clue, freedom, doubted)
            sigma = max(float(np.sqrt((residuals**2).sum() / freedom)), _tiny(clue))
    if not clue.is_error_known:
        sigma *= float(t.ppf(0.975, freedom)) / NORMAL_95 * np.sqrt(_drift_factor(residuals))
    fit = solve([(clue, ones / sigma**2), (prior, np.ones(1))], scale, rotation)
    return Weighed(clue, doubted, sigma, float(np.sqrt((residuals**2).sum(axis=1).mean())), fit)


def _require_freedom(clue: Clue, freedom: float, doubted: tuple[str, ...]) -> None:
    if freedom < 0.5:
        doubt = f" ({len(doubted)} more contradict them)" if doubted else ""
        raise InputError(
            f"The {clue.source} know only {len(clue.labels)} places in the model{doubt}, which is too few to tell how "
            "good they are. Give more of them, spread over the passage."
        )


def _drift_factor(residuals: Array) -> float:
    """Return by how much errors that run in the same direction for a while widen the variance of means.

    An autoregressive process of first order, its correlation estimated from neighbours: models of long passages bend,
    and a receiver's errors last for minutes. Never below 1.
    """
    if len(residuals) < 8:
        return 1.0
    correlation = float((residuals[1:] * residuals[:-1]).sum() / (residuals**2).sum())
    correlation = float(np.clip(correlation - 2.0 / np.sqrt(residuals.size), 0.0, 0.95))  # beyond chance only
    return (1.0 + correlation) / (1.0 - correlation)


def _first_sigma(clue: Clue) -> float:
    """Return a standard deviation to start from: everything is unexplained yet."""
    if clue.is_error_known:
        return 1.0
    return max(float(np.std(clue.residuals(1e-9, np.eye(3), np.ones(len(clue.labels))))), _tiny(clue))


def _robust_sigma(clue: Clue, lengths: Array, dimensions: int) -> float:
    """Return the standard deviation that makes the median (N,) length of residuals what it is."""
    from scipy.stats import chi

    sigma = float(np.median(lengths) / chi.ppf(0.5, dimensions))
    if clue.is_error_known:
        return max(sigma, 1.0)
    # What is fitted to takes up freedom: with few items residuals are smaller than errors.
    observed = dimensions * len(lengths)
    return max(sigma * np.sqrt(observed / max(observed - dimensions - 4.0, 1.0)), _tiny(clue))


def _tiny(clue: Clue) -> float:
    """Return what rounding alone leaves."""
    return 1e-9 * max(float(np.abs(clue.residuals(1e-9, np.eye(3), np.ones(len(clue.labels)))).max()), 1e-3)


def _descend(
    sources: Sequence[tuple[Clue, Array]], scale: float, rotation: Array, max_steps: int
) -> tuple[float, Array]:
    """Return scale and rotation after some Gauss-Newton steps."""
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


def _information(clue: Clue, weights: Array, scale: float, rotation: Array) -> Array:
    """Return the (4, 4) information of a clue's items."""
    rows = (np.sqrt(weights)[:, None, None] * clue.derivatives(scale, rotation, weights)).reshape(-1, 4)
    information: Array = rows.T @ rows
    return information
