"""Which policy of a training run's folder is taken."""

from __future__ import annotations

from pathlib import Path

import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.policy.run_folder import best_policy


@pytest.mark.parametrize(
    ("files", "taken"), [(("best.zip", "policy.zip"), "best.zip"), (("policy.zip",), "policy.zip")]
)
def test_the_best_policy_is_taken_and_without_one_the_last(tmp_path: Path, files: tuple[str, ...], taken: str) -> None:
    for name in files:
        (tmp_path / name).touch()
    assert best_policy(tmp_path) == tmp_path / taken


def test_a_folder_of_an_evaluation_is_told_what_to_do_with_it(tmp_path: Path) -> None:
    (tmp_path / "results.json").touch()
    with pytest.raises(InputError, match=r"the output of an evaluation.*aquanav-eval compare"):
        best_policy(tmp_path)


def test_any_other_folder_is_refused_with_what_it_lacks(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"without best\.zip or policy\.zip: no training run"):
        best_policy(tmp_path)
