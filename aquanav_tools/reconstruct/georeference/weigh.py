"""How well one source fits the model alone, and what that says of its errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.georeference.clues import Anchors, Clue, Ups
from aquanav_tools.reconstruct.georeference.solve import NORMAL_95, Fit, descend, information, solve, start
from aquanav_tools.types import Array, BoolArray

FAR_OFF = 4.5
"""Standard deviations beyond which an item is taken for a mistake; one sound item in 100,000 is that far off."""
MISTAKE_SHARE, MISTAKE_METRES = 0.01, 0.1
"""A place that is left out is a mistake to tell of when it is off by more than this share of what the places cover, or
by this much. Where the others agree to a millimetre, one a centimetre off is left out too, and nobody need check it: it
was rounded, or that photo lies a little off in the model. Names mixed up or digits mistyped move places by far more."""
CAUCHY = 2.385
"""Tuning constant of the Cauchy weights (95 % efficient for normal errors; Holland and Welsch, 1977)."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """One source with errors found from how it fits alone."""

    clue: Clue
    """Without the doubted items."""
    doubted: tuple[str, ...]
    """Labels of the items that were left out, since they fit far worse than the rest."""
    mistakes: tuple[str, ...]
    """Those of them that are worth a warning."""
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

    @property
    def misfits(self) -> Array:
        """(N,) length of each item's residual, in their unit."""
        ones = np.ones(len(self.clue.labels))
        lengths: Array = np.linalg.norm(self.clue.residuals(self.alone.scale, self.alone.rotation, ones), axis=1)
        return lengths


def weigh(clue: Clue, prior: Ups) -> Weighed:
    """Return a source with what contradicts the rest left out and the errors of the rest.

    Args:
        clue: The source.
        prior: How the photographer held the camera: settles what the source leaves open.

    Raises:
        InputError: it has too few items to tell their errors, or the model does not fit them.
    """
    weights, sigma = np.ones(len(clue.labels)), _first_sigma(clue)
    scale, rotation = start(clue, prior)
    for _ in range(30):
        scale, rotation = descend([(clue, weights / sigma**2), (prior, np.ones(1))], scale, rotation, 3)
        residuals = clue.residuals(scale, rotation, weights)
        lengths = np.linalg.norm(residuals, axis=1)
        before, sigma = sigma, _robust_sigma(clue, lengths, residuals.shape[1])
        weights = 1.0 / (1.0 + (lengths / (CAUCHY * sigma)) ** 2)
        if abs(before - sigma) <= 1e-3 * sigma:
            break
    keep: BoolArray = lengths <= FAR_OFF * sigma
    kept, doubted = clue.only(keep), clue.only(~keep).labels
    mistakes = clue.only(~keep & (lengths > _harmless(clue))).labels
    return _calibrate(kept, doubted, mistakes, prior, scale, rotation, sigma)


def _harmless(clue: Clue) -> float:
    """Return the length of a residual below which an item, left out or not, is no mistake to tell of."""
    if not isinstance(clue, Anchors):
        return 0.0  # their errors were stated beforehand: to be far outside of them is a mistake
    # Between quartiles, so that no mistake widens it; half of what is evenly spread lies there.
    covered = 2.0 * float(np.linalg.norm(np.subtract(*np.percentile(clue.world[:, clue.known], [75, 25], axis=0))))
    return min(MISTAKE_SHARE * covered, MISTAKE_METRES)


def _calibrate(
    clue: Clue,
    doubted: tuple[str, ...],
    mistakes: tuple[str, ...],
    prior: Ups,
    scale: float,
    rotation: Array,
    sigma: float,
) -> Weighed:
    """Return the source with the standard deviation that makes its residuals what they are."""
    from scipy.stats import t

    ones = np.ones(len(clue.labels))
    for _ in range(4):
        sources = [(clue, ones / sigma**2), (prior, np.ones(1))]
        fit = solve(sources, scale, rotation)
        scale, rotation = fit.scale, fit.rotation
        residuals = clue.residuals(scale, rotation, ones)
        taken = float(np.trace(fit.covariance @ information(clue, ones / sigma**2, scale, rotation)))
        freedom = residuals.size - clue.num_offsets - taken
        if clue.is_error_known:
            sigma = max(1.0, float(np.sqrt((residuals**2).sum() / max(freedom, 1.0))))
        else:
            _require_freedom(clue, freedom, doubted)
            sigma = max(float(np.sqrt((residuals**2).sum() / freedom)), _tiny(clue))
    if not clue.is_error_known:
        sigma *= float(t.ppf(0.975, freedom)) / NORMAL_95 * np.sqrt(_drift_factor(residuals))
    fit = solve([(clue, ones / sigma**2), (prior, np.ones(1))], scale, rotation)
    return Weighed(clue, doubted, mistakes, sigma, float(np.sqrt((residuals**2).sum(axis=1).mean())), fit)


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
