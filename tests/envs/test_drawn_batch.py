"""Batches in generated/STYLE without a seed: a fixed draw of caves, none of them a test cave."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import gymnasium
import pytest

from aquanav_tools.api.environments import make_env, make_vec_env
from aquanav_tools.envs import factory
from aquanav_tools.envs.factory import make_batch, with_drawn
from aquanav_tools.errors import InputError, ScenarioError
from aquanav_tools.machine import CACHE_VARIABLE
from aquanav_tools.scenario import shipped
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.split import fixed_draw, is_test_cave
from aquanav_tools.synthetic.styles.names import style_of
from tests.caves import tube_scenario


@pytest.fixture(autouse=True)
def tubes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Have tubes built in place of drawn caves; return the names of those that were."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    built: list[str] = []

    def build(name: str, folder: Path, *_: object) -> None:
        style, seed = name.split("/")[1:]
        settings = dataclasses.replace(tube_scenario().settings, name=f"{style_of(style, int(seed))}-{seed}")
        write_scenario(dataclasses.replace(tube_scenario(), settings=settings), folder)
        built.append(name)

    monkeypatch.setattr(shipped, "_build", build)
    return built


def test_a_style_without_a_seed_stands_for_a_fixed_draw_of_training_caves(tubes: list[str]) -> None:
    env = make_vec_env("generated/mixed", 8, num_caves=3, cave_seed=1)
    names = [scenario.name for scenario in env.batch.scenarios]
    assert [part.stop - part.start for part in env.batch.slices] == [3, 2, 3]
    assert sorted(tubes) == sorted(fixed_draw(["generated/mixed"], 3, 1))
    for name in names:
        style, _, seed = name.rpartition("-")
        assert not is_test_cave(style, int(seed))
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()
    again = gymnasium.make_vec(
        "aquanav/Cave-v0", 8, vectorization_mode="vector_entry_point", scenario="generated/mixed", num_caves=3,
        cave_seed=1,
    )  # fmt: skip
    assert [scenario.name for scenario in again.batch.scenarios] == names
    again.close()


def test_another_seed_draws_other_caves_also_for_stable_baselines3(tubes: list[str]) -> None:
    pytest.importorskip("stable_baselines3", reason="Stable-Baselines3's kind of environment needs it")
    other = make_vec_env("generated/mixed", 8, kind="sb3", num_caves=3, cave_seed=2)
    assert sorted(tubes) == sorted(fixed_draw(["generated/mixed"], 3, 2))
    assert set(tubes).isdisjoint(fixed_draw(["generated/mixed"], 3, 1))
    other.close()


def test_styles_take_turns_beside_caves_that_are_named() -> None:
    names = ["generated/maze", tube_scenario(), "generated/mine-drift"]
    drawn = with_drawn(names, 6, 4, 0)
    assert drawn[0] is names[1]
    assert [str(name).split("/")[1] for name in drawn[1:]] == ["maze", "mine-drift", "maze", "mine-drift"]
    assert len(with_drawn("generated/maze", 3, 16, 0)) == 3  # one for each vehicle at most
    batch = make_batch(names, 5, next_step=False)
    assert len(batch.slices) == 5
    batch.close()


def test_what_cannot_be_drawn_is_told() -> None:
    with pytest.raises(InputError, match="num_caves must be at least 1, got 0"):
        make_batch("generated/maze", 4, num_caves=0, next_step=False)
    with pytest.raises(InputError, match="no style 'mase'"):
        make_vec_env("generated/mase", 4)
    with pytest.raises(InputError, match="need at least as many vehicles, got 1"):
        make_vec_env(["generated/maze", "generated/mixed"], 1)
    with pytest.raises(ScenarioError, match="A style without a seed stands for all its caves, and only training on"):
        make_env("generated/maze")
    assert factory.NUM_DRAWN == 16
