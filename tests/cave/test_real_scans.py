"""A real scan, with facts that its source states or that were measured with other tools.

Another is built in measure/test_cave_outliner.py, in the default tests.
"""

from __future__ import annotations

from pathlib import Path

import manifold3d
import pytest

from aquanav_tools.build.cave_stages import BuiltCave, build_scenario
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.cave.cavity import to_manifold
from aquanav_tools.cave.options import ScanOptions
from aquanav_tools.cave.scan.read import read_scan
from aquanav_tools.types import silent


def build(path: Path, tmp_path: Path) -> BuiltCave:
    if not path.exists():
        pytest.skip(f"No real data: {path} does not exist.")
    options = BuildOptions(path, tmp_path / path.stem)
    return build_scenario(read_scan(path, ScanOptions()).surface, options, Journal(silent))


@pytest.mark.slow
def test_han_sur_lesse_is_a_passage_of_57_m3_between_two_portals(data_dir: Path, tmp_path: Path) -> None:
    built = build(data_dir / "scan_han_sur_lesse" / "cave.stl", tmp_path)
    cavity = built.scenario.cavity
    assert to_manifold(cavity.mesh).status() == manifold3d.Error.NoError
    solid = cavity.mesh.to_trimesh()
    assert solid.is_volume
    assert solid.body_count == 1
    # SOURCE.md: 57 m3 once capped, ends 2.5 and 2.0 m across, largest clearance 0.66 m, end to end over 30 m.
    assert cavity.volume == pytest.approx(57.0, abs=1.0)
    assert len(cavity.portals) == 2
    assert sorted(portal.centre[1] for portal in cavity.portals) == pytest.approx([-33.8, -3.4], abs=0.2)
    assert built.statistics.max_clearance == pytest.approx(0.66, abs=0.02)
    assert 28.0 < built.statistics.route_length < 31.0
    assert built.fit.median < 1e-5  # the scan's own triangles were kept
    assert len(built.scenario.starts) >= 20
    assert built.scenario.field.clearance(built.scenario.guide.centreline).min() > 0.27
