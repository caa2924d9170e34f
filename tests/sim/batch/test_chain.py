"""The original's DistanceRewarder: its rule worked out by hand on a tube with six panels."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from aquanav_tools.cave.route.guide import Guide, Panel
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.chain import distances_along_centres, follow_chain
from aquanav_tools.sim.batch.guide import Panels, make_panels
from aquanav_tools.sim.batch.runtime import find_device
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, Capsule
from tests.caves import tube_guide
from tests.sim.batch.worlds import make_world, place

CAPSULE = Capsule(0.3, 0.25)
"""Its nose is 0.425 m ahead of its middle."""
AHEAD = np.array([1.0, 0.0, 0.0])


@wp.kernel
def follow(
    pose: wp.array(dtype=wp.vec3d),
    half_axis: wp.float64,
    radius: wp.float64,
    panels: Panels,
    to_go: wp.array(dtype=wp.float64),
    crossed: wp.array(dtype=wp.int32),
    touched: wp.array2d(dtype=wp.bool),
    out: wp.array(dtype=wp.float64),
):
    """Follow one vehicle's (2,) position and axis, and write its distance to go."""
    out[0] = follow_chain(0, pose[0], pose[1], half_axis, radius, panels, to_go, crossed, touched)


class PanelChain:
    """The chain of a guide's panels, and how far along it one vehicle is."""

    def __init__(self, guide: Guide, capsule: Capsule) -> None:
        find_device("cpu")
        self._sizes = (0.5 * capsule.axis_length, capsule.radius)
        self._panels = make_panels(guide, "cpu")
        self._to_go = wp.array(distances_along_centres(guide), dtype=wp.float64, device="cpu")
        self._crossed = wp.zeros(1, dtype=wp.int32, device="cpu")
        self._touched = wp.zeros((1, len(guide.panels)), dtype=wp.bool, device="cpu")

    @property
    def num_crossed(self) -> int:
        return int(self._crossed.numpy()[0])

    def follow(self, position: Array, ahead: Array) -> float:
        pose = wp.array(np.array([position, ahead]), dtype=wp.vec3d, device="cpu")
        out = wp.zeros(1, dtype=wp.float64, device="cpu")
        inputs = [pose, *self._sizes, self._panels, self._to_go, self._crossed, self._touched, out]
        wp.launch(follow, dim=1, inputs=inputs, device="cpu")
        return float(out.numpy()[0])


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


def test_a_new_episode_forgets_the_crossings(tube: Scenario) -> None:
    world = make_world(tube, load_vehicle("bluerov2"), 1, has_goal=False, progress="original")
    for x in np.arange(1.5, 12.0, 0.1):
        place(world, np.array([[x, 0.0, 0.0]]))
        world.step()
    assert world.as_numpy("panels_crossed")[0] > 0
    world.reset(np.zeros(1))
    assert world.as_numpy("panels_crossed")[0] == 0
    assert not world.as_numpy("touched_panels")[0, 1:].any()


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
