from __future__ import annotations

import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.tables import from_table, read_toml
from aquanav_tools.train.settings import TrainSettings
from tests.conftest import REPOSITORY


@pytest.mark.parametrize(
    "path", sorted((REPOSITORY / "pipelines" / "train").glob("*.toml")), ids=lambda path: path.stem
)
def test_every_shipped_pipeline_is_valid(path) -> None:  # type: ignore[no-untyped-def]
    assert from_table(TrainSettings, read_toml(path), path.name).steps > 0


def test_defaults_are_the_originals() -> None:
    # Section 3 of the original's contract: batch, buffer, epochs, gamma, lambda, entropy, network, lesson 1.
    settings = TrainSettings()
    assert (settings.batch, settings.buffer, settings.epochs) == (1024, 20480, 5)
    assert (settings.discount, settings.trace, settings.entropy) == (0.99, 0.95, 0.005)
    assert (settings.hidden, settings.learning_rate, settings.clip) == ((128, 128, 128), 3e-4, 0.2)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"steps": 0}, "steps must be positive, got 0"),
        ({"num_envs": 3}, "buffer (20480) must be a multiple of num_envs (3)"),
        ({"batch": 1000}, "buffer (20480) must be a multiple of batch (1000)"),
        ({"discount": 1.5}, "discount must be in [0, 1], got 1.5"),
        ({"hidden": []}, "hidden must list positive widths"),
        ({"entropy": -1.0}, "entropy must not be negative"),
        ({"reward": "denser"}, "Did you mean 'dense'"),
        ({"rewards": "dense"}, "unknown key 'rewards'. Did you mean 'reward'"),
    ],
)
def test_senseless_settings_are_refused(table: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as error:
        from_table(TrainSettings, table, "mine.toml")
    assert message in str(error.value)
