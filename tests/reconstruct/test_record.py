"""What the report is told about a reconstruction, against COLMAP's own figures for a model made by COLMAP."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.growth import keep_order, read_order
from aquanav_tools.reconstruct.images import Photo, PhotoSet
from aquanav_tools.reconstruct.mapping import MappingOptions, SparseModel, map_photos
from aquanav_tools.reconstruct.record import PhotoRecord, SparseRecord, read_matches, read_sparse
from aquanav_tools.types import Sim3


@dataclass(frozen=True, eq=False)
class Mapped:
    """Ten synthetic photos of points, mapped."""

    truth: Any
    """The pycolmap.Reconstruction that the matches were made of."""
    photos: PhotoSet
    database: Path
    sparse: SparseModel
    returned: Any
    """The pycolmap.Reconstruction that the mapper gave back."""


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Mapped:
    folder = tmp_path_factory.mktemp("mapped")
    pycolmap = load_pycolmap()
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, 10
    options.num_points3D = 200
    pycolmap.set_random_seed(1)
    with pycolmap.Database.open(folder / "database.db") as store:
        truth = pycolmap.synthesize_dataset(options, store)
        noise = pycolmap.SyntheticNoiseOptions()
        noise.point2D_stddev = 0.5
        pycolmap.synthesize_noise(noise, truth, store)
    names = sorted(image.name for image in truth.images.values())
    camera = next(iter(truth.cameras.values()))
    photos = PhotoSet(folder, tuple(Photo(n, camera.width, camera.height, None, file=n) for n in names))
    kept: list[Any] = []
    original = pycolmap.incremental_mapping

    def listen(*args: Any, **kwargs: Any) -> Any:
        kept.append(original(*args, **kwargs))
        return kept[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pycolmap, "incremental_mapping", listen)
        sparse = map_photos(photos, folder / "database.db", folder / "models", MappingOptions())
    return Mapped(truth, photos, folder / "database.db", sparse, kept[0][0])


@pytest.fixture(scope="module")
def record(mapped: Mapped) -> SparseRecord:
    return read_sparse(mapped.sparse)


def test_photos_come_in_the_order_the_mapper_placed_them(mapped: Mapped, record: SparseRecord) -> None:
    placed = [mapped.returned.images[image_id].name for image_id in mapped.returned.reg_image_ids()]
    assert sorted(placed) != placed  # else nothing is tested
    assert list(record.names) == placed
    assert record.is_order_known


def test_errors_and_tracks_are_those_of_colmap(mapped: Mapped, record: SparseRecord) -> None:
    model = mapped.sparse.model
    assert len(record.observations) == model.compute_num_observations()
    assert record.track_lengths.mean() == pytest.approx(model.compute_mean_track_length())
    np.testing.assert_allclose(
        record.point_errors_px, [model.points3D[point_id].error for point_id in sorted(model.points3D)], rtol=1e-6
    )
    np.testing.assert_allclose(record.residuals_px.mean(), 0.5 * np.sqrt(np.pi / 2.0), rtol=0.1)  # Rayleigh, 0.5 px
    assert record.photo_errors_px.shape == (len(record.names),)


def test_the_angle_of_a_point_is_the_widest_between_two_of_its_rays(record: SparseRecord) -> None:
    for point in range(0, len(record.points), 29):
        cameras = record.observations[record.observations[:, 0] == point, 1]
        rays = record.points[point] - record.centres[cameras]
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        widest = max(np.linalg.norm(np.cross(a, b)) for a in rays for b in rays)  # every angle here is below 90 degrees
        if np.einsum("ij,kj->ik", rays, rays).min() > 0.0:
            assert np.sin(np.radians(record.angles_deg[point])) == pytest.approx(widest, abs=1e-9)


def test_cameras_look_along_their_third_axis(mapped: Mapped, record: SparseRecord) -> None:
    for row, name in enumerate(record.names):
        image = mapped.sparse.model.find_image_with_name(name)
        np.testing.assert_allclose(record.rotations[row][2], image.viewing_direction(), atol=1e-12)
        np.testing.assert_allclose(record.centres[row], image.projection_center(), atol=1e-12)


def test_the_matrix_holds_the_points_that_two_photos_share(mapped: Mapped) -> None:
    matches = read_matches(PhotoRecord(mapped.photos, mapped.database))
    assert matches is not None
    seen = {
        image.name: {point.point3D_id for point in image.points2D if point.has_point3D()}
        for image in mapped.truth.images.values()
    }
    names = mapped.photos.names
    shared = [[len(seen[a] & seen[b]) if a != b else 0 for b in names] for a in names]
    np.testing.assert_array_equal(matches, shared)


def test_before_matching_there_is_no_matrix(mapped: Mapped) -> None:
    assert read_matches(PhotoRecord(mapped.photos)) is None


def test_a_model_that_went_on_from_another_keeps_the_first_ones_order(mapped: Mapped, tmp_path: Path) -> None:
    start, folder = tmp_path / "start", tmp_path / "models"
    names = [mapped.returned.images[image_id].name for image_id in mapped.returned.reg_image_ids()]
    begun = names[4::-1]  # another order than the model's own
    start.mkdir()
    (start / "placed.txt").write_text("".join(f"{name}\n" for name in begun))
    (folder / "0").mkdir(parents=True)
    keep_order({0: mapped.returned}, folder, start)
    assert read_order(folder / "0") == [*begun, *names[5:]]
    assert read_order(tmp_path) == []


def test_transforms_chain_from_the_right() -> None:
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    b_from_a, c_from_b = Sim3(2.0, quarter, np.array([1.0, 0.0, 0.0])), Sim3(0.5, quarter, np.array([0.0, 3.0, 0.0]))
    points = np.array([[1.0, 2.0, 3.0], [-4.0, 0.5, 0.0]])
    np.testing.assert_allclose((c_from_b @ b_from_a).apply(points), c_from_b.apply(b_from_a.apply(points)))
