"""Scenes of a room with a corner, which a reader that takes meshes as convex would fill."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.cavity import WALL
from aquanav_tools.export.formats import export_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Array, Mesh
from tests.bullet import needs_bullet
from tests.caves import tube_scenario
from tests.export.test_formats import CENTIMETRE, FIRST_START, NUM_RAYS, bullet_distances, mesh_distances
from tests.export.test_stonefish import DOWN, matrix_of

OUTLINE = np.array([[0.0, -1.5], [20.0, -1.5], [20.0, 12.0], [17.0, 12.0], [17.0, 1.5], [0.0, 1.5]])
"""Of the room, seen from above: two passages, 3 m wide, that meet at a right angle."""
HEIGHTS = -1.5, 1.5
EDGE = OUTLINE[4]
"""Between the passages, upright."""
PASSAGES = np.array([[[0.0, -1.5, -1.5], [20.0, 1.5, 1.5]], [[17.0, -1.5, -1.5], [20.0, 12.0, 1.5]]])
"""The same room as two boxes, lowest and highest corners."""


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """The tube's scenario with the room for a cave."""
    tube = tube_scenario()
    below, above = (np.column_stack([OUTLINE, np.full(6, height)]) for height in HEIGHTS)
    floor = [(0, 1, 5), (1, 4, 5), (1, 2, 4), (2, 3, 4)]
    sides = [face for k in range(6) for face in ((k, (k + 1) % 6, k + 6), ((k + 1) % 6, (k + 1) % 6 + 6, k + 6))]
    faces = np.array([*(face[::-1] for face in floor), *(tuple(n + 6 for n in face) for face in floor), *sides])
    mesh = Mesh(np.concatenate([below, above]), faces)
    labels = np.full(len(faces), WALL)
    cavity = dataclasses.replace(tube.cavity, mesh=mesh, labels=labels, observed=labels == WALL)
    return dataclasses.replace(tube, cavity=cavity, collision=mesh)


@pytest.fixture
def rays(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Origins in the room, unit directions away from the vehicle, and how far off rays leave the room.

    Those that graze the inner edge within a millimetre are left out: by it, float32 tells one passage from the other.
    """
    num = 2 * NUM_RAYS
    directions = rng.normal(size=(num, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[:, 0] = np.abs(directions[:, 0])
    boxes = PASSAGES[rng.integers(2, size=num)]
    low, high = np.maximum(boxes[:, 0], [4.0, -np.inf, -np.inf]) + 0.1, boxes[:, 1] - 0.1
    origins = rng.uniform(low, high)
    with np.errstate(divide="ignore"):
        ends = (PASSAGES - origins[:, None, None]) / directions[:, None, None]  # (N, box, side, axis)
    into, out = ends.min(axis=2).max(axis=2), ends.max(axis=2).min(axis=2)
    # From the box in which it begins, and on through the other if it enters that before it leaves.
    reach = np.where((into <= 0.0) & (out > 0.0), out, 0.0).max(axis=1)
    goes_on = (into <= reach[:, None]) & (out > into)
    reach = np.maximum(reach, np.where(goes_on, out, 0.0).max(axis=1))
    to_edge = EDGE - origins[:, :2]
    beside = to_edge[:, 0] * directions[:, 1] - to_edge[:, 1] * directions[:, 0]
    chosen = np.abs(beside) > 1e-3 * np.linalg.norm(directions[:, :2], axis=1)
    return origins[chosen][:NUM_RAYS], directions[chosen][:NUM_RAYS], reach[chosen][:NUM_RAYS]


def test_the_room_is_what_its_boxes_are(scenario: Scenario, rays: Any) -> None:
    solid = scenario.cavity.mesh.to_trimesh()
    assert solid.is_watertight and solid.volume == pytest.approx(3.0 * (20.0 * 3.0 + 3.0 * 10.5))
    np.testing.assert_allclose(mesh_distances(solid, *rays[:2]), rays[2], atol=1e-4)
    assert (np.abs(rays[2] - mesh_distances(solid.convex_hull, *rays[:2])) > CENTIMETRE).mean() > 0.05


def test_mujoco_sees_round_no_corner(scenario: Scenario, tmp_path: Path, rays: Any) -> None:
    mujoco = pytest.importorskip("mujoco", reason="It is about MuJoCo: pip install mujoco.")
    export_scenario(scenario, "mjcf", tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "scene.xml"))
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    cave, shown = np.zeros(1, np.int32), np.array([0, 1, 0, 0, 0, 0], np.uint8)
    found = [
        mujoco.mj_ray(model, state, origin, way, shown, 1, -1, cave, None)
        for origin, way in zip(*rays[:2], strict=True)
    ]
    np.testing.assert_allclose(found, rays[2], atol=CENTIMETRE)


@needs_bullet
@pytest.mark.parametrize("name", ["urdf", "sdf"])
def test_pybullet_keeps_the_corner(name: str, scenario: Scenario, tmp_path: Path, rays: Any) -> None:
    import pybullet

    export_scenario(scenario, name, tmp_path / "out")
    client = pybullet.connect(pybullet.DIRECT)
    try:
        if name == "urdf":
            pybullet.loadURDF(str(tmp_path / "out" / "cave.urdf"), useFixedBase=True, physicsClientId=client)
            vehicle = tmp_path / "out" / "vehicle.urdf"
            pybullet.loadURDF(str(vehicle), FIRST_START.tolist(), physicsClientId=client)
        else:
            pybullet.loadSDF(str(tmp_path / "out" / "world.sdf"), physicsClientId=client)
        np.testing.assert_allclose(bullet_distances(pybullet, client, *rays[:2]), rays[2], atol=CENTIMETRE)
    finally:
        pybullet.disconnect(client)


def test_openusd_has_the_corner(scenario: Scenario, tmp_path: Path, rays: Any) -> None:
    usd = pytest.importorskip("pxr.Usd", reason="It is about OpenUSD: pip install usd-core.")
    from pxr import UsdGeom

    export_scenario(scenario, "usd", tmp_path / "out")
    stage = usd.Stage.Open(str(tmp_path / "out" / "scene.usda"))
    for path in ("/World/Cave/Visual", "/World/Cave/Collision"):
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(path))
        faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        solid = trimesh.Trimesh(np.array(mesh.GetPointsAttr().Get()), faces, process=False)
        np.testing.assert_allclose(mesh_distances(solid, *rays[:2]), rays[2], atol=CENTIMETRE)


@pytest.mark.parametrize(("name", "file"), [("gltf", "cave.glb"), ("gltf", "collision.glb"), ("obj", "meshes/cave.obj"),
                                            ("obj", "meshes/collision.obj")])  # fmt: skip
def test_meshes_have_the_corner(name: str, file: str, scenario: Scenario, tmp_path: Path, rays: Any) -> None:
    export_scenario(scenario, name, tmp_path / "out")
    solid = trimesh.load(tmp_path / "out" / file, force="mesh", process=False)
    if name == "gltf":  # its y is up
        solid.vertices = np.stack([solid.vertices[:, 0], -solid.vertices[:, 2], solid.vertices[:, 1]], axis=1)
    np.testing.assert_allclose(mesh_distances(solid, *rays[:2]), rays[2], atol=CENTIMETRE)


@pytest.mark.parametrize("kind", ["physical", "visual"])
def test_stonefishs_meshes_have_the_corner(kind: str, scenario: Scenario, tmp_path: Path, rays: Any) -> None:
    export_scenario(scenario, "stonefish", tmp_path / "out")
    cave = ElementTree.parse(tmp_path / "out" / "scenario.scn").getroot().find("static")
    assert cave is not None
    mesh = cave.find(f"{kind}/mesh")
    assert mesh is not None
    solid = trimesh.load(tmp_path / "out" / str(mesh.get("filename")), force="mesh", process=False)
    solid.apply_transform(matrix_of(cave.find("world_transform")) @ matrix_of(cave.find(f"{kind}/origin")))
    origins, directions, truth = rays
    np.testing.assert_allclose(mesh_distances(solid, origins @ DOWN, directions @ DOWN), truth, atol=CENTIMETRE)
