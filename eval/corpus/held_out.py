"""A second corpus, to judge by: caves of the drawn styles and kinds of damage that no threshold was set on.

Nothing about closing may be chosen by its results; what it finds is mended by thought, and judged by other seeds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import count

import numpy as np
import trimesh

from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.synthetic import damage, passes
from aquanav_tools.synthetic.damage import DamagedScan, Truth
from aquanav_tools.synthetic.made_up import made_up_cavity
from aquanav_tools.synthetic.styles.catalogue import DrawnCave, draw_cave
from aquanav_tools.synthetic.styles.surface import water_surface
from aquanav_tools.types import Mesh
from eval.corpus.cases import Case

STYLES = (
    "phreatic-tube", "vadose-canyon", "bedding-plane", "breakdown-chamber", "shaft-ramp", "fault-fissure", "maze",
    "sump-series", "mine-drift",
)  # fmt: skip
FIRST_SEED = 500_000
"""No training cave, no test cave and no case of the first corpus has seeds from here on."""
MAX_LENGTH = 30.0
"""Of the way, m: the first seeds whose caves are shorter are taken."""
MERGED_VOXELS = 0.01
"""Triangles of the truth are merged where that moves its wall by no more, voxels."""


@dataclass(frozen=True)
class Damage:
    """One kind of damage, and what may be asked of a cavity after it."""

    name: str
    apply: Callable[[DamagedScan], DamagedScan]
    max_volume_error: float = 0.03
    has_fit: bool = True
    min_covered: float = 0.85


DAMAGES = (
    Damage("intact", lambda s: s),
    Damage("holes", lambda s: damage.punch_holes(s, 30, 0.25, 11)),
    Damage("noise", lambda s: damage.add_noise(s, 0.015, 12)),
    Damage("phone", lambda s: damage.add_noise(
        damage.split_parts(damage.tear_ends(damage.punch_holes(s, 25, 0.2, 13), 0.6, 13), 3, 0.02, 13), 0.008, 13)),
    Damage("coarse", lambda s: damage.decimate(s, 0.02), 0.1, has_fit=False),
    Damage("soup", lambda s: damage.flip_faces(damage.unweld(s, 14, 0.003), 0.4, 14)),
    Damage("fins", lambda s: damage.add_fins(damage.punch_holes(s, 10, 0.3, 15), 15, 0.3, 15)),
    Damage("cloud", lambda s: damage.sample_cloud(s, 0.05, "none", 16)),
    Damage("uneven-cloud", lambda s: damage.sample_cloud(s, 0.04, "mixed", 17, fall_off=20.0)),
    Damage("strip", lambda s: passes.miss_strip(s, 4.0, (0.0, 0.0, 1.0))),
    Damage("stations", lambda s: passes.scan_from_stations(s, 4.0, 40_000, 12.0, 18), 0.05),
    Damage("drift", lambda s: passes.drift_passes(s, 3, 0.06, 0.6, 19), 0.05, has_fit=False),
    Damage("twice", lambda s: passes.repeat_room(s, 0.2, 0.12, 0.03, 20), 0.05, has_fit=False),
)  # fmt: skip


def held_out_cases() -> list[Case]:
    """Return every damage of a cave of every style."""
    return [
        Case(
            f"{style}-{kind.name}",
            style,
            partial(_damaged, style, kind.apply),
            max_volume_error=kind.max_volume_error,
            has_fit=kind.has_fit,
            min_covered=kind.min_covered,
        )
        for style in STYLES
        for kind in DAMAGES
    ]


def _damaged(style: str, apply: Callable[[DamagedScan], DamagedScan]) -> DamagedScan:
    return apply(known(style))


@lru_cache(maxsize=1)
def known(style: str) -> DamagedScan:
    """Return the scan of a short cave of a style with its truth: all of its wall, open at both ends."""
    drawn = short_cave(style)
    cavity = made_up_cavity(water_surface(drawn.plan, drawn.voxel, drawn.noise_seed), MERGED_VOXELS * drawn.voxel)
    wall = cavity.mesh.faces[cavity.labels == WALL]
    used, faces = np.unique(wall, return_inverse=True)
    genus = int(1 - cavity.mesh.to_trimesh().euler_number // 2)
    axis = drawn.plan.passages[0].axis
    path = axis[(axis[:, 0] >= 0.0) & (axis[:, 0] <= drawn.plan.extent)]
    truth = Truth(cavity.mesh, (path,), _num_openings(cavity), genus)
    return DamagedScan(Mesh(cavity.mesh.vertices[used], faces.reshape(-1, 3).astype(np.int64)), truth)


def _num_openings(cavity: Cavity) -> int:
    """Return how many openings a made-up cave has: a plane that ends its way may cut a side passage, too."""
    faces = cavity.mesh.faces[cavity.labels != WALL]
    pairs = trimesh.graph.face_adjacency(faces)
    return len(trimesh.graph.connected_components(pairs, nodes=np.arange(len(faces)), min_len=1))


def short_cave(style: str) -> DrawnCave:
    """Return the first cave of a style from FIRST_SEED on whose way is short."""
    for seed in count(FIRST_SEED):
        drawn = draw_cave(style, seed)
        if drawn.plan.length <= MAX_LENGTH:
            return drawn
    raise AssertionError("unreachable")
