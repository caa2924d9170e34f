"""Placing a model in the world by everything that is known, as long as it agrees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.diagnosis import Caution
from aquanav_tools.reconstruct.georeference.clues import Anchors, Clue, Ups
from aquanav_tools.reconstruct.georeference.solve import NORMAL_95, Fit, solve, upright_rotation
from aquanav_tools.reconstruct.georeference.weigh import Weighed, weigh
from aquanav_tools.types import Array, Sim3

CAMERA_UP_ERROR = np.deg2rad(15.0)
"""Standard deviation of the cameras' mean up direction; chosen: nobody holds a camera level to better in a cave."""
MAX_SCALE_ERROR = 0.5
"""A source that gives the scale to no better than this, at 95 %, relative, gives none."""
DISAGREE = 9.21
"""Squared normalised difference beyond which two sources disagree: 99 % of chi-squared with two degrees of freedom."""
UNUSED = "unused-scale-source"
"""Code of the caution about a source that says nothing."""
FAR_FROM_ORIGIN = 10_000.0
"""Beyond it coordinates in single precision lose millimetres, m."""


@dataclass(frozen=True, eq=False)
class Georeference:
    """How a model was placed in the world."""

    world_from_sfm: Sim3
    scale_error: float | None
    """95 % interval of the scale, +- relative; None where nothing gave the scale and a unit of the model is kept."""
    up_error_deg: float
    """The up axis is within this of the vertical with 95 % confidence."""
    sources: tuple[dict[str, Any], ...] = ()
    """What each source said, ready for JSON."""
    offset: Array | None = None
    """(3,) what was subtracted from given coordinates to bring them to the origin, m."""
    cautions: tuple[Caution, ...] = ()

    @property
    def statistics(self) -> dict[str, Any]:
        """Figures for the report, ready for JSON."""
        error = self.scale_error
        return {
            "scale_error_percent_95": None if error is None else round(100.0 * error, 3),
            "up_error_deg_95": round(self.up_error_deg, 2),
            "scale_sources": list(self.sources),
            "offset": None if self.offset is None else self.offset.tolist(),
        }


def place(centres: Array, rotations: Array, clues: Sequence[Clue]) -> Georeference:
    """Return where a model lies in the world.

    Sources are weighed by how well each fits the model alone; one that contradicts a better one is left out and
    reported. Up comes from the cameras' mean up direction as far as nothing better gives it. The heading and the
    origin come from the best source of full positions, else the passage runs along x from about the origin.

    Args:
        centres: (N, 3) camera centres in the model.
        rotations: (N, 3, 3) `cam_from_sfm`; camera y points down.
        clues: What is known; none is none.
    """
    prior = cameras_up(rotations)
    weighed, cautions = _weigh_all(clues, prior)
    agreeing, disagreements = _agreeing(weighed)
    ahead = np.linalg.svd(centres - centres.mean(axis=0))[2][0]
    full = [one for one in agreeing if isinstance(one.clue, Anchors) and one.clue.is_full]
    leveled = Fit(1.0, upright_rotation(prior.sfm[0], ahead), np.eye(4), False)
    begin = next((one.alone for one in [*full, *agreeing]), leveled)
    aligned = [(_turned_to(begin, one), one.weights) for one in agreeing]
    fit = solve([*aligned, (prior, np.ones(1))], begin.scale, begin.rotation)
    if not full:
        fit = Fit(fit.scale, upright_rotation(fit.up_in_sfm, ahead), fit.covariance, fit.is_scaled)
    translation, offset = _translation(fit, centres, agreeing, full)
    cautions += disagreements + _cautions(fit, prior)
    return Georeference(
        Sim3(fit.scale, fit.rotation, translation),
        fit.scale_error if fit.is_scaled else None,
        fit.up_error_deg,
        tuple(_figures(one, one in agreeing) for one in weighed),
        offset,
        cautions,
    )


def cameras_up(rotations: Array) -> Ups:
    """Return the mean up direction of cameras with (N, 3, 3) rotations `cam_from_sfm`; camera y points down."""
    up = -rotations[:, 1].mean(axis=0)
    length = max(float(np.linalg.norm(up)), 1e-6)
    # Cameras held every which way cancel out: their mean then says as much less.
    return Ups("cameras' mean up direction", ("all photos",), (up / length)[None], CAMERA_UP_ERROR / length)


def _weigh_all(clues: Sequence[Clue], prior: Ups) -> tuple[list[Weighed], tuple[Caution, ...]]:
    """Return the sources that tell something, the best first, and what is wrong with the others."""
    weighed, cautions = [], []
    for clue in clues:
        try:
            one = weigh(clue, prior)
        except InputError as error:
            cautions.append(Caution(UNUSED, str(error)))
            continue
        if not isinstance(clue, Ups) and one.alone.scale_error > MAX_SCALE_ERROR:
            cautions.append(Caution(UNUSED, _too_vague(one)))
            continue
        weighed.append(one)
        if one.mistakes:
            cautions.append(_doubts(one))
    return sorted(weighed, key=_rank), tuple(cautions)


def _rank(one: Weighed) -> tuple[bool, float]:
    is_up = isinstance(one.clue, Ups)
    return is_up, float(np.trace(one.alone.tilt)) if is_up else one.alone.scale_sigma


def _agreeing(weighed: Sequence[Weighed]) -> tuple[list[Weighed], tuple[Caution, ...]]:
    """Return the sources that do not contradict the best one, and a caution for each of the others."""
    agreeing, cautions = list(weighed[:1]), []
    for one in weighed[1:]:
        sentence = _contradiction(weighed[0], one)
        if sentence:
            cautions.append(Caution("scale-sources-disagree", sentence))
        else:
            agreeing.append(one)
    return agreeing, tuple(cautions)


def _contradiction(best: Weighed, other: Weighed) -> str:
    a, b = best.alone, other.alone
    ratio = b.scale / a.scale
    spread = a.scale_sigma**2 + b.scale_sigma**2
    if not isinstance(best.clue, Ups) and not isinstance(other.clue, Ups) and np.log(ratio) ** 2 > DISAGREE * spread:
        return (
            f"The {other.clue.source} make the model {ratio:.3f} times as large as the {best.clue.source}, which "
            f"agree to {100 * NORMAL_95 * np.sqrt(spread):.1f} % at best: one of them is wrong by more than its own "
            f"scatter tells. The {best.clue.source} are kept. Check sizes, units and names of both."
        )
    up, heading = a.rotation @ b.up_in_sfm, _heading(a, b)[:2, :2]
    tilt = np.array([-up[1], up[0]])
    if up[2] < 0.0 or tilt @ np.linalg.solve(a.tilt + heading @ b.tilt @ heading.T, tilt) > DISAGREE:
        degrees = np.rad2deg(np.arccos(np.clip(up[2], -1.0, 1.0)))
        return (
            f"Up by the {other.clue.source} is {degrees:.1f} degrees off up by the {best.clue.source}, more than both "
            f"are uncertain by. The {best.clue.source} are kept. Check the axes of both."
        )
    return ""


def _turned_to(fit: Fit, one: Weighed) -> Clue:
    """Return a clue with its world turned about z to a common heading: grid, true and magnetic north differ."""
    clue = one.clue
    if not isinstance(clue, Anchors) or not clue.is_full:
        return clue
    return replace(clue, world=clue.world @ _heading(fit, one.alone).T)


def _heading(a: Fit, b: Fit) -> Array:
    """Return the (3, 3) turn about z that brings the world of one fit nearest to that of another."""
    turn = a.rotation @ b.rotation.T
    yaw = np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    return np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])


def _translation(
    fit: Fit, centres: Array, agreeing: Sequence[Weighed], full: Sequence[Weighed]
) -> tuple[Array, Array | None]:
    """Return (3,) where the model's origin goes, and what was subtracted from far coordinates."""
    translation = -fit.scale * fit.rotation @ centres.mean(axis=0)
    for one in [*[one for one in agreeing if one not in full], *full[:1]]:
        if isinstance(one.clue, Anchors):
            known = np.isfinite(one.clue.spread)
            moved = fit.scale * one.clue.sfm.mean(axis=0) @ fit.rotation.T
            translation[known] = (one.clue.world.mean(axis=0) - moved)[known]
    offset = np.round(fit.scale * centres.mean(axis=0) @ fit.rotation.T + translation)
    if np.abs(offset).max() <= FAR_FROM_ORIGIN:
        return translation, None
    return translation - offset, offset


def _figures(one: Weighed, is_used: bool) -> dict[str, Any]:
    has_scale = not isinstance(one.clue, Ups)
    return {
        "source": one.clue.source,
        "items": len(one.clue.labels),
        "left_out": [*one.clue.left_out, *one.doubted],
        "used": is_used,
        "scale": round(one.alone.scale, 6) if has_scale else None,
        "scale_error_percent": round(100 * one.alone.scale_error, 3) if has_scale else None,
        "up_error_deg": round(one.alone.up_error_deg, 3),
        "rms_m": round(one.rms, 4) if isinstance(one.clue, Anchors) else None,
        "misfits_m": one.misfits.round(4).tolist() if isinstance(one.clue, Anchors) else [],
    }


def _too_vague(one: Weighed) -> str:
    fit = f"; they fit the model to {one.rms:.2g} m" if isinstance(one.clue, Anchors) else ""
    return (
        f"The {one.clue.source} give the scale to no better than {100 * one.alone.scale_error:.0f} %{fit}, and were "
        "not used. Names or times may be assigned wrongly, they may count in the wrong direction or cover too little "
        "of the passage. Check them, or give another source of scale."
    )


def _doubts(one: Weighed) -> Caution:
    count, named = len(one.mistakes), ", ".join(one.mistakes[:5])
    given = len(one.clue.labels) + len(one.doubted)
    return Caution(
        "doubtful-scale-items",
        f"{count} of {given} {one.clue.source} contradict the model and the rest and were not "
        f"used: {named}{', ...' if count > 5 else ''}. They may be mistakes. Check them.",
    )


def _cautions(fit: Fit, prior: Ups) -> tuple[Caution, ...]:
    lean = np.rad2deg(np.arccos(np.clip(fit.up_in_sfm @ prior.sfm[0], -1.0, 1.0)))
    if lean <= 3.0 * np.rad2deg(prior.error):
        return ()
    sentence = (
        f"Up as given is {lean:.0f} degrees off the cameras' mean up direction. The axes may be mixed up, or the "
        "photos were rotated after they were taken. Check the picture of the cave."
    )
    return (Caution("up-differs", sentence),)
