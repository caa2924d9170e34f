"""The command `aquanav render`."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest
from PIL import Image

from aquanav_tools.cli import info
from aquanav_tools.photograph.conditions import CONDITIONS, ConditionName


def test_render_writes_photos_of_the_size_asked_for_and_their_positions(tmp_path: Path) -> None:
    out = tmp_path / "photos"
    info.main(["render", "--out", str(out), "--photos", "5", "--size", "128x96"])
    photos = sorted(out.glob("*.jpg"))
    with (out / "positions.csv").open() as file:
        assert [row["name"] for row in csv.DictReader(file)] == [photo.name for photo in photos]
    assert len(photos) == 5
    assert {Image.open(photo).size for photo in photos} == {(128, 96)}


def test_render_films_a_turbid_cave_through_a_fisheye(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(CONDITIONS, "turbid", replace(CONDITIONS["turbid"], cave_length=3.0))
    out = str(tmp_path / "dive")
    info.main(["render", "-o", out, "--video", "--condition", "turbid", "--lens", "fisheye", "--photos", "4",
               "--size", "96x64"])  # fmt: skip
    assert (tmp_path / "dive" / "dive.mp4").stat().st_size > 1000
    assert "4 frames of 96 x 64 px" in capsys.readouterr().out


def test_the_help_teaches_every_condition(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        info.main(["render", "--help"])
    shown = " ".join(capsys.readouterr().out.split())
    assert set(get_args(ConditionName)) == set(CONDITIONS)
    for name in CONDITIONS:
        assert f"{name} (" in shown


@pytest.mark.parametrize(
    ("wrong", "advice"),
    [
        (["--size", "10x10"], "--size"),
        (["--size", "large"], "such as 1280x960"),
        (["--photos", "1"], "photos = 1 is not from 3 to 9999"),
        (["--first-number", "0"], "first_number = 0 is not from 1 to 9999"),
        (["--video", "--depth"], "Leave them out"),
        (["--video", "--condition", "three-passes"], "Choose another --condition"),
    ],
)
def test_render_refuses_what_makes_no_photos(
    wrong: list[str], advice: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_info:
        info.main(["render", "--out", str(tmp_path / "photos"), *wrong])
    assert exit_info.value.code == 2
    assert advice in capsys.readouterr().err
    assert not (tmp_path / "photos").exists()
