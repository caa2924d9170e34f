from __future__ import annotations

import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.tables import from_table
from aquanav_tools.train.settings import RunSettings, TrainSettings


def test_defaults_are_the_originals() -> None:
    # Section 3 of the original's contract: epochs, gamma, lambda, entropy, network, lesson 1.
    settings = TrainSettings()
    assert settings.epochs == 5
    assert (settings.discount, settings.gae_lambda, settings.ent_coef) == (0.99, 0.95, 0.005)
    assert (settings.hidden, settings.learning_rate, settings.clip) == ((128, 128, 128), 3e-4, 0.2)
    assert settings.normalise


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"steps": 0}, "steps must be positive, got 0"),
        (
            {"num_envs": 16, "n_steps": 1280, "batch": 1000},
            "A rollout has 20480 decisions (n_steps 1280 x num_envs 16), which batch (1000) must divide",
        ),
        ({"n_steps": -1}, "n_steps must not be negative, got -1"),
        (
            {"precision": "bfloat16", "algorithm": "sac", "action": "continuous"},
            "precision bfloat16 is for ppo, and the algorithm is sac",
        ),
        ({"discount": 1.5}, "discount must be in [0, 1], got 1.5"),
        ({"hidden": []}, "hidden must list positive widths"),
        ({"ent_coef": -1.0}, "ent_coef must not be negative"),
        (
            {"scenario": "a", "scenarios": ["b", "c"], "num_envs": 2},
            "has 3 scenarios for 2 environments. Take more (num_envs)",
        ),
        ({"reward": "denser"}, "Did you mean 'dense'"),
        ({"rewards": "dense"}, "unknown key 'rewards'. Did you mean 'reward'"),
        ({"algorithm": "sac"}, "sac acts continuously, and the action is multidiscrete"),
        ({"algorithm": "dqn"}, "algorithm is 'dqn'"),
    ],
)
def test_senseless_settings_are_refused(table: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as error:
        from_table(TrainSettings, table, "mine.toml")
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"workers": 2, "backend": "batch"}, "the batch runs in threads of its own"),
        ({"ray": "auto"}, "ray is given without workers. Say how many actors: workers"),
        ({"ray": "head", "workers": 2}, "ray is 'head'; give auto, or the HOST:PORT"),
    ],
)
def test_senseless_settings_of_a_run_are_refused(table: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as error:
        from_table(RunSettings, table, "mine.toml")
    assert message in str(error.value)
