from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from aquanav_tools.cave.synthetic.caves import SyntheticCave
from aquanav_tools.reconstruct.depth import DepthOptions
from aquanav_tools.reconstruct.features import FeatureOptions
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.reconstruction import Reconstruction, ReconstructOptions, reconstruct
from aquanav_tools.reconstruct.render import render_photos
from tests.reconstruct.scenes import SMALL_RENDER, small_cave

SMALL_OPTIONS = ReconstructOptions(features=FeatureOptions(max_features=2000), depth=DepthOptions(width=240, sources=5))


@dataclass(frozen=True, eq=False)
class Dive:
    """A photographed cave and what was made of its photos."""

    cave: SyntheticCave
    photos: PhotoSet
    workspace: Path
    result: Reconstruction


@pytest.fixture(scope="session")
def small_photos(tmp_path_factory: pytest.TempPathFactory) -> tuple[SyntheticCave, PhotoSet]:
    """A short cave and a dozen photos of it."""
    cave = small_cave()
    return cave, render_photos(cave, tmp_path_factory.mktemp("dive") / "photos", SMALL_RENDER)


@pytest.fixture(scope="session")
def dive(small_photos: tuple[SyntheticCave, PhotoSet], tmp_path_factory: pytest.TempPathFactory) -> Dive:
    """The short cave reconstructed from its photos and the surveyed camera positions."""
    cave, photos = small_photos
    workspace = tmp_path_factory.mktemp("workspace")
    result = reconstruct(photos, workspace, SMALL_OPTIONS, photos.folder / "positions.csv")
    return Dive(cave, photos, workspace, result)
