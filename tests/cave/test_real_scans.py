"""Real scans, with facts that their sources state or that were measured with other tools."""

from __future__ import annotations

from pathlib import Path

import manifold3d
import numpy as np
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


def test_the_finnish_cave_is_a_dead_end_behind_its_entrance(data_dir: Path, tmp_path: Path) -> None:
    built = build(data_dir / "scan_finnish_cave1" / "cave1.stl", tmp_path)
    # SOURCE.md: 11.6 m long, one entrance loop, about 20 m3, clearance to 0.68 m; 18 components, non-manifold edges.
    assert len(built.scenario.cavity.portals) == 1
    assert built.scenario.cavity.volume == pytest.approx(20.0, abs=1.5)
    assert built.statistics.max_clearance == pytest.approx(0.68, abs=0.06)
    entrance = built.scenario.cavity.portals[0].centre
    assert np.linalg.norm(built.scenario.guide.centres[0] - entrance) < 2.0
    assert 7.0 < built.statistics.route_length < 11.6
