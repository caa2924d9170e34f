from __future__ import annotations

import re

import numpy as np
import pytest

from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.cave.closing.ambient_occlusion import check_is_hollow
from aquanav_tools.errors import MeshError
from aquanav_tools.synthetic import caves, damage, networks
from aquanav_tools.synthetic.rock import embed_in_rock
from aquanav_tools.types import Mesh

RADIUS, LENGTH = 1.0, 8.0


def closed(mesh: Mesh) -> Cavity:
    return Cavity(mesh, np.full(len(mesh.faces), WALL), np.ones(len(mesh.faces), dtype=bool), ())


@pytest.mark.parametrize("margin", [0.5, 1.0, 4.0])
def test_a_block_of_rock_around_a_tube_is_told_from_a_cave_and_its_middle_proposed(margin: float) -> None:
    tube = damage.intact(caves.tube(RADIUS, LENGTH, 32, 41))
    with pytest.raises(MeshError, match="block of rock") as refusal:
        check_is_hollow(closed(embed_in_rock(tube, margin).mesh), 1.0)
    place = np.array(re.search(r"--inside (\S+) (\S+) (\S+) ", str(refusal.value)).groups(), dtype=float)
    assert 0.0 < place[0] < LENGTH
    assert np.linalg.norm(place[1:]) < RADIUS


@pytest.mark.parametrize("make", [networks.loop, networks.helix, networks.chamber])
def test_a_winding_cave_that_is_closed_all_around_is_a_cave(make: object) -> None:
    check_is_hollow(closed(make().cavity().mesh), 1.0)
