"""From the arbitrary frame of structure from motion to the world: metres, z up."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.diagnosis import Caution
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.types import Array, Sim3

MIN_POSITIONS = 3
LINE_SHARE = 0.02
"""Positions that stray less than this share of their extent from a line do not tell which way is up."""


@dataclass(frozen=True)
class GeoreferenceOptions:
    """How camera positions are used."""

    max_error: float = 0.3
    """Positions farther than this from where the model puts the camera are taken for mistakes, m."""
    seed: int = 0
    """Of the robust fit."""

    def __post_init__(self) -> None:
        if not self.max_error > 0:
            raise ValueError(f"max_error = {self.max_error} is not above 0.")


@dataclass(frozen=True, eq=False)
class Georeference:
    """How the model was placed in the world."""

    world_from_sfm: Sim3
    rms: float
    """Distance between believed positions and the model's cameras, root mean square, m; NaN without positions."""
    num_positions: int
    """How many were believed."""
    cautions: tuple[Caution, ...] = ()


def read_positions(path: Path, names: Sequence[str]) -> dict[str, Array]:
    """Return the (3,) camera position in metres of each photo listed in a CSV file with columns name, x, y, z.

    Raises:
        InputError: the file cannot be read, lacks a column, holds something else than finite numbers, names a photo
            twice or one that is not among `names`.
    """
    if not path.is_file():
        raise InputError(
            f"The positions file {path} does not exist. Give a CSV file with columns name, x, y, z in metres."
        )
    with path.open(newline="", encoding="utf-8-sig") as stream:
        table = csv.DictReader(stream, skipinitialspace=True)
        lacking = {"name", "x", "y", "z"} - set(table.fieldnames or ())
        if lacking:
            raise InputError(
                f"{path} lacks the columns {', '.join(sorted(lacking))}; its first line is {table.fieldnames}. "
                "The first line must be: name,x,y,z"
            )
        positions: dict[str, Array] = {}
        for row in table:
            name = row["name"]
            if name not in names:
                raise InputError(
                    f"{path}, line {table.line_num}: no photo is called '{name}'.{did_you_mean(name, names)}"
                )
            if name in positions:
                raise InputError(f"{path}, line {table.line_num}: '{name}' is listed twice. Keep one of the two lines.")
            positions[name] = _position(row, f"{path}, line {table.line_num}")
    return positions


def georeference(sparse: SparseModel, positions: dict[str, Array], options: GeoreferenceOptions) -> Georeference:
    """Return where the model lies in the world by the known positions of some cameras.

    Raises:
        InputError: fewer than 3 registered photos have a position, they lie on a line, or they contradict the model.
    """
    names = sparse.names
    known = [index for index, name in enumerate(names) if name in positions]
    if len(known) < MIN_POSITIONS:
        raise InputError(
            f"Only {len(known)} of the {len(names)} registered photos have a position; {MIN_POSITIONS} are needed, "
            "spread over the passage. Add positions of photos that registered, or leave the positions file out."
        )
    measured = np.array([positions[names[index]] for index in known])
    _check_spread(measured)
    world_from_sfm, is_believed = _fit(sparse.centres[known], measured, options)
    errors = np.linalg.norm(world_from_sfm.apply(sparse.centres[known]) - measured, axis=1)
    rms = float(np.sqrt(np.mean(errors[is_believed] ** 2)))
    doubted = [names[index] for index, believed in zip(known, is_believed, strict=True) if not believed]
    cautions: tuple[Caution, ...] = ()
    if doubted:
        cautions = (
            Caution(
                "doubtful-positions",
                f"{len(doubted)} of {len(known)} positions are more than {options.max_error:g} m off the model and "
                f"were not used: {', '.join(doubted[:5])}. They may be typing errors. Check them.",
            ),
        )
    return Georeference(world_from_sfm, rms, int(is_believed.sum()), cautions)


def level(sparse: SparseModel) -> Georeference:
    """Return a placement with z up by the cameras' mean up direction, in the model's arbitrary scale."""
    caution = Caution(
        "no-scale",
        "No camera positions were given: up is the photos' mean up direction and the size is arbitrary. "
        "Give positions of some photos, or one known length.",
    )
    return Georeference(upright(sparse.rotations, sparse.centres, 1.0), float("nan"), 0, (caution,))


def upright(cam_from_world: Array, centres: Array, scale: float) -> Sim3:
    """Return the Sim3 that scales, turns the cameras' mean up direction to +z and moves their mean place to the origin.

    Args:
        cam_from_world: (N, 3, 3) rotations; camera y points down.
        centres: (N, 3) camera centres.
        scale: Metres per unit.
    """
    up = -cam_from_world[:, 1].mean(axis=0)
    up /= np.linalg.norm(up)
    # x goes along the passage as far as that is level.
    extent = np.linalg.svd(centres - centres.mean(axis=0))[2][0]
    level_y = np.cross(up, extent)
    level_y /= np.linalg.norm(level_y)
    rotation = np.stack([np.cross(level_y, up), level_y, up])
    return Sim3(scale, rotation, -scale * rotation @ centres.mean(axis=0))


def move_model(sparse: SparseModel, world_from_sfm: Sim3) -> SparseModel:
    """Return a copy of the model in the world frame."""
    pycolmap = load_pycolmap()
    rotation = pycolmap.Rotation3d(world_from_sfm.rotation)
    model = pycolmap.Reconstruction(sparse.model)
    model.transform(pycolmap.Sim3d(world_from_sfm.scale, rotation, world_from_sfm.translation))
    return SparseModel(model, sparse.diagnoses, sparse.cautions)


def _position(row: dict[str, str], place: str) -> Array:
    try:
        position = np.array([float(row[axis]) for axis in "xyz"])
    except (TypeError, ValueError) as error:
        raise InputError(f"{place}: x, y, z are not three numbers ({error}). Correct the line.") from error
    if not np.all(np.isfinite(position)):
        raise InputError(f"{place}: {position} is not finite. Correct the line, or remove it.")
    return position


def _check_spread(positions: Array) -> None:
    spread = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    if spread[1] <= LINE_SHARE * spread[0]:
        raise InputError(
            f"The {len(positions)} positions lie on a line ({spread[1]:.2g} m beside {spread[0]:.2g} m along it), so "
            "they do not tell which way is up. Add positions of photos taken to the side of it."
        )


def _fit(sfm: Array, world: Array, options: GeoreferenceOptions) -> tuple[Sim3, np.ndarray]:
    """Return the Sim3 that fits most positions, refitted to those within `max_error`, and which they are."""
    pycolmap = load_pycolmap()
    ransac = pycolmap.RANSACOptions(max_error=options.max_error, random_seed=options.seed)
    found = pycolmap.estimate_sim3d_robust(sfm, world, ransac)
    if found is not None:
        is_believed = np.linalg.norm(_sim3(found["tgt_from_src"]).apply(sfm) - world, axis=1) <= options.max_error
        if is_believed.sum() >= MIN_POSITIONS:
            return _sim3(pycolmap.estimate_sim3d(sfm[is_believed], world[is_believed])), is_believed
    raise InputError(
        f"No {MIN_POSITIONS} of the {len(world)} positions agree with the model to {options.max_error:g} m. "
        "The names may be assigned wrongly or the unit may not be metres. Check the positions file."
    )


def _sim3(found) -> Sim3:  # type: ignore[no-untyped-def]  # pycolmap ships no types
    return Sim3(float(found.scale), found.rotation.matrix(), np.asarray(found.translation))
