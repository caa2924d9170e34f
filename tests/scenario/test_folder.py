from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.cave.water.flow import flow_from_bricks
from aquanav_tools.errors import ScenarioError
from aquanav_tools.geometry.volume.field import BRICK
from aquanav_tools.scenario import geometry
from aquanav_tools.scenario.folder import read_scenario, write_scenario
from aquanav_tools.scenario.schema import LimitSettings, Scenario, WaterSettings, WaveSettings
from aquanav_tools.sim.batch.water import flow_velocities
from tests.caves import tube_scenario

Change = Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]]


@pytest.fixture
def folder(tube: Scenario, tmp_path: Path) -> Path:
    write_scenario(tube, tmp_path / "tube")
    return tmp_path / "tube"


def replace_in(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_a_scenario_in_use_is_shared_until_its_files_change(tube: Scenario, tmp_path: Path) -> None:
    first = write_scenario(tube, tmp_path / "tube")
    assert read_scenario(tmp_path / "tube") is first
    renamed = dataclasses.replace(tube, settings=dataclasses.replace(tube.settings, name="other"))
    assert write_scenario(renamed, tmp_path / "tube").name == "other"
    assert first.name == tube.name


def test_reading_finishes_what_a_killed_build_began_to_put_in_place(tube: Scenario, folder: Path) -> None:
    renamed = dataclasses.replace(tube, settings=dataclasses.replace(tube.settings, name="newer"))
    write_scenario(renamed, folder / ".ready")
    (folder / ".ready" / "cave.ply").rename(folder / "cave.ply")  # as far as it came
    assert read_scenario(folder).name == "newer"
    assert not (folder / ".ready").exists()


def test_a_scenario_reads_back_as_it_was_written(tmp_path: Path) -> None:
    water = WaterSettings(density=1025.0, current=(0.1, 0.0, -0.2))
    written = tube_scenario(water=water, limits=LimitSettings(decisions=77))
    read = write_scenario(written, tmp_path / "tube")
    assert read.settings == written.settings
    assert np.array_equal(read.cavity.mesh.faces, written.cavity.mesh.faces)
    assert np.array_equal(read.cavity.labels, written.cavity.labels)
    assert np.array_equal(read.cavity.observed, written.cavity.observed)
    assert np.array_equal(read.cavity.mesh.vertices, written.cavity.mesh.vertices.astype(np.float32))
    assert np.array_equal(read.field.bricks, written.field.bricks)
    assert np.array_equal(read.field.samples, written.field.samples)
    assert np.array_equal(read.guide.centres, written.guide.centres)
    assert [s.geodesic_to_goal for s in read.starts] == [s.geodesic_to_goal for s in written.starts]
    assert [p.area for p in read.cavity.portals] == [p.area for p in written.cavity.portals]


def test_the_same_scenario_gives_the_same_bytes(tube: Scenario, tmp_path: Path) -> None:
    one, two = write_scenario(tube, tmp_path / "one"), write_scenario(tube, tmp_path / "two")
    assert one.content_hash == two.content_hash


def test_an_unknown_key_is_refused_with_the_closest_match(folder: Path) -> None:
    replace_in(folder / "scenario.toml", "vehicle =", "vehicel =")
    with pytest.raises(ScenarioError, match=r"unknown key 'vehicel'\. Did you mean 'vehicle'\?"):
        read_scenario(folder)


def test_a_value_out_of_range_is_refused_with_the_range(folder: Path) -> None:
    replace_in(folder / "scenario.toml", "dt = 0.02", "dt = 2.0")
    with pytest.raises(ScenarioError, match=r"limits\.dt = 2\.0 is outside \[0\.0001, 0\.1\]"):
        read_scenario(folder)


def test_a_wrong_type_is_refused(folder: Path) -> None:
    replace_in(folder / "scenario.toml", "substeps = 5", 'substeps = "5"')
    with pytest.raises(ScenarioError, match="substeps must be of type int, not str"):
        read_scenario(folder)


@pytest.mark.parametrize("name", ["cave.ply", "collision.obj", "field.npz", "guide.json", "starts.json"])
def test_a_changed_file_is_noticed(folder: Path, name: str) -> None:
    with (folder / name).open("ab") as stream:
        stream.write(b" ")
    with pytest.raises(ScenarioError, match=f"{name} has changed since"):
        read_scenario(folder)


def test_a_missing_file_is_noticed(folder: Path) -> None:
    (folder / "field.npz").unlink()
    with pytest.raises(ScenarioError, match=r"lacks its file field\.npz"):
        read_scenario(folder)


def test_a_link_out_of_the_folder_is_refused(folder: Path, tmp_path: Path) -> None:
    shutil.move(folder / "guide.json", tmp_path / "guide.json")
    (folder / "guide.json").symlink_to(tmp_path / "guide.json")
    with pytest.raises(ScenarioError, match=r"lacks its file guide\.json"):
        read_scenario(folder)


def test_a_folder_without_settings_is_not_a_scenario(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="is not a scenario"):
        read_scenario(tmp_path)


def test_a_scenario_carries_its_vehicle(tube: Scenario, tmp_path: Path) -> None:
    text = 'name = "mine"  # a vehicle\'s own file\n'
    assert write_scenario(dataclasses.replace(tube, vehicle_toml=text), tmp_path / "tube").vehicle_toml == text


def test_a_vehicle_that_is_a_path_is_refused(folder: Path) -> None:
    replace_in(folder / "scenario.toml", 'vehicle = "bluerov2"', 'vehicle = "../other.toml"')
    with pytest.raises(ScenarioError, match=r"vehicle = '\.\./other\.toml' is no name"):
        read_scenario(folder)


def test_a_guide_with_a_non_finite_number_is_refused(tube: Scenario, tmp_path: Path) -> None:
    path = tmp_path / "guide.json"
    geometry.write_guide(tube.guide, tube.cavity.portals, path)
    table = json.loads(path.read_text())
    table["panels"][0]["centre"][0] = float("nan")
    path.write_text(json.dumps(table))
    with pytest.raises(ScenarioError, match="not finite"):
        geometry.read_guide(path)


def field_arrays(tube: Scenario) -> dict[str, np.ndarray]:
    cores = tube.field.samples[:, :BRICK, :BRICK, :BRICK]
    return {
        "origin": tube.field.origin,
        "spacing": np.array(tube.field.spacing),
        "bricks": tube.field.bricks,
        "clearance": cores,
    }


@pytest.mark.parametrize(
    ("change", "advice"),
    [
        (lambda f: {"bricks": np.where(f["bricks"] == 7, 9999, f["bricks"]).astype(np.int32)}, "to 9999, but holds"),
        (lambda f: {"bricks": -f["bricks"]}, "names bricks -"),
        (lambda f: {"bricks": f["bricks"].astype(np.int64)}, "is of type int64"),
        (lambda f: {"bricks": f["bricks"][0]}, "is of type int32 and shape"),
        (lambda f: {"clearance": np.full_like(f["clearance"], np.nan)}, "not finite"),
        (lambda f: {"clearance": f["clearance"][:, :4]}, "is of type float32 and shape"),
        (lambda f: {"clearance": f["clearance"][:0]}, "has bricks"),
        (lambda f: {"clearance": np.array([None])}, "is of type object"),
        (lambda f: {"spacing": np.array(0.0)}, "and spacing 0.0"),
        (lambda f: {"spacing": np.array(np.inf)}, "not finite"),
    ],
)
def test_a_field_that_cannot_be_is_refused(tube: Scenario, tmp_path: Path, change: Change, advice: str) -> None:
    arrays = field_arrays(tube)
    np.savez_compressed(tmp_path / "field.npz", **{**arrays, **change(arrays)})
    with pytest.raises(ScenarioError, match=advice):
        geometry.read_field(tmp_path / "field.npz")


def test_a_field_that_promises_more_than_it_may_hold_is_refused_unread(tube: Scenario, tmp_path: Path) -> None:
    header = io.BytesIO()
    shape = (2_000_000, BRICK, BRICK, BRICK)
    np.lib.format.write_array_header_1_0(header, {"descr": "<f4", "fortran_order": False, "shape": shape})
    path = tmp_path / "field.npz"
    np.savez(path, **{name: array for name, array in field_arrays(tube).items() if name != "clearance"})
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("clearance.npy", header.getvalue())
    with pytest.raises(ScenarioError, match="clearance takes 4096000000 bytes, more than 1000000000"):
        geometry.read_field(path)


@pytest.mark.parametrize(("place", "value"), [(10, 99), (8, 1)], ids=["an unknown compression", "said to be encrypted"])
def test_a_field_in_a_zip_that_python_does_not_unpack_is_refused(
    tube: Scenario, tmp_path: Path, place: int, value: int
) -> None:
    path = tmp_path / "field.npz"
    np.savez(path, **field_arrays(tube))
    content = path.read_bytes()
    entry = bytes([80, 75, 1, 2])  # of the directory at the end; what it says of a member counts
    for at in [match.start() for match in re.finditer(re.escape(entry), content)]:
        content = content[: at + place] + bytes([value]) + content[at + place + 1 :]
    path.write_bytes(content)
    with pytest.raises(ScenarioError, match=r"field\.npz is not a distance field"):
        geometry.read_field(path)


def test_a_vehicle_that_is_no_text_is_refused_with_the_byte(tube: Scenario, tmp_path: Path) -> None:
    folder = tmp_path / "tube"
    write_scenario(dataclasses.replace(tube, vehicle_toml='name = "a"\n'), folder)
    damaged = b'name = "\xe9"\n'  # an e with an accent in Latin-1
    (folder / "vehicle.toml").write_bytes(damaged)
    settings = folder / "scenario.toml"
    old, new = (hashlib.sha256(content).hexdigest() for content in (b'name = "a"\n', damaged))
    settings.write_text(settings.read_text().replace(old, new))
    with pytest.raises(ScenarioError, match=r"vehicle\.toml is not text in UTF-8: byte 8 \(line 1\) is 0xe9"):
        read_scenario(folder)


def test_settings_are_frozen(tube: Scenario) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        tube.settings.name = "other"  # type: ignore[misc]


def test_the_flow_comes_back_as_it_was_written(tube: Scenario, tmp_path: Path) -> None:
    bricks = np.zeros((2, 1, 1), dtype=np.int32)
    bricks[0, 0, 0], bricks[1, 0, 0] = 1, 2
    cores = np.random.default_rng(0).normal(size=(3, 8, 8, 8, 3)).astype(np.float32)
    narrowest, shares = np.array([2.0, 0.0, 0.0, 0.0]), ((1, 1.0), (2, -1.0))
    flow = flow_from_bricks(np.array([1.0, 2.0, 3.0]), 0.5, bricks, cores, narrowest, shares)
    water = WaterSettings(current="half", turbulence=0.1, surface=2.0, waves=WaveSettings(height=0.2))
    settings = dataclasses.replace(tube.settings, water=water)
    back = write_scenario(dataclasses.replace(tube, flow=flow, settings=settings), tmp_path / "tube")
    assert back.flow is not None
    np.testing.assert_array_equal(back.flow.samples, flow.samples)
    assert back.flow.shares == flow.shares
    assert back.settings.water == water
    # Trilinear across the border of two bricks: half-way between the last sample of one and the first of the next.
    middle = 0.5 * (cores[1, 7, 2, 3] + cores[2, 0, 2, 3])
    place = back.flow.origin + 0.5 * np.array([7.5, 2.0, 3.0])
    np.testing.assert_allclose(flow_velocities(back.flow, place)[0], middle, rtol=1e-6)


def test_a_folder_without_a_flow_still_reads(tube: Scenario, tmp_path: Path) -> None:
    assert write_scenario(tube, tmp_path / "tube").flow is None


@pytest.mark.parametrize(
    ("current", "advice"),
    [
        ('"ful"', "no preset.*Did you mean 'full'"),
        ("[0.1, 0.2]", "must have 3 values"),
        ("50.0", "outside"),
    ],
)
def test_a_wrong_current_is_refused(tube: Scenario, tmp_path: Path, current: str, advice: str) -> None:
    write_scenario(tube, tmp_path / "tube")
    path = tmp_path / "tube" / "scenario.toml"
    path.write_text(path.read_text().replace('current = "still"', f"current = {current}"))
    with pytest.raises(ScenarioError, match=advice):
        read_scenario(tmp_path / "tube")
