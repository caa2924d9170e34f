"""What is said about a name that is not known."""

from __future__ import annotations

from aquanav_tools.errors import did_you_mean, near_names

CAVES = [f"cave-train-{n}" for n in range(1, 25)] + ["cave-test-1", "cave-test-2", "bay-calm"]


def test_a_misspelt_name_gets_the_right_one() -> None:
    assert did_you_mean("cave-tset-1", CAVES) == " Did you mean 'cave-test-1'?"


def test_few_names_are_all_listed() -> None:
    assert did_you_mean("x", ["b", "a"]) == " Known: a, b."


def test_of_many_names_three_are_told() -> None:
    told = did_you_mean("mine", CAVES)
    assert told.startswith(" The nearest of 27 names: ")
    assert told.count(",") == 2


def test_near_names_come_in_order_of_likeness_and_then_as_listed() -> None:
    assert near_names("bay-clam", CAVES, 1) == ["bay-calm"]
    assert near_names("cave-train", CAVES) == ["cave-train-1", "cave-train-2", "cave-train-3"]
