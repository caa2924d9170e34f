"""A real facade with measured cameras (Strecha et al., CVPR 2008)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.reconstruct.features import FeatureOptions, extract_features
from aquanav_tools.reconstruct.georeference.camera_positions import CameraPositions
from aquanav_tools.reconstruct.georeference.place import place
from aquanav_tools.reconstruct.images import read_photos
from aquanav_tools.reconstruct.mapping import MappingOptions, map_photos
from aquanav_tools.reconstruct.matching import MatchOptions, match_features


@pytest.mark.slow
def test_all_fountain_photos_register_within_five_millimetres(data_dir: Path, tmp_path: Path) -> None:
    fountain = data_dir / "img_strecha_fountain_p11_half"
    if not fountain.is_dir():
        pytest.skip(f"{fountain} does not exist")
    photos = read_photos(fountain / "images")
    database = tmp_path / "database.db"
    extract_features(photos, database, FeatureOptions())
    match_features(photos, database, MatchOptions())
    sparse = map_photos(photos, database, tmp_path / "models", MappingOptions())
    assert len(sparse.names) == 11
    truth = {name: _true_centre(fountain / "gt_dense_cameras_fullres" / f"{name}.camera") for name in sparse.names}
    clue = CameraPositions("camera positions", truth).clue(sparse)
    placement = place(sparse.centres, sparse.rotations, [clue])
    errors = np.linalg.norm(
        placement.world_from_sfm.apply(sparse.centres) - np.array([truth[n] for n in sparse.names]), axis=1
    )
    print(f"mean {1000 * errors.mean():.1f} mm, max {1000 * errors.max():.1f} mm")
    assert errors.max() < 0.005


def _true_centre(path: Path) -> np.ndarray:
    """Return the centre from a camera file: K in three lines, a line of zeros, R in three lines, then the centre."""
    return np.array([float(number) for number in path.read_text().splitlines()[7].split()])
