from __future__ import annotations

import itertools

import numpy as np
import pytest

from aquanav_tools.envs.action import ACTIONS, ActionModel
from aquanav_tools.errors import InputError
from aquanav_tools.sim.command import AFLOAT, DIVING, Command


@pytest.mark.parametrize(
    ("action", "command"),
    [
        ([0, 1, 1], Command(1, 0, 0)),  # up
        ([2, 1, 1], Command(-1, 0, 0)),  # down
        ([1, 0, 1], Command(0, 1, 0)),  # left
        ([1, 2, 1], Command(0, -1, 0)),  # right
        ([1, 1, 0], Command(0, 0, -1)),  # reverse
        ([1, 1, 2], Command(0, 0, 1)),  # ahead
    ],
)
def test_choices_mean_what_the_original_says(action: list[int], command: Command) -> None:
    assert ActionModel("multidiscrete").command(action) == command


def test_discrete_counts_through_all_choices() -> None:
    choices, numbers = ActionModel("multidiscrete"), ActionModel("discrete")
    commands = [choices.command(choice) for choice in itertools.product(range(3), repeat=3)]
    assert [numbers.command(np.int64(n)) for n in range(27)] == commands
    assert len(set(commands)) == 27


def test_continuous_is_clipped_to_full_command() -> None:
    assert ActionModel("continuous").command(np.array([0.5, -7.0, 1.0])) == Command(0.5, -1.0, 1.0)


@pytest.mark.parametrize(
    ("form", "action"),
    [
        ("multidiscrete", [0, 1, 3]),
        ("multidiscrete", [0, 1]),
        ("multidiscrete", 4),
        ("multidiscrete", [1.7, 0.2, 1.9]),
        ("multidiscrete", [np.nan, 0.0, 0.0]),
        ("multidiscrete", None),
        ("discrete", 27),
        ("discrete", 3.5),
        ("discrete", [3, 4]),
        ("discrete", "ahead"),
        ("continuous", ["ahead", "left", "up"]),
        ("continuous", [0.0, np.nan, 0.0]),
        ("continuous", [0.0, 0.0]),
    ],
)
def test_actions_outside_the_space_are_refused(form: str, action: object) -> None:
    with pytest.raises(InputError, match="An action must be"):
        ActionModel(form).command(action)


@pytest.mark.parametrize("parts", [DIVING, AFLOAT])
@pytest.mark.parametrize("form", ACTIONS)
def test_many_actions_mean_what_each_means_alone(form: str, parts: tuple[str, ...], rng: np.random.Generator) -> None:
    model, num = ActionModel(form, parts), 50
    model.space.seed(3)
    actions = np.array([model.space.sample() for _ in range(num)])
    alone = np.array([model.command(action) for action in actions], dtype=np.float32)
    np.testing.assert_array_equal(model.commands(actions, num), alone)


@pytest.mark.parametrize(
    ("form", "actions"),
    [
        ("multidiscrete", [[0, 1, 3]]),
        ("multidiscrete", [[0, 1, -1]]),
        ("multidiscrete", [[1.7, 0.0, 2.0]]),
        ("multidiscrete", [[np.nan, 0.0, 0.0]]),
        ("multidiscrete", [0, 1, 2]),
        ("discrete", [27]),
        ("discrete", [3.5]),
        ("discrete", ["ahead"]),
        ("continuous", [[0.0, np.nan, 0.0]]),
        ("continuous", [[0.0, 0.0]]),
    ],
)
def test_of_many_actions_none_may_be_outside_the_space(form: str, actions: list[object]) -> None:
    with pytest.raises(InputError, match=r"Actions must be|An action is not finite"):
        ActionModel(form).commands(actions, 1)


def test_unknown_form_suggests_the_closest() -> None:
    with pytest.raises(InputError, match="Did you mean 'discrete'"):
        ActionModel("discreet")
