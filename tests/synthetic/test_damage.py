"""Each kind of damage does what it says to a tube with known answers, and nothing else."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.scan.surface import clean_mesh
from aquanav_tools.libraries import load_open3d
from aquanav_tools.synthetic import caves as synthetic
from aquanav_tools.synthetic import damage
from aquanav_tools.synthetic.damage import DamagedScan
from aquanav_tools.types import Mesh, PointCloud

RADIUS, LENGTH = 1.0, 10.0
AREA = 2.0 * np.pi * RADIUS * LENGTH
COARSE = 0.01
"""A polygon of 64 sides has 0.2 % less area than its circle; faces of 0.1 m make a ragged rim of their own size."""

DAMAGES: dict[str, Callable[[DamagedScan, int], DamagedScan]] = {
    "holes": lambda scan, seed: damage.punch_holes(scan, 5, 0.3, seed),
    "torn ends": lambda scan, seed: damage.tear_ends(scan, 0.8, seed),
    "noise": lambda scan, seed: damage.add_noise(scan, 0.02, seed),
    "noise along normals": lambda scan, seed: damage.add_noise(scan, 0.02, seed, along_normals=True),
    "spikes": lambda scan, seed: damage.add_spikes(scan, 0.01, 1.0, seed),
    "shell": lambda scan, seed: damage.duplicate_shell(scan, 0.05, 0.5, seed),
    "flips": lambda scan, seed: damage.flip_faces(scan, 0.3, seed),
    "soup": lambda scan, seed: damage.unweld(scan, seed, 0.002),
    "debris": lambda scan, seed: damage.add_debris(scan, 10, 0.1, seed),
    "fins": lambda scan, seed: damage.add_fins(scan, 10, 0.2, seed),
    "repeated faces": lambda scan, seed: damage.repeat_faces(scan, 0.1, seed),
    "folds": lambda scan, seed: damage.fold_wall(scan, 5, 0.3, seed),
    "parts": lambda scan, seed: damage.split_parts(scan, 3, 0.05, seed),
    "cloud": lambda scan, seed: damage.sample_cloud(scan, 0.1, "mixed", seed),
}


@pytest.fixture(scope="module")
def tube() -> DamagedScan:
    return damage.intact(synthetic.tube(RADIUS, LENGTH, sections=64, rings=101))


def _positions(scan: DamagedScan) -> np.ndarray:
    return scan.surface.vertices if isinstance(scan.surface, Mesh) else scan.surface.points


def _cloud(scan: DamagedScan) -> PointCloud:
    assert isinstance(scan.surface, PointCloud)
    return scan.surface


def _rims(mesh: Mesh) -> list[np.ndarray]:
    rims = trimesh.graph.connected_components(damage.border_edges(mesh), min_len=3)
    return [mesh.vertices[np.asarray(rim)] for rim in rims]


@pytest.mark.parametrize("name", DAMAGES)
def test_a_seed_decides_everything(tube: DamagedScan, name: str) -> None:
    once, again, other = (DAMAGES[name](tube, seed) for seed in (1, 1, 2))
    assert np.array_equal(_positions(once), _positions(again))
    if isinstance(once.surface, Mesh):
        assert np.array_equal(once.mesh.faces, again.mesh.faces)
    is_same_shape = _positions(once).shape == _positions(other).shape
    is_same_mesh = isinstance(once.surface, Mesh) and np.array_equal(once.mesh.faces, other.mesh.faces)
    assert not is_same_shape or not np.array_equal(_positions(once), _positions(other)) or not is_same_mesh


@pytest.mark.parametrize("name", DAMAGES)
def test_damage_changes_neither_the_truth_nor_the_scan_it_was_given(tube: DamagedScan, name: str) -> None:
    vertices, faces = tube.mesh.vertices.copy(), tube.mesh.faces.copy()
    damaged = DAMAGES[name](tube, 3)
    assert damaged.truth is tube.truth
    assert np.array_equal(vertices, tube.mesh.vertices) and np.array_equal(faces, tube.mesh.faces)
    assert np.isfinite(_positions(damaged)).all()


def test_an_intact_tube_has_two_ends_and_no_handle(tube: DamagedScan) -> None:
    assert (tube.truth.num_portals, tube.truth.genus) == (2, 0)


def test_holes_have_their_number_and_size(tube: DamagedScan) -> None:
    mesh = damage.punch_holes(tube, 5, 0.3, seed=1).mesh
    assert len(_rims(mesh)) == 2 + 5
    lost = tube.mesh.to_trimesh().area - mesh.to_trimesh().area
    assert lost == pytest.approx(5 * np.pi * 0.3**2, rel=0.1)  # faces of 0.1 m make the rim ragged


def test_holes_stay_away_from_the_ends(tube: DamagedScan) -> None:
    mesh = damage.punch_holes(tube, 20, 0.3, seed=1).mesh
    for x in (0.0, LENGTH):
        assert (np.abs(mesh.vertices[:, 0] - x) < 1e-9).sum() == 64


def test_torn_ends_are_ragged_and_leave_the_middle_alone(tube: DamagedScan) -> None:
    mesh = damage.tear_ends(tube, 1.0, seed=1).mesh
    rims = sorted(_rims(mesh), key=lambda rim: float(rim[:, 0].mean()))
    first, last = rims[0][:, 0], rims[-1][:, 0]
    assert first.min() >= 0.0 and first.max() <= 1.1 and np.ptp(first) > 0.3  # 0.1 m: one face
    assert last.max() <= LENGTH and last.min() >= LENGTH - 1.1 and np.ptp(last) > 0.3
    middle = np.abs(tube.mesh.triangles.mean(axis=1)[:, 0] - 0.5 * LENGTH) < 3.5
    assert (np.abs(mesh.triangles.mean(axis=1)[:, 0] - 0.5 * LENGTH) < 3.5).sum() == middle.sum()


def test_noise_has_its_sigma(tube: DamagedScan) -> None:
    shift = damage.add_noise(tube, 0.02, seed=1).mesh.vertices - tube.mesh.vertices
    assert shift.std() == pytest.approx(0.02, rel=0.03)  # 19,392 draws: three standard errors are 1.5 %


def test_noise_along_normals_moves_a_tube_radially(tube: DamagedScan) -> None:
    shift = damage.add_noise(tube, 0.02, seed=1, along_normals=True).mesh.vertices - tube.mesh.vertices
    radial = tube.mesh.vertices * [0.0, 1.0, 1.0] / RADIUS
    assert np.linalg.norm(np.einsum("ij,ij->i", shift, radial)) == pytest.approx(np.linalg.norm(shift), rel=COARSE)


def test_spikes_move_one_vertex_in_a_hundred_by_less_than_their_length(tube: DamagedScan) -> None:
    shift = np.linalg.norm(damage.add_spikes(tube, 0.01, 0.7, seed=1).mesh.vertices - tube.mesh.vertices, axis=1)
    assert (shift > 0).sum() == round(0.01 * len(shift))
    assert shift.max() <= 0.7


def test_spikes_add_points_to_a_cloud(tube: DamagedScan) -> None:
    cloud = damage.sample_cloud(tube, 0.1, "true", seed=1)
    spiked = _cloud(damage.add_spikes(cloud, 0.01, 1.0, seed=2))
    num = len(_cloud(cloud).points)
    assert len(spiked.points) == num + round(0.01 * num)
    assert spiked.normals is not None and len(spiked.normals) == len(spiked.points)


def test_a_shell_repeats_part_of_the_wall_at_its_offset(tube: DamagedScan) -> None:
    mesh = damage.duplicate_shell(tube, 0.05, 0.5, seed=1).mesh
    assert len(mesh.faces) == pytest.approx(1.5 * len(tube.mesh.faces), rel=COARSE)
    copy = mesh.triangles[len(tube.mesh.faces) :]
    shift = copy - tube.mesh.triangles[tube.mesh.triangles[..., 0].mean(axis=1) <= 0.5 * LENGTH]
    assert np.linalg.norm(shift, axis=2) == pytest.approx(0.05)


def test_rock_is_a_closed_shell_of_its_thickness(tube: DamagedScan) -> None:
    rock = damage.solidify(tube, 0.2).mesh.to_trimesh()
    assert rock.is_volume
    assert rock.volume == pytest.approx(np.pi * (1.2**2 - 1.0) * LENGTH, rel=COARSE)


def test_flips_turn_their_share_of_faces(tube: DamagedScan) -> None:
    flipped = damage.flip_faces(tube, 0.3, seed=1).mesh
    turned = (flipped.faces != tube.mesh.faces).any(axis=1)
    assert turned.mean() == pytest.approx(0.3, abs=0.02)  # 12,800 faces: four standard errors are 1.6 %


def test_a_soup_shares_no_vertices_and_welds_together_again(tube: DamagedScan) -> None:
    soup = damage.unweld(tube, seed=1).mesh
    assert len(soup.vertices) == 3 * len(tube.mesh.faces)
    assert len(clean_mesh(soup).vertices) == len(tube.mesh.vertices)


def test_half_of_the_debris_floats_in_the_water(tube: DamagedScan) -> None:
    mesh = damage.add_debris(tube, 20, 0.1, seed=1).mesh
    boxes = mesh.to_trimesh().split(only_watertight=True)
    assert len(boxes) == 20 and all(box.is_volume for box in boxes)
    distance = np.array([np.linalg.norm(box.vertices.mean(axis=0)[1:]) for box in boxes])
    assert (distance < RADIUS - 0.1).sum() == 10 and (distance > RADIUS + 0.1).sum() == 10


def test_fins_give_edges_three_faces(tube: DamagedScan) -> None:
    mesh = damage.add_fins(tube, 15, 0.2, seed=1).mesh
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts > 2).sum() == 15


def test_repeated_faces_clean_away(tube: DamagedScan) -> None:
    damaged = damage.repeat_faces(tube, 0.1, seed=1).mesh
    assert len(damaged.faces) > 1.15 * len(tube.mesh.faces)
    assert len(clean_mesh(damaged).faces) == len(tube.mesh.faces)


def test_folds_make_the_wall_cross_itself(tube: DamagedScan) -> None:
    open3d = load_open3d()

    def crosses(mesh: Mesh) -> bool:
        vertices, faces = open3d.utility.Vector3dVector(mesh.vertices), open3d.utility.Vector3iVector(mesh.faces)
        return bool(open3d.geometry.TriangleMesh(vertices, faces).is_self_intersecting())

    assert not crosses(tube.mesh)
    assert crosses(damage.fold_wall(tube, 3, 0.3, seed=1).mesh)


def test_parts_fall_apart(tube: DamagedScan) -> None:
    mesh = damage.split_parts(tube, 3, 0.05, seed=1).mesh
    assert mesh.to_trimesh().body_count == 3


def test_every_other_part_can_be_inside_out(tube: DamagedScan) -> None:
    mesh = damage.split_parts(tube, 4, 0.0, seed=1, flip=True).mesh
    outward = np.einsum("ij,ij->i", mesh.to_trimesh().face_normals[:, 1:], mesh.triangles.mean(axis=1)[:, 1:]) > 0
    assert outward.mean() == pytest.approx(0.5, abs=COARSE)


def test_decimation_keeps_the_place_of_the_wall(tube: DamagedScan) -> None:
    mesh = damage.decimate(tube, 0.1).mesh
    assert len(mesh.faces) == pytest.approx(0.1 * len(tube.mesh.faces), rel=0.01)
    distance = np.linalg.norm(mesh.triangles.mean(axis=1)[:, 1:], axis=1)
    assert distance == pytest.approx(RADIUS, abs=0.05)


def test_decimating_half_leaves_the_other_half_fine(tube: DamagedScan) -> None:
    mesh = damage.decimate(tube, 0.1, share=0.5).mesh
    along = mesh.triangles.mean(axis=1)[:, 0]
    assert (along > 0.5 * LENGTH).sum() == pytest.approx(0.5 * len(tube.mesh.faces), rel=COARSE)
    assert (along < 0.5 * LENGTH).sum() == pytest.approx(0.05 * len(tube.mesh.faces), rel=COARSE)


def test_a_unit_changes_the_numbers_by_its_size(tube: DamagedScan) -> None:
    in_feet = damage.convert_unit(tube, "ft")
    assert in_feet.unit == "ft"
    assert np.ptp(in_feet.mesh.vertices[:, 0]) == pytest.approx(LENGTH / 0.3048)
    assert damage.convert_unit(in_feet, "m").mesh.vertices == pytest.approx(tube.mesh.vertices)


def test_moving_away_is_remembered(tube: DamagedScan) -> None:
    moved = damage.move_away(damage.convert_unit(tube, "cm"), (1000.0, 0.0, 0.0))
    assert moved.mesh.vertices[:, 0].min() == pytest.approx(100_000.0)
    assert moved.offset.tolist() == [1000.0, 0.0, 0.0]


def test_a_cloud_lies_on_the_wall_at_its_spacing(tube: DamagedScan) -> None:
    points = _cloud(damage.sample_cloud(tube, 0.1, "none", seed=1)).points
    assert len(points) == pytest.approx(AREA / 0.1**2, rel=COARSE)
    assert np.linalg.norm(points[:, 1:], axis=1) == pytest.approx(RADIUS, rel=COARSE)


@pytest.mark.parametrize(("kind", "share"), [("true", 1.0), ("inverted", 0.0), ("mixed", 0.5)])
def test_normals_of_a_cloud_look_into_the_water_or_not(tube: DamagedScan, kind: damage.Normals, share: float) -> None:
    cloud = _cloud(damage.sample_cloud(tube, 0.05, kind, seed=1))
    assert cloud.normals is not None
    inward = np.einsum("ij,ij->i", cloud.normals[:, 1:], -cloud.points[:, 1:]) > 0
    assert inward.mean() == pytest.approx(share, abs=0.02)  # 25,000 draws: four standard errors are 1.3 %


def test_density_falls_to_half(tube: DamagedScan) -> None:
    x = _cloud(damage.sample_cloud(tube, 0.02, "none", seed=1, fall_off=2.5)).points[:, 0]
    counts = np.histogram(x, bins=4, range=(0.0, LENGTH))[0]
    assert counts[1:] / counts[:-1] == pytest.approx(0.5, abs=0.05)  # 3,500 points in the last: 4 sigma


def test_a_cloud_cannot_lose_faces(tube: DamagedScan) -> None:
    cloud = damage.sample_cloud(tube, 0.1, "none", seed=1)
    with pytest.raises(ValueError, match="before sampling"):
        damage.punch_holes(cloud, 1, 0.1, seed=1)


def test_a_demo_cave_has_the_genus_of_its_solid() -> None:
    cave = synthetic.demo_cave(synthetic.CaveOptions(length=4.0, voxel=0.2))
    solid = trimesh.Trimesh(cave.truth.vertices, cave.truth.faces, process=False)
    assert damage.intact(cave).truth.genus == 1 - solid.euler_number / 2
