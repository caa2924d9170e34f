"""Room-and-pillar mines: volume, pillars and area as the plan says, in thousands of loose panels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aquanav_tools.geometry.mesh.handles import genus
from aquanav_tools.geometry.mesh.patches import find_patches
from aquanav_tools.synthetic.mines import MineOptions, mine, pillars

SMALL = MineOptions(rooms=(3, 4))


def plan_area(options: MineOptions) -> float:
    sides = pillars(options)[:, 1] - pillars(options)[:, 0]
    return float(options.size.prod() + 2 * options.adit * options.room - sides.prod(axis=1).sum())


def wall_length(options: MineOptions) -> float:
    sides = pillars(options)[:, 1] - pillars(options)[:, 0]
    rim = 2.0 * options.size.sum() - 2.0 * options.room + 4.0 * options.adit
    return float(2.0 * sides.sum() + rim)


def test_water_is_the_plan_times_the_height_with_a_handle_for_each_pillar() -> None:
    truth = mine(SMALL).truth
    assert truth.solid is not None
    assert truth.solid.volume == pytest.approx(plan_area(SMALL) * SMALL.height, rel=1e-6)
    assert genus(truth.solid) == truth.genus == 12


def test_panels_without_slits_cover_floor_roof_and_walls_once() -> None:
    exact = replace(SMALL, gap=0.0, offset=0.0, missing=0.0)
    panels = mine(exact).mesh
    area = 2.0 * plan_area(exact) + wall_length(exact) * exact.height
    assert panels.areas.sum() == pytest.approx(area, rel=1e-9)
    low, high = panels.vertices.min(axis=0), panels.vertices.max(axis=0)
    assert np.allclose([low, high], [[0, -exact.adit, 0], [*(exact.size + [0, exact.adit]), exact.height]])


def test_a_mine_of_300_by_500_m_is_thousands_of_loose_pieces() -> None:
    panels = mine(MineOptions()).mesh
    assert np.allclose(MineOptions().size, [306.0, 501.0])
    assert 20_000 <= len(panels.faces) <= 40_000
    assert find_patches(panels).count == len(panels.faces) // 2  # no panel shares an edge with another


@pytest.mark.parametrize("change", [{"rooms": (0, 3)}, {"height": 0.0}, {"uneven": 0.95}, {"missing": 1.0}])
def test_options_without_sense_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="must be"):
        MineOptions(**change)  # type: ignore[arg-type]
