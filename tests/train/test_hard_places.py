"""Episodes that begin before places where others ended in contacts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.errors import InputError
from aquanav_tools.train.hard_places import APART, HardPlaces
from aquanav_tools.train.settings import RunSettings
from aquanav_tools.train.training import train
from tests.caves import TUBE_LENGTH, tube_scenario
from tests.train.runs import assert_stopped_run_ends_alike, tiny_pipeline, tiny_tube
from tests.train.test_drawn_caves import MIXED, ON_BATCH, stub

NUM = 40


def into_the_wall(fraction: float) -> tuple[CaveBatch, HardPlaces]:
    """Return vehicles that begin at the tube's last start, at x = 8 m, and steer until all of them have touched."""
    batch = CaveBatch(tube_scenario(), NUM, next_step=False, on_collision="end", current="still")
    places = HardPlaces(batch, fraction)
    batch.reset(list(range(NUM)), [len(batch.scenarios[0].starts) - 1] * NUM)
    ended = np.zeros(NUM, dtype=bool)
    for _ in range(150):
        batch.set_commands(np.tile(np.array([0.0, 0.4, 1.0], dtype=np.float32), (NUM, 1)))
        batch.step()
        ended |= batch.view_of("terminated")
        if ended.all():
            return batch, places
    raise AssertionError("not all have touched the wall")


@pytest.mark.parametrize("fraction", [0.0, 0.5, 1.0])
def test_a_fraction_of_episodes_begins_at_the_start_before_a_contact(fraction: float) -> None:
    batch, places = into_the_wall(fraction)
    begun = batch.copy_of("start_indices")
    starts = batch.scenarios[0].starts
    (kept,) = places.state()["hard/starts"]
    (count,) = places.state()["hard/counts"]
    assert count == NUM  # all touch at the same place
    x = starts[kept[0]].pose.position[0]
    assert (kept == kept[0]).all() and 8.0 - APART - 0.8 < x <= 8.0
    share = (begun == kept[0]).mean()
    # Of the others one in twenty begins there as well; four standard errors.
    expected = fraction + (1.0 - fraction) / len(starts)
    assert share == pytest.approx(expected, abs=4.0 * np.sqrt(expected * (1.0 - expected) / NUM))
    batch.close()


def test_what_is_to_go_from_each_start_is_the_rest_of_the_tube() -> None:
    batch = CaveBatch(tube_scenario(), 1, next_step=False, current="still")
    x = np.array([start.pose.position[0] for start in batch.scenarios[0].starts])
    np.testing.assert_allclose(batch.remaining_at_starts(0), TUBE_LENGTH - 1.0 - x, atol=0.1)
    batch.close()


def test_contacts_in_a_cave_are_forgotten_with_it() -> None:
    batch, places = into_the_wall(1.0)
    places.forget(0)
    assert places.state()["hard/counts"].tolist() == [0]
    batch.close()


def test_a_stopped_run_ends_as_one_that_never_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stub(monkeypatch, tmp_path / "caves")
    pipeline = tiny_pipeline(
        Path(MIXED), 1, ON_BATCH, num_caves=2, new_cave_every=48, steps=384, on_collision="end", hard_starts=0.5
    )
    assert_stopped_run_ends_alike(pipeline, tmp_path, monkeypatch, 2)


def test_where_it_cannot_be_it_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"here contacts end none\. Set on_collision to end"):
        tiny_pipeline(Path(MIXED), 1, ON_BATCH, hard_starts=0.5)
    tube, own = tiny_tube(tmp_path / "tube"), RunSettings(backend="own")
    with pytest.raises(InputError, match="hard_starts is for the batch only"):
        train(tiny_pipeline(tube, 1, own, hard_starts=0.5, on_collision="end"), 0, tmp_path / "run")
