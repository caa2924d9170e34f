"""cloud.ply as other programs read it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from aquanav_tools.build.cloud_file import write_cloud
from aquanav_tools.types import PointCloud


@pytest.mark.parametrize("is_plain", [True, False])
def test_another_program_reads_the_cloud_back(is_plain: bool, rng: np.random.Generator, tmp_path: Path) -> None:
    points, normals = rng.normal(size=(50, 3)), rng.normal(size=(50, 3))
    colours, counts = rng.integers(0, 256, (50, 3), dtype=np.uint8), rng.integers(2, 400, 50)
    spread = rng.uniform(0.0, 0.1, 50)
    cloud = PointCloud(points) if is_plain else PointCloud(points, normals, colours, counts, spread)
    path = tmp_path / "cloud.ply"
    write_cloud(cloud, path)
    read = trimesh.load(path)
    np.testing.assert_array_equal(read.vertices, points)
    table = read.metadata["_ply_raw"]["vertex"]["data"]
    if is_plain:
        assert table.dtype.names == ("x", "y", "z")
        return
    for k, name in enumerate(("nx", "ny", "nz")):
        np.testing.assert_array_equal(table[name], normals[:, k].astype(np.float32))
    np.testing.assert_array_equal(read.colors[:, :3], colours)
    np.testing.assert_array_equal(table["photos"], counts)
    np.testing.assert_array_equal(table["spread"], spread.astype(np.float32))
