"""The original's DistanceRewarder prefabs: the panels along a cave, which are exact, unlike the caves' own places.

Unity's frame is left-handed with y up; ours is right-handed with z up: (X, Y, Z) = (-z, x, y).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.build.original.unity_yaml import Document, read_documents
from aquanav_tools.errors import InputError
from aquanav_tools.text_files import NOT_A_TABLE
from aquanav_tools.types import Array, rotation_matrix

GAME_OBJECT, TRANSFORM, BEHAVIOUR = 1, 4, 114
PANELS_FIELD = "m_targetRewarders"
"""By this field of a script the panels of a DistanceRewarder are known."""
MAX_PANELS = 6
"""The original's training keeps the first six (its distancePlanesN) and drops the rest."""
MIN_PANELS = 2
MAX_PARENTS = 64
PLANE_SIZE = 10.0
"""Side of Unity's built-in plane before scaling, m."""
OURS_FROM_UNITY = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""(3, 3), of determinant -1: it mirrors."""


@dataclass(frozen=True, eq=False)
class Rewarder:
    """The panels of one DistanceRewarder, in the order they are to be passed; world frame, m."""

    name: str
    centres: Array
    """(P, 3)."""
    normals: Array
    """(P, 3), along the way."""
    sides: Array
    """(P, 2, 3) vectors from the centre to the middles of two neighbouring edges."""


def read_rewarders(folder: Path) -> list[Rewarder]:
    """Return the DistanceRewarders of all prefabs below a folder, by name.

    Raises:
        InputError: a prefab that names panels is damaged, or lacks them.
    """
    paths = sorted(path for path in folder.rglob("*.prefab") if path.is_file())
    return [_rewarder(path) for path in paths if PANELS_FIELD.encode() in _beginning(path)]


def _beginning(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(1 << 20)


def _rewarder(path: Path) -> Rewarder:
    documents = read_documents(path, {GAME_OBJECT, TRANSFORM, BEHAVIOUR})
    scripts = [document for document in documents.values() if PANELS_FIELD in document.fields]
    links = scripts[0].fields[PANELS_FIELD] if scripts else []
    if not isinstance(links, list) or len(links) < MIN_PANELS:
        raise InputError(
            f"The DistanceRewarder {path} names {len(links) if isinstance(links, list) else 0} panels; at least "
            f"{MIN_PANELS} are needed. The prefab is damaged or was never filled in: clone the project again."
        )
    try:
        frames = [_world_from_panel(link, documents) for link in links[:MAX_PANELS]]
    except NOT_A_TABLE as cause:
        raise InputError(
            f"The DistanceRewarder {path} names {len(links)} panels, one of which is not in it ({cause!r}). The prefab "
            "is damaged: clone the project again."
        ) from cause
    centres = np.array([OURS_FROM_UNITY @ frame[:3, 3] for frame in frames])
    # Unity's plane lies in its own x and z; y is its normal.
    axes = np.array([(OURS_FROM_UNITY @ frame[:3, :3]).T for frame in frames])
    ahead = np.gradient(centres, axis=0)
    normals = axes[:, 1] / np.linalg.norm(axes[:, 1], axis=1, keepdims=True)
    normals = np.where((normals * ahead).sum(axis=1, keepdims=True) < 0.0, -normals, normals)
    return Rewarder(path.stem, centres, normals, 0.5 * PLANE_SIZE * axes[:, [0, 2]])


def _world_from_panel(link: Any, documents: dict[int, Document]) -> Array:
    """Return the (4, 4) transform of the panel that an entry of the list names, in Unity's frame."""
    panel = documents[int(link["fileID"])]
    owner = documents[int(panel.fields["m_GameObject"]["fileID"])]
    parts = [documents.get(int(row["component"]["fileID"])) for row in owner.fields["m_Component"]]
    transform = next((part for part in parts if part is not None and part.kind == TRANSFORM), None)
    if transform is None:
        raise ValueError("an object has no place")
    world = np.eye(4)
    for _ in range(MAX_PARENTS):
        world = local_transform(transform.fields) @ world
        father = int(transform.fields["m_Father"]["fileID"])
        if father == 0:
            return world
        transform = documents[father]
    raise ValueError(f"objects hang in each other deeper than {MAX_PARENTS}")


def local_transform(fields: dict[str, Any]) -> Array:
    """Return the (4, 4) transform in the fields of a Unity Transform, in Unity's frame.

    Raises:
        KeyError, TypeError, ValueError: a field is missing, no number, or not finite.
    """
    place, scale = _numbers(fields["m_LocalPosition"], "xyz"), _numbers(fields["m_LocalScale"], "xyz")
    turn = _numbers(fields["m_LocalRotation"], "wxyz")
    length = float(np.linalg.norm(turn))
    if not 1e-6 < length < 1e6:  # numbers of 200 digits have one beyond floating point
        raise ValueError(f"a rotation of length {length:g}")
    transform = np.eye(4)
    transform[:3, :3] = rotation_matrix(turn / length) * scale
    transform[:3, 3] = place
    return transform


def _numbers(table: dict[str, Any], names: str) -> Array:
    values = np.array([float(table[name]) for name in names])
    if not np.isfinite(values).all():
        raise ValueError(f"{table} is not finite")
    return values
