from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.report.picture import CavePicture, draw_cave
from aquanav_tools.scenario.schema import Scenario
from tests.report.trajectories import straight_trajectory


def read_pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def share_like(pixels: np.ndarray, colour: tuple[int, int, int]) -> float:
    return float((np.abs(pixels - colour).max(axis=-1) < 12).mean())


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory, tube: Scenario) -> tuple[np.ndarray, np.ndarray]:
    folder = tmp_path_factory.mktemp("pictures")
    picture = CavePicture(tube)
    picture.draw(folder / "cave.png")
    picture.draw(folder / "trail.png", [straight_trajectory()])
    return read_pixels(folder / "cave.png"), read_pixels(folder / "trail.png")


def test_picture_is_mostly_cave_on_white(pictures: tuple[np.ndarray, np.ndarray]) -> None:
    cave, _ = pictures
    assert 0.2 < share_like(cave, (255, 255, 255)) < 0.7
    blue_green = (cave[..., 2] > cave[..., 0] + 15).mean()
    assert blue_green > 0.3


def test_route_is_drawn_across_the_whole_passage(pictures: tuple[np.ndarray, np.ndarray]) -> None:
    cave, _ = pictures
    amber = np.abs(cave - (255, 183, 3)).max(axis=-1) < 12
    assert amber.any(axis=0).mean() > 0.7  # 18 of 20 m, less what the starts hide


def test_trail_shows_contact_in_red_only_with_a_track(pictures: tuple[np.ndarray, np.ndarray]) -> None:
    red = (229, 56, 59)
    cave, trail = pictures
    assert share_like(trail, red) > 3 * share_like(cave, red)


def test_same_picture_is_the_same_file(tmp_path: Path, tube: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aquanav_tools.report.picture.DPI", 40)
    for name in ("a.png", "b.png"):
        draw_cave(tube, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
