from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path

import pytest

from aquanav_tools.build.options import BuildOptions, RecipeStages
from aquanav_tools.build.recipe import _photo_settings
from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.reconstruction import ReconstructOptions
from aquanav_tools.shipped import shipped_path
from aquanav_tools.tables import from_table, parse_toml, read_toml


def test_the_shipped_scan_recipe_explains_the_defaults() -> None:
    stages = vars(from_table(RecipeStages, read_toml(shipped_path("pipelines/build", "scan")), "scan.toml"))
    assert stages.pop("quality") == BuildOptions.quality
    for name, value in stages.items():
        assert value == BuildOptions.__dataclass_fields__[name].default_factory()  # type: ignore[misc]


@pytest.mark.parametrize("quality", ["draft", "standard", "high"])
def test_the_shipped_photo_recipe_tells_what_each_quality_chooses(quality: str) -> None:
    text = shipped_path("pipelines/build", "photos").read_text()
    chosen = re.findall(r"^# (\w+) = (\S+) # \(draft (\S+), high (\S+)\)", text, re.MULTILINE)
    assert len(chosen) == 6
    for name, *values in chosen:
        value = dict(zip(("standard", "draft", "high"), values, strict=True))[quality]
        text = re.sub(rf"^# {name} = ", f"{name} = {value} # ", text, flags=re.MULTILINE)
    table = parse_toml(text, "photos.toml")
    assert table["quality"] == BuildOptions.quality
    told = from_table(ReconstructOptions, table["photos"], "photos.toml")
    assert told == ReconstructOptions.at(quality)  # type: ignore[arg-type]


def test_the_shipped_photo_recipe_leaves_the_choice_to_the_quality() -> None:
    for quality in ("draft", "high"):
        options = BuildOptions(Path("in"), Path("out"), quality=quality)  # type: ignore[arg-type]
        recipe = BuildOptions(
            Path("in"), Path("out"), quality=quality, recipe=shipped_path("pipelines/build", "photos")
        )  # type: ignore[arg-type]
        assert _photo_settings(recipe) == _photo_settings(options)


def test_a_recipe_wins_over_the_quality_and_the_seed(tmp_path: Path) -> None:
    recipe = tmp_path / "mine.toml"
    recipe.write_text("[photos.depth]\nwidth = 400\n[photos.matching]\nseed = 7\n")
    settings = _photo_settings(BuildOptions(Path("in"), Path("out"), quality="draft", seed=3, recipe=recipe))
    expected = asdict(ReconstructOptions.at("draft"))
    expected["depth"] |= {"width": 400, "seed": 3}
    expected["matching"]["seed"], expected["mapping"]["seed"] = 7, 3
    assert asdict(settings) == expected


@pytest.mark.parametrize(("line", "message"), [("depht = 1", "depht"), ("depth = 1", "depth must be a table")])
def test_a_wrong_photo_table_is_named(line: str, message: str, tmp_path: Path) -> None:
    recipe = tmp_path / "mine.toml"
    recipe.write_text(f"[photos]\n{line}\n")
    with pytest.raises(InputError, match=message):
        _photo_settings(BuildOptions(Path("in"), Path("out"), recipe=recipe))
