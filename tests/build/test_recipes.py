from __future__ import annotations

from aquanav_tools.build.options import BuildOptions
from aquanav_tools.cli.build_cave import _Stages
from aquanav_tools.reconstruct.reconstruction import ReconstructOptions
from aquanav_tools.shipped import shipped_path
from aquanav_tools.tables import from_table, read_toml


def test_the_shipped_scan_recipe_explains_the_defaults() -> None:
    stages = from_table(_Stages, read_toml(shipped_path("pipelines/build", "scan")), "scan.toml")
    for name, value in vars(stages).items():
        assert value == BuildOptions.__dataclass_fields__[name].default_factory()  # type: ignore[misc]


def test_the_shipped_photo_recipe_explains_the_defaults() -> None:
    table = read_toml(shipped_path("pipelines/build", "photos"))
    assert from_table(ReconstructOptions, table["photos"], "photos.toml") == ReconstructOptions()
