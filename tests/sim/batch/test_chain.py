"""The original's DistanceRewarder: its rule worked out by hand on a tube with six panels."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.cave.route.guide import Guide, Panel
from aquanav_tools.sim.batch.chain import PanelChain
from aquanav_tools.types import Array, Capsule
from tests.caves import tube_guide

CAPSULE = Capsule(0.3, 0.25)
"""Its nose is 0.425 m ahead of its middle."""
AHEAD = np.array([1.0, 0.0, 0.0])


def swim(chain: PanelChain, points: Array, ahead: Array = AHEAD) -> list[float]:
    return [chain.follow(np.asarray(point, dtype=np.float64), ahead) for point in points]


def along(*x: float, y: float = 0.0) -> Array:
    stations = np.concatenate([np.arange(a, b, 0.1 if b > a else -0.1) for a, b in itertools.pairwise(x)])
    return np.stack([stations, np.full(len(stations), y), np.zeros(len(stations))], axis=1)


def test_before_any_panel_it_is_the_way_to_the_first_and_the_chain_from_there() -> None:
    chain = PanelChain(tube_guide(6), CAPSULE)  # panels every 3.6 m from x = 1 to 19
    assert chain.follow(np.array([0.5, 1.2, 0.0]), AHEAD) == pytest.approx(np.hypot(0.5, 1.2) + 18.0)


def test_a_panel_is_crossed_when_the_vehicle_has_left_it_and_not_before() -> None:
    chain = PanelChain(tube_guide(6), CAPSULE)
    swim(chain, along(0.3, 1.4))
    assert chain.num_crossed == 0  # the tail is still in the first panel
    assert chain.follow(np.array([1.45, 0, 0]), AHEAD) == pytest.approx(4.6 - 1.45 + 14.4)
    assert chain.num_crossed == 1


def test_a_panel_crossed_off_its_centre_makes_the_distance_jump() -> None:
    chain = PanelChain(tube_guide(6), CAPSULE)
    distances = swim(chain, along(0.3, 1.8, y=1.5))
    assert min(np.diff(distances)) < -1.0


def test_going_back_through_a_panel_crosses_it_too_and_nothing_is_uncrossed() -> None:
    chain = PanelChain(tube_guide(6), CAPSULE)
    swim(chain, along(2.0, 4.5, 2.0))
    assert chain.num_crossed == 2  # it touched the second panel at x = 4.6 and went back
    assert chain.follow(np.array([2.0, 0, 0]), AHEAD) == pytest.approx(8.2 - 2.0 + 10.8)


def test_the_last_panel_is_never_crossed() -> None:
    chain = PanelChain(tube_guide(6), CAPSULE)
    distances = swim(chain, along(1.5, 19.9))
    assert chain.num_crossed == 5
    assert distances[-1] == pytest.approx(abs(19.0 - 19.8))


def test_leaving_a_panel_crosses_all_before_it() -> None:
    chain = PanelChain(tube_guide(6), CAPSULE)
    swim(chain, along(11.0, 12.5))  # the fourth is at x = 11.8
    assert chain.num_crossed == 4


def test_sideways_it_leaves_a_panel_earlier() -> None:
    chain = PanelChain(tube_guide(6), CAPSULE)
    swim(chain, along(0.3, 1.5), ahead=np.array([0.0, 1.0, 0.0]))
    assert chain.num_crossed == 1  # 0.3 m of radius behind the panel, without the axis


def test_reset_forgets_the_crossings() -> None:
    chain = PanelChain(tube_guide(6), CAPSULE)
    swim(chain, along(1.5, 12.0))
    chain.reset()
    assert chain.follow(np.array([1.0, 0, 0]), AHEAD) == pytest.approx(18.0)


@pytest.mark.parametrize("key", ["easy", "medium", "eval1"])
def test_in_the_originals_caves_the_chain_is_as_long_as_its_table_says(data_dir: Path, key: str) -> None:
    table = json.loads((data_dir / "saferlauv" / "panels" / f"{key}.json").read_text(encoding="utf-8"))
    corners = [(a, b) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    panels, arc_length = [], 0.0
    for n, row in enumerate(table["panels"]):
        centre, normal, u, v = (np.array(row[name]) for name in ("center", "normal", "u", "v"))
        if n:
            arc_length += float(np.linalg.norm(centre - panels[-1].centre))
        square = np.array([centre + a * row["half_u"] * u + b * row["half_v"] * v for a, b in corners])
        panels.append(Panel(centre, normal, square, arc_length, 1.0))
    chain = PanelChain(Guide(np.array([panel.centre for panel in panels]), tuple(panels)), CAPSULE)
    assert chain.follow(panels[0].centre, AHEAD) == pytest.approx(table["path_length"], abs=0.001)
    for before, after in itertools.pairwise(panels):
        distances = swim(chain, np.linspace(before.centre, after.centre, 200), after.normal)
    assert chain.num_crossed == len(panels) - 1
    assert distances[-1] == pytest.approx(0.0, abs=1e-6)
