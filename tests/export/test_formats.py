"""Scenes are read by software of others, whose rays meet the wall where it is."""

from __future__ import annotations

import dataclasses
import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from aquanav_tools.cli.info import main
from aquanav_tools.export.formats import FORMATS, export_scenario
from aquanav_tools.export.numbers import roll_pitch_yaw, rotation_to
from aquanav_tools.report.viewer_model import write_glb
from aquanav_tools.scenario.folder import read_scenario, write_scenario
from aquanav_tools.scenario.schema import Scenario, WaterSettings
from aquanav_tools.sim.vehicle import vehicle_path
from aquanav_tools.types import rotation_matrix
from tests.bullet import needs_bullet
from tests.caves import TUBE_RADIUS, tube_cavity, tube_scenario
from tests.commands import run_here

NUM_RAYS = 10_000
CENTIMETRE = 0.01
"""What was asked for; float32 rounds to micrometres at 20 m."""
FIRST_START = np.array([1.5, -0.5, 0.0])


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """A tube of still water with a vehicle that has thrusters."""
    water = WaterSettings(density=1025.0)
    text = vehicle_path("bluerov2-heavy").read_text(encoding="utf-8")
    return dataclasses.replace(tube_scenario(water=water), vehicle_toml=text)


def exported(scenario: Scenario, name: str, folder: Path) -> Path:
    export_scenario(scenario, name, folder)
    return folder


@pytest.fixture
def rays(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins in the water, unit directions, and the true distances: the tube is convex, so its planes tell them.

    They leave out a ball around the first start, where the vehicle is, and rays that would meet it.
    """
    directions = rng.normal(size=(NUM_RAYS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[:, 0] = np.abs(directions[:, 0])  # away from the vehicle, which is behind all origins
    origins = np.stack([rng.uniform(4.0, 19.0, NUM_RAYS), *rng.uniform(-1.2, 1.2, (2, NUM_RAYS))], axis=1)
    mesh = tube_cavity().mesh
    offsets = np.einsum("fi,fi->f", mesh.normals, mesh.triangles[:, 0])
    speeds = directions @ mesh.normals.T
    gaps = offsets - origins @ mesh.normals.T
    ahead = np.where(speeds > 1e-12, gaps / np.maximum(speeds, 1e-12), np.inf)
    return origins, directions, ahead.min(axis=1)


def mesh_distances(mesh: trimesh.Trimesh, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return where rays first meet a mesh, by Embree; infinite where one meets nothing."""
    places, numbers, _ = mesh.ray.intersects_location(origins, directions, multiple_hits=False)
    distances = np.full(len(origins), np.inf)
    distances[numbers] = np.linalg.norm(places - origins[numbers], axis=1)
    return distances


def bullet_distances(bullet: Any, client: int, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    reach, step, hits = 30.0, 5_000, []  # PyBullet takes 16384 rays at a time
    for first in range(0, len(origins), step):
        some = slice(first, first + step)
        ends = origins[some] + reach * directions[some]
        hits += bullet.rayTestBatch(origins[some].tolist(), ends.tolist(), physicsClientId=client)
    return reach * np.array([hit[2] for hit in hits])


def test_mujoco_sees_and_touches_the_wall(scenario: Scenario, tmp_path: Path, rays: Any) -> None:
    mujoco = pytest.importorskip("mujoco", reason="It is about MuJoCo: pip install mujoco.")
    model = mujoco.MjModel.from_xml_path(str(exported(scenario, "mjcf", tmp_path / "out") / "scene.xml"))
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    cave, shown = np.zeros(1, np.int32), np.array([0, 1, 0, 0, 0, 0], np.uint8)
    origins, directions, truth = rays
    found = [
        mujoco.mj_ray(model, state, origin, way, shown, 1, -1, cave, None)
        for origin, way in zip(origins, directions, strict=True)
    ]
    np.testing.assert_allclose(found, truth, atol=CENTIMETRE)
    vehicle = model.body("vehicle")
    assert vehicle.mass[0] == pytest.approx(13.5)
    np.testing.assert_allclose(vehicle.inertia, [0.26, 0.23, 0.37], rtol=1e-6)
    np.testing.assert_allclose(state.xpos[vehicle.id], FIRST_START)
    assert model.opt.density == 1025.0
    assert (model.nu, model.nsensor, model.nkey) == (8, 28, len(scenario.starts))
    state.xfrc_applied[vehicle.id, 2] = -20.0  # pressed down, it comes to lie on the wall and not on a hull around it
    mujoco.mj_step(model, state, 4_000)
    across = np.linalg.norm(state.xpos[vehicle.id][1:])
    assert TUBE_RADIUS - 0.2875 - 0.02 < across < TUBE_RADIUS - 0.2875 + 0.01


def test_mujoco_pushes_the_vehicle_along_its_thrusters(scenario: Scenario, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="It is about MuJoCo: pip install mujoco.")
    model = mujoco.MjModel.from_xml_path(str(exported(scenario, "mjcf", tmp_path / "out") / "scene.xml"))
    state = mujoco.MjData(model)
    state.ctrl[4:] = 10.0  # the four upright ones
    mujoco.mj_forward(model, state)
    np.testing.assert_allclose(state.qfrc_actuator[:6], [0.0, 0.0, 40.0, 0.0, 0.0, 0.0], atol=1e-9)
    wall = state.sensor("ray-0").data[0]  # ahead and up by 14.9 degrees; its end is at a quarter of (15, 4) m
    assert wall == pytest.approx(min(np.hypot(3.75, 1.0), 5.0), abs=CENTIMETRE)


@needs_bullet
@pytest.mark.parametrize("name", ["urdf", "sdf"])
def test_pybullet_loads_cave_and_vehicle(name: str, scenario: Scenario, tmp_path: Path, rays: Any) -> None:
    import pybullet

    folder = exported(scenario, name, tmp_path / "out")
    client = pybullet.connect(pybullet.DIRECT)
    try:
        if name == "urdf":
            pybullet.loadURDF(str(folder / "cave.urdf"), useFixedBase=True, physicsClientId=client)
            vehicle = pybullet.loadURDF(str(folder / "vehicle.urdf"), FIRST_START.tolist(), physicsClientId=client)
        else:
            _, vehicle = pybullet.loadSDF(str(folder / "world.sdf"), physicsClientId=client)
        mass = pybullet.getDynamicsInfo(vehicle, -1, physicsClientId=client)[0]
        np.testing.assert_allclose(bullet_distances(pybullet, client, *rays[:2]), rays[2], atol=CENTIMETRE)
        place, _ = pybullet.getBasePositionAndOrientation(vehicle, physicsClientId=client)
    finally:
        pybullet.disconnect(client)
    assert mass == pytest.approx(13.5)
    np.testing.assert_allclose(place, FIRST_START, atol=1e-6)


def test_openusd_reads_meshes_and_places(scenario: Scenario, tmp_path: Path, rays: Any) -> None:
    usd = pytest.importorskip("pxr.Usd", reason="It is about OpenUSD: pip install usd-core.")
    from pxr import UsdGeom, UsdPhysics

    stage = usd.Stage.Open(str(exported(scenario, "usd", tmp_path / "out") / "scene.usda"))
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    for path in ("/World/Cave/Visual", "/World/Cave/Collision"):
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(path))
        faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        solid = trimesh.Trimesh(np.array(mesh.GetPointsAttr().Get()), faces, process=False)
        np.testing.assert_allclose(mesh_distances(solid, *rays[:2]), rays[2], atol=CENTIMETRE)
        assert solid.volume < 0.0, "faces look into the water"
    cave = stage.GetPrimAtPath("/World/Cave")
    assert cave.GetVariantSet("lod").GetVariantNames() == ["lod0", "lod1", "lod2"]
    vehicle = stage.GetPrimAtPath("/World/Vehicle")
    assert UsdPhysics.MassAPI(vehicle).GetMassAttr().Get() == pytest.approx(13.5)
    place = UsdGeom.Xformable(vehicle).ComputeLocalToWorldTransform(usd.TimeCode.Default()).ExtractTranslation()
    np.testing.assert_allclose(place, FIRST_START)
    route = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/Route")).GetPointsAttr().Get()
    np.testing.assert_allclose(route, scenario.guide.centreline, atol=1e-5)


@pytest.mark.parametrize(("name", "file"), [("gltf", "cave.glb"), ("gltf", "collision.glb"), ("obj", "meshes/cave.obj"),
                                            ("obj", "meshes/collision.obj")])  # fmt: skip
def test_trimesh_reads_the_meshes(name: str, file: str, scenario: Scenario, tmp_path: Path, rays: Any) -> None:
    solid = trimesh.load(exported(scenario, name, tmp_path / "out") / file, force="mesh", process=False)
    if name == "gltf":  # its y is up
        solid.vertices = np.stack([solid.vertices[:, 0], -solid.vertices[:, 2], solid.vertices[:, 1]], axis=1)
    np.testing.assert_allclose(mesh_distances(solid, *rays[:2]), rays[2], atol=CENTIMETRE)


def test_trimesh_reads_the_lines_of_a_gltf(scenario: Scenario, tmp_path: Path) -> None:
    lines = trimesh.load(exported(scenario, "gltf", tmp_path / "out") / "places.glb").geometry
    assert {"route", "panel-0", "portal-1", "start-0"} <= set(lines)
    ends = np.asarray(lines["route"].vertices)[[0, -1]]
    expected = scenario.guide.centreline[[0, -1]]
    np.testing.assert_allclose(np.stack([ends[:, 0], -ends[:, 2], ends[:, 1]], axis=1), expected, atol=1e-5)


def test_an_obj_has_the_colour_of_every_face(scenario: Scenario, tmp_path: Path) -> None:
    solid = trimesh.load(exported(scenario, "obj", tmp_path / "out") / "meshes" / "cave.obj", process=False)
    u, v = solid.visual.uv[solid.faces[:, 0]].T
    pixels = np.asarray(solid.visual.material.image.convert("RGB"))
    shown = pixels[((1.0 - v) * pixels.shape[0]).astype(int), (u * pixels.shape[1]).astype(int)]
    is_lid = np.abs(solid.face_normals[:, 0]) > 0.9
    half_a_step = 255 / 31 / 2
    for chosen, colour in ((is_lid, (251, 86, 7)), (~is_lid, (126, 150, 160))):  # portals, rock
        assert np.abs(shown[chosen].astype(float) - colour).max() <= half_a_step + 0.5


def test_colours_of_a_built_cave_come_from_its_picture(scenario: Scenario, tmp_path: Path) -> None:
    write_scenario(scenario, tmp_path / "cave")
    colours = np.random.default_rng(1).integers(0, 256, scenario.cavity.mesh.vertices.shape).astype(np.uint8)
    write_glb(scenario.cavity, scenario.collision, tmp_path / "cave" / "cave.glb", colours)
    _, notes = export_scenario(read_scenario(tmp_path / "cave"), "obj", tmp_path / "out")
    assert not any("colours" in note for note in notes)
    (tmp_path / "cave" / "cave.glb").write_bytes(b"glTF, once")
    done = run_here(main, "export", tmp_path / "cave", "--to", "obj", "-o", tmp_path / "other")
    assert done.returncode == 2 and "is not a GLB of a cave" in done.stderr


def test_the_current_is_a_table_and_a_grid(tmp_path: Path) -> None:
    running = tube_scenario(water=WaterSettings(current=(0.25, 0.0, 0.0)))
    folder = exported(running, "obj", tmp_path / "out")
    rows = np.loadtxt(folder / "current.csv", delimiter=",", skiprows=1)
    assert (np.linalg.norm(rows[:, 1:3], axis=1) <= TUBE_RADIUS).all() and len(rows) > 1_000
    np.testing.assert_allclose(rows[:, 3:], np.tile([0.25, 0.0, 0.0], (len(rows), 1)))
    pyvista = pytest.importorskip("pyvista", reason="The grid is for VTK: pip install pyvista.")
    grid = pyvista.read(folder / "current.vti")
    water = grid["clearance"] > 0.0
    assert water.sum() == len(rows)
    np.testing.assert_allclose(np.linalg.norm(grid["velocity"][water], axis=1), 0.25)
    middle = grid.find_closest_point((10.0, 0.0, 0.0))
    assert grid["clearance"][middle] == pytest.approx(TUBE_RADIUS, abs=grid.spacing[0])


@pytest.mark.parametrize("name", sorted(FORMATS))
def test_every_format_comes_with_all_that_is_known(name: str, scenario: Scenario, tmp_path: Path) -> None:
    table = json.loads((exported(scenario, name, tmp_path / "out") / "scene.json").read_text())
    assert [lid["label"] for lid in table["portals"]] == [1, 2]
    assert table["starts"][0]["position"] == FIRST_START.tolist()
    assert (len(table["panels"]), len(table["route"]), table["goal"]["position"]) == (10, 181, [19.0, 0.0, 0.0])
    assert table["water"]["density"] == 1025.0
    assert len(table["vehicle"]["thrusters"]) == 8 and np.shape(table["vehicle"]["added_mass"]) == (6, 6)


def test_an_sdf_world_has_a_frame_for_every_place(scenario: Scenario, tmp_path: Path) -> None:
    world = ElementTree.parse(exported(scenario, "sdf", tmp_path / "out") / "world.sdf").getroot()[0]
    poses = {frame.get("name"): [float(word) for word in frame[0].text.split()] for frame in world.findall("frame")}  # type: ignore[union-attr]
    assert poses["start-0"] == [1.5, -0.5, 0.0, 0.0, 0.0, 0.0]
    assert poses["portal-2"][:3] == [20.0, 0.0, 0.0]
    assert poses["panel-0"] == pytest.approx([1.0, 0.0, 0.0, 0.0, np.pi / 2, 0.0])  # its z along the way, +x


def test_turns_take_z_to_a_direction_and_angles_say_the_same(rng: np.random.Generator) -> None:
    up = np.array([0.0, 0.0, 1.0])
    ways = [*rng.normal(size=(20, 3)), *np.eye(3), *-np.eye(3)]
    for way in (way / np.linalg.norm(way) for way in ways):
        turn = rotation_matrix(rotation_to(way))
        np.testing.assert_allclose(turn @ up, way, atol=1e-12)
        matrix = trimesh.transformations.euler_matrix(*roll_pitch_yaw(rotation_to(way)), "sxyz")[:3, :3]
        np.testing.assert_allclose(matrix, turn, atol=1e-7)  # arcsin near 1 halves the digits


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--to", "mjfc", "-o", "new"), "There is no format 'mjfc'. Did you mean 'mjcf'?"),
        (("--to", "mjcf", "-o", "full"), "full exists and is no empty folder; nothing was written"),
        (("--to", "mjcf", "-o", "file"), "file exists and is no empty folder; nothing was written"),
    ],
)
def test_a_bad_format_or_target_gets_a_sentence(
    arguments: tuple[str, ...], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("kept")
    (tmp_path / "file").write_text("kept")
    done = run_here(main, "export", "cave-test-1", *arguments)
    assert done.returncode == 2 and words in done.stderr
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "full", "mine.txt"]


def test_what_a_scenario_lacks_is_said(tmp_path: Path) -> None:
    bare = tube_scenario()
    sealed = dataclasses.replace(bare.cavity, labels=np.zeros_like(bare.cavity.labels), portals=())
    write_scenario(dataclasses.replace(bare, cavity=sealed), tmp_path / "cave")
    done = run_here(main, "export", tmp_path / "cave", "--to", "sdf", "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    for words in ("has no colours of a scan", "has no portals", "has no current"):
        assert f"Note: The scenario {words}" in done.stdout
    assert str(tmp_path / "out" / "world.sdf") in done.stdout
