from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from aquanav_tools.cave.route.guide import Guide, Panel
from aquanav_tools.errors import InputError
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.prediction import Predictor
from aquanav_tools.sim.batch.random import START, draw_many
from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Mesh, Pose, rotation_matrix, yaw_quaternion
from tests.caves import TUBE_LENGTH, TUBE_RADIUS
from tests.sim.batch.guides import Tracker
from tests.sim.batch.worlds import make_world, place, random_turns


def coupled_vehicle() -> Vehicle:
    """A BlueROV2 whose added mass couples surge with pitch, and sway with roll and yaw."""
    vehicle = load_vehicle("bluerov2")
    assert isinstance(vehicle, FossenVehicle) and vehicle.water.added_mass is not None
    matrix = np.diag(vehicle.water.added_mass)
    for a, b, value in ((0, 4, 0.4), (1, 3, -0.3), (1, 5, 0.5)):
        matrix[a, b] = matrix[b, a] = value
    water = dataclasses.replace(vehicle.water, added_mass=None, added_mass_matrix=tuple(map(tuple, matrix.tolist())))
    return dataclasses.replace(vehicle, water=water)


def enlarged(tube: Scenario, factor: float) -> Scenario:
    """The tube with all lengths of its wall and field multiplied: room for a boat."""
    mesh, field = tube.cavity.mesh, tube.field
    mesh = dataclasses.replace(mesh, vertices=factor * mesh.vertices)
    grown = DistanceField(factor * field.origin, factor * field.spacing, field.bricks, factor * field.samples)
    cavity = dataclasses.replace(tube.cavity, mesh=mesh)
    return dataclasses.replace(tube, cavity=cavity, collision=mesh, field=grown)


def vehicle_of(name: str) -> Vehicle:
    return coupled_vehicle() if name == "coupled" else load_vehicle(name)


@pytest.mark.parametrize("name", ["bluerov2", "bluerov2-heavy", "original-auv", "boat", "coupled"])
def test_every_model_moves_as_predicted_in_free_water(name: str, tube: Scenario, rng: np.random.Generator) -> None:
    vehicle, num, current = vehicle_of(name), 6, (0.06, -0.02, 0.01)
    world = make_world(enlarged(tube, 20.0), vehicle, num, current=current)
    middle = np.tile([200.0, 0.0, 0.0], (num, 1))
    turns = np.array([yaw_quaternion(yaw) for yaw in rng.uniform(-3, 3, num)])
    place(world, middle, turns)
    commands = rng.uniform(-1, 1, (12, num, 3))
    for command in commands:
        world.as_numpy("commands")[:] = command
        world.step()
    assert not world.as_numpy("touched").any()
    predictor = Predictor(vehicle, tube.settings.water.density, tube.settings.limits.dt, 5)
    states = np.array([vehicle.state_at(Pose(*pose)) for pose in zip(middle, turns, strict=True)])
    if name == "original-auv":  # its water's surface stays where the batch had it
        states[:, 13:] = world.as_numpy("extra")[:, : states.shape[1] - 13]
    given = commands.astype(np.float32).astype(np.float64).swapaxes(0, 1)
    ends = predictor.predict(states, np.zeros(num), given, np.array(current)).states[:, -1]
    assert np.abs(world.as_numpy("positions") - ends[:, :3]).max() < 1e-9
    assert np.abs(world.as_numpy("orientations") - ends[:, 3:7]).max() < 1e-9
    assert np.abs(world.as_numpy("velocities") - ends[:, 7:13]).max() < 1e-9


def in_water(rng: np.random.Generator, num: int, clearance: float) -> np.ndarray:
    """Return (N, 3) places in the tube with at least so much clearance, m."""
    radius = (TUBE_RADIUS - clearance) * np.sqrt(rng.uniform(0, 1, num))
    angle = rng.uniform(0, 2 * np.pi, num)
    x = rng.uniform(clearance, TUBE_LENGTH - clearance, num)
    return np.stack([x, radius * np.cos(angle), radius * np.sin(angle)], axis=1)


@pytest.mark.parametrize(("source", "median", "most"), [("mesh", 1e-5, 1e-3), ("field", 0.005, 0.1)])
def test_rays_are_as_long_as_embree_finds_them(
    source: str, median: float, most: float, tube: Scenario, rng: np.random.Generator
) -> None:
    """The field's samples are 0.1 m apart, and those of a smooth tube; its portals' rims are the field's only edges.

    Its error is stated as: median below 0.05 spacings, 99 % below one spacing.
    """
    num = 300
    world = make_world(tube, load_vehicle("bluerov2"), num, rays=source)
    place(world, in_water(rng, num, 0.4), random_turns(rng, num))
    world.step()
    lengths = original_pattern().lengths
    expected = embree_rays(tube.cavity.mesh, world.as_numpy("positions"), world.as_numpy("orientations"))
    errors = np.abs(world.as_numpy("observations")[:, :28] * lengths - expected)
    assert np.median(errors) < median
    assert np.quantile(errors, 1.0 if source == "mesh" else 0.99) < most


def embree_rays(mesh: Mesh, positions: np.ndarray, orientations: np.ndarray) -> np.ndarray:
    """Return the (N, 28) distances to the mesh that Embree finds, m, at most the rays' lengths."""
    pattern, intersector = original_pattern(), RayMeshIntersector(trimesh.Trimesh(mesh.vertices, mesh.faces))
    expected = np.tile(pattern.lengths, (len(positions), 1))
    for n, (position, orientation) in enumerate(zip(positions, orientations, strict=True)):
        ways = pattern.directions @ rotation_matrix(orientation).T
        places, rays, _ = intersector.intersects_location(np.tile(position, (28, 1)), ways, multiple_hits=False)
        np.minimum.at(expected[n], rays, np.linalg.norm(places - position, axis=1))
    return expected


def helix_guide(rng: np.random.Generator) -> Guide:
    """Panels with ragged outlines along a helix whose turns pass near each other."""
    angle = np.linspace(0, 6 * np.pi, 60)
    centres = np.stack([10 + 4 * np.cos(angle), 4 * np.sin(angle), 0.25 * angle], axis=1)
    ahead = np.gradient(centres, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    panels = []
    for n, (centre, normal) in enumerate(zip(centres, ahead, strict=True)):
        side = np.cross(normal, [0, 0, 1.0])
        side /= np.linalg.norm(side)
        rim = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        reach = rng.uniform(0.5, 0.9, (24, 1))
        polygon = centre + reach * (np.cos(rim)[:, None] * side + np.sin(rim)[:, None] * np.cross(side, normal))
        panels.append(Panel(centre, normal, polygon, float(steps[:n].sum()), 0.5))
    return Guide(centres, tuple(panels))


def test_progress_follows_the_guide_through_every_jump(tube: Scenario, rng: np.random.Generator) -> None:
    """In a batch every vehicle is followed as it is alone."""
    guide, num = helix_guide(rng), 64
    tracker = Tracker(guide)
    world = make_world(dataclasses.replace(tube, guide=guide), load_vehicle("bluerov2"), num, has_goal=False)
    gates = world.as_numpy("gates").copy()
    wander = guide.centres[rng.integers(0, 60, (30, num))] + rng.normal(0, 0.4, (30, num, 3))
    wander[1::3] = wander[::3] + rng.normal(0, 0.1, wander[::3].shape)  # small moves among jumps
    for places in wander:
        place(world, places)
        world.step()
        reached = world.as_numpy("positions")
        followed = [tracker.follow([one], int(gate)) for one, gate in zip(reached, gates, strict=True)]
        gates, remaining = (np.concatenate(values) for values in zip(*followed, strict=True))
        assert np.array_equal(world.as_numpy("gates"), gates)
        assert np.array_equal(world.as_numpy("remaining"), remaining)
    assert len(np.unique(gates)) > 10


@pytest.mark.parametrize("speed", [0.5, 3.0])
def test_nothing_gets_through_the_wall_or_gains_energy_there(
    speed: float, tube: Scenario, rng: np.random.Generator
) -> None:
    vehicle, num = load_vehicle("bluerov2"), 256
    world = make_world(tube, vehicle, num)
    place(world, in_water(rng, num, 0.4), random_turns(rng, num))
    velocity = np.zeros((num, 6))
    velocity[:, :3] = rng.normal(size=(num, 3))
    velocity[:, :3] *= speed / np.linalg.norm(velocity[:, :3], axis=1, keepdims=True)
    world.arrays.velocities.assign(velocity)
    world.as_numpy("commands")[:] = 0.0
    energy = (
        0.5 * (velocity**2 * vehicle.total_mass).sum(axis=1) + 2.0 * 60.0
    )  # the autopilot's levelling: 2 x its gain
    hits = 0
    for _ in range(40):
        world.step()
        hits += int((world.as_numpy("touched") > 0).sum())
        now = 0.5 * (world.as_numpy("velocities") ** 2 * vehicle.total_mass).sum(axis=1)
        assert (now <= energy).all()
        assert (tube.field.clearance(world.as_numpy("positions")) > 0.0).all()
    assert hits > num / 2
    assert world.as_numpy("clearances").min() > -0.05  # the solver lets a step's way in, and takes it back


def test_a_vehicle_that_rests_on_the_wall_stays_and_one_that_swims_along_it_is_slowed(tube: Scenario) -> None:
    vehicle = load_vehicle("bluerov2")
    world = make_world(tube, vehicle, 2)
    place(world, np.array([[5.0, 0.0, -1.8], [5.0, 0.0, -1.8]]), np.tile([1.0, 0, 0, 0], (2, 1)))
    for _ in range(40):
        world.as_numpy("commands")[:] = [[-1.0, 0.0, 0.0], [-1.0, 0.0, 1.0]]
        world.step()
    resting, swimming = world.as_numpy("velocities")
    assert (world.as_numpy("touched") == 5).all()
    assert np.abs(resting[:3]).max() < 0.02
    assert 0.3 < swimming[0] < vehicle.top_speed()  # type: ignore[attr-defined]
    assert np.abs(world.as_numpy("clearances")).max() < 0.02


def test_starts_are_drawn_evenly_from_the_episodes_seed_alone(tube: Scenario) -> None:
    num_starts, num = len(tube.starts), 4000
    small, large = (make_world(tube, load_vehicle("bluerov2"), size) for size in (5, num))
    seeds = np.arange(num) + (1 << 32) - num // 2  # around the largest, where numbers begin again
    for world in (small, large):
        world.reset(seeds[: world.num])
    drawn = large.as_numpy("start_indices").copy()
    assert np.array_equal(small.as_numpy("start_indices"), drawn[:5])
    assert np.array_equal(drawn, draw_many(seeds, START) % num_starts)
    counts = np.bincount(drawn, minlength=num_starts)
    expected = num / num_starts
    assert ((counts - expected) ** 2 / expected).sum() < 52.4  # chi-square with 19 degrees of freedom, p = 5e-5
    large.reset(seeds + num)
    assert (large.as_numpy("start_indices") == drawn).mean() < 0.1


def test_threads_do_not_change_what_happens(tube: Scenario, rng: np.random.Generator) -> None:
    num = 600
    worlds = [make_world(tube, load_vehicle("bluerov2"), num, num_threads=threads) for threads in (1, 2)]
    for _ in range(40):
        commands = rng.uniform(-1, 1, (num, 3))
        for world in worlds:
            world.as_numpy("commands")[:] = commands
            world.step()
    for name in ("observations", "rewards", "positions", "touched"):
        assert np.array_equal(worlds[0].as_numpy(name), worlds[1].as_numpy(name))
    for world in worlds:
        world.close()


def test_torch_sees_the_same_memory(tube: Scenario) -> None:
    world = make_world(tube, load_vehicle("bluerov2"), 4)
    observations, commands = world.as_torch("observations"), world.as_torch("commands")
    before = observations.clone()
    commands[:, 2] = 1.0
    for _ in range(5):
        world.step()
    assert observations.data_ptr() == world.as_numpy("observations").ctypes.data
    assert (observations[:, 31] > before[:, 31]).all()  # it swims ahead


def test_a_device_that_is_not_there_is_named_with_those_that_are(tube: Scenario) -> None:
    with pytest.raises(InputError, match=r"no device 'cuda:7'.*cpu"):
        make_world(tube, load_vehicle("bluerov2"), 1, device="cuda:7")


def test_a_batch_of_none_is_refused(tube: Scenario) -> None:
    with pytest.raises(InputError, match="1 to 1048576 vehicles, got 0"):
        make_world(tube, load_vehicle("bluerov2"), 0)
