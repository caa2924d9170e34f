"""Scenarios for Stonefish, which has no packages: held to its syntax, the wall to rays, turns to trimesh's."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import trimesh
from trimesh.transformations import euler_matrix

from aquanav_tools.export.formats import export_scenario
from aquanav_tools.scenario.schema import Scenario, WaterSettings
from aquanav_tools.types import rotation_matrix
from tests.caves import tube_scenario
from tests.export.test_formats import CENTIMETRE, mesh_distances, rays, scenario

__all__ = ["rays", "scenario"]  # fixtures

POSE = {"xyz", "rpy"}
SYNTAX: dict[str, tuple[set[str], set[str]]] = {
    "scenario": (set(), {"environment", "materials", "looks", "static", "robot"}),
    "environment": (set(), {"ned", "ocean", "atmosphere"}),
    "ned": ({"latitude", "longitude"}, set()),
    "ocean": (set(), {"water", "waves", "current"}),
    "water": ({"density", "jerlov"}, set()),
    "waves": ({"height"}, set()),
    "current": ({"type"}, {"velocity"}),
    "velocity": ({"xyz"}, set()),
    "atmosphere": (set(), {"sun"}),
    "sun": ({"azimuth", "elevation"}, set()),
    "materials": (set(), {"material", "friction_table"}),
    "friction_table": (set(), {"friction"}),
    "friction": ({"material1", "material2", "static", "dynamic"}, set()),
    "looks": (set(), {"look"}),
    "static": ({"name", "type"}, {"physical", "visual", "material", "look", "world_transform"}),
    "physical": (set(), {"mesh", "origin"}),
    "visual": (set(), {"mesh", "origin"}),
    "mesh": ({"filename", "scale"}, set()),
    "origin": (POSE, set()),
    "world_transform": (POSE, set()),
    "robot": (
        {"name", "fixed", "self_collisions"},
        {"base_link", "actuator", "light", "world_transform"},
    ),
    "base_link": (
        {"name", "type", "physics", "buoyant"},
        {"physical", "material", "look", "mass", "inertia", "cg"},
    ),
    "mass": ({"value"}, set()),
    "inertia": ({"xyz"}, set()),
    "cg": (POSE, set()),
    "actuator": ({"name", "type"}, {"specs", "origin", "link"}),
    "light": ({"name"}, {"specs", "color", "origin", "link"}),
    "color": ({"temperature"}, set()),
    "link": ({"name"}, set()),
}
"""Attributes and elements within, of each element, from its documentation; those with several forms are below."""
FORMS = {
    ("materials", "material"): {"name", "density", "restitution"},
    ("static", "material"): {"name"},
    ("base_link", "material"): {"name"},
    ("looks", "look"): {"name", "gray", "roughness", "texture"},
    ("static", "look"): {"name"},
    ("base_link", "look"): {"name"},
    ("actuator", "specs"): {"lower_limit", "upper_limit", "inverted"},
    ("light", "specs"): {"radius", "illuminance"},
}
DOWN = np.diag([1.0, -1.0, -1.0])


def check(element: ElementTree.Element, parent: str = "") -> None:
    """Hold an element, and what is in it, to the syntax."""
    attributes, inner = SYNTAX.get(element.tag) or (FORMS[parent, element.tag], set())
    assert set(element.keys()) == attributes, element.tag
    for part in element:
        assert part.tag in inner, f"{part.tag} in {element.tag}"
        check(part, element.tag)


def matrix_of(element: ElementTree.Element | None) -> np.ndarray:
    """Return the (4, 4) matrix of a pose."""
    assert element is not None
    place, angles = (np.array(element.get(name, "").split(), dtype=float) for name in ("xyz", "rpy"))
    matrix: np.ndarray = euler_matrix(*angles, "sxyz")
    matrix[:3, 3] = place
    return matrix


@pytest.fixture
def folder(scenario: Scenario, tmp_path: Path) -> Path:
    assert export_scenario(scenario, "stonefish", tmp_path / "out")[0] == ("scenario.scn",)
    return tmp_path / "out"


def root_of(folder: Path) -> ElementTree.Element:
    return ElementTree.parse(folder / "scenario.scn").getroot()


def test_a_scenario_keeps_to_the_published_syntax(folder: Path) -> None:
    root = root_of(folder)
    check(root)
    named = [element.get(key) for element in root.iter() for key in ("filename", "texture") if key in element.keys()]
    assert len(named) == 4 and all((folder / str(name)).is_file() for name in named)
    known = {element.get("name") for element in root.findall("materials/material")}
    used = {element.get("name") for body in root for element in body.iter("material")} - known
    assert used == set() and known == {"rock", "hull"}


@pytest.mark.parametrize("kind", ["physical", "visual"])
def test_rays_meet_the_wall_of_a_scenario(kind: str, folder: Path, rays: tuple[np.ndarray, ...]) -> None:
    cave = root_of(folder).find("static")
    assert cave is not None
    mesh = cave.find(f"{kind}/mesh")
    assert mesh is not None and mesh.get("scale") == "1.0"
    solid = trimesh.load(folder / str(mesh.get("filename")), force="mesh", process=False)
    solid.apply_transform(matrix_of(cave.find("world_transform")) @ matrix_of(cave.find(f"{kind}/origin")))
    origins, directions, truth = rays
    np.testing.assert_allclose(mesh_distances(solid, origins @ DOWN, directions @ DOWN), truth, atol=CENTIMETRE)
    assert solid.volume < 0.0, "faces look into the water"


def test_the_vehicle_lies_at_the_start_and_its_thrusters_push_as_in_its_file(scenario: Scenario, folder: Path) -> None:
    robot = root_of(folder).find("robot")
    assert robot is not None
    start = scenario.starts[0].pose
    pose = matrix_of(robot.find("world_transform"))
    np.testing.assert_allclose(pose[:3, 3], DOWN @ start.position)
    np.testing.assert_allclose(pose[:3, :3], DOWN @ rotation_matrix(start.orientation) @ DOWN, atol=1e-7)
    assert robot.find("base_link/mass").get("value") == "13.5"  # type: ignore[union-attr]
    upright, turning = np.zeros(3), np.zeros(3)
    for actuator in robot.findall("actuator")[4:]:  # the four upright ones of a BlueROV2 Heavy
        matrix = matrix_of(actuator.find("origin"))
        upright += matrix[:3, 0]
        turning += np.cross(matrix[:3, 3], matrix[:3, 0])
    np.testing.assert_allclose(upright, [0.0, 0.0, -4.0], atol=1e-6)  # up is -z
    np.testing.assert_allclose(turning, 0.0, atol=1e-6)


def test_the_mean_current_is_the_oceans(tmp_path: Path) -> None:
    export_scenario(tube_scenario(water=WaterSettings(current=(0.25, 0.1, 0.0))), "stonefish", tmp_path / "out")
    velocity = root_of(tmp_path / "out").find("environment/ocean/current/velocity")
    assert velocity is not None and velocity.get("xyz") == "0.25 -0.1 0"
