from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from aquanav_tools.photograph.dive import photograph
from aquanav_tools.reconstruct.depth import DepthOptions
from aquanav_tools.reconstruct.features import FeatureOptions
from aquanav_tools.reconstruct.georeference.options import ScaleSources
from aquanav_tools.reconstruct.georeference.sources import read_world
from aquanav_tools.reconstruct.images import PhotoSet, read_photos
from aquanav_tools.reconstruct.reconstruction import Reconstruction, ReconstructOptions, reconstruct
from aquanav_tools.synthetic.caves import SyntheticCave
from tests.reconstruct.scenes import SMALL_DIVE, small_cave

SMALL_OPTIONS = ReconstructOptions(features=FeatureOptions(max_features=2000), depth=DepthOptions(width=240, sources=5))


@dataclass(frozen=True, eq=False)
class Dive:
    """A photographed cave and what was made of its photos."""

    cave: SyntheticCave
    photos: PhotoSet
    workspace: Path
    result: Reconstruction

    @property
    def dense_dir(self) -> Path:
        """The undistorted photos with their depth maps."""
        return next(self.workspace.glob("depth-*")) / "dense"


@pytest.fixture(scope="session")
def small_photos(tmp_path_factory: pytest.TempPathFactory) -> tuple[SyntheticCave, PhotoSet]:
    """A short cave and a dozen photos of it."""
    cave = small_cave()
    folder = tmp_path_factory.mktemp("dive") / "photos"
    photograph(cave, folder, SMALL_DIVE)
    return cave, read_photos(folder)


@pytest.fixture(scope="session")
def dive(small_photos: tuple[SyntheticCave, PhotoSet], tmp_path_factory: pytest.TempPathFactory) -> Dive:
    """The short cave reconstructed from its photos and the surveyed camera positions."""
    cave, photos = small_photos
    workspace = tmp_path_factory.mktemp("workspace")
    world = read_world(ScaleSources(positions=photos.folder / "positions.csv"), photos)
    result = reconstruct(photos, workspace, SMALL_OPTIONS, world)
    return Dive(cave, photos, workspace, result)
