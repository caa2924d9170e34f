"""The report's section about photos, made of a synthetic model of known matches, errors and cameras."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from aquanav_tools.build.photo_report import (
    NUM_PATCHES,
    RECORDING,
    PhotoWork,
    growth_of,
    partial_section,
    photo_section,
    trail_of,
)
from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.images import Photo, PhotoSet
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.reconstruct.reconstruction import Reconstruction
from aquanav_tools.reconstruct.record import PhotoRecord, read_dense_views, read_sparse
from aquanav_tools.report.cave_map import CaveMap
from aquanav_tools.report.html import Page, Section, write_page
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import PointCloud, Sim3
from tests.report.test_recording import rerun

NUM_PHOTOS = 6
MISSING = "z_last.png"
WORLD_FROM_SFM = Sim3(0.12, np.eye(3), np.array([10.0, 0.0, 0.0]))


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> PhotoWork:
    """Six photos placed in a tube, and one that is not."""
    folder = tmp_path_factory.mktemp("photos")
    pycolmap = load_pycolmap()
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, NUM_PHOTOS
    options.num_points3D, options.camera_width, options.camera_height = 150, 160, 120
    pycolmap.set_random_seed(1)
    with pycolmap.Database.open(folder / "database.db") as store:
        model = pycolmap.synthesize_dataset(options, store)
        noise = pycolmap.SyntheticNoiseOptions()
        noise.point2D_stddev = 0.5
        pycolmap.synthesize_noise(noise, model, store)
        camera_id = next(iter(model.cameras))
        store.write_image(pycolmap.Image(name=MISSING, camera_id=camera_id))
    names = [*sorted(image.name for image in model.images.values()), MISSING]
    _write_dense(model, folder / "dense")
    photos = PhotoSet(folder, tuple(Photo(name, 160, 120, None, file=name) for name in names))
    depth_paths = sorted((folder / "dense" / "depth").rglob("*.npz"))
    record = PhotoRecord(photos, folder / "database.db", SparseModel(model), folder / "dense", depth_paths)
    rng = np.random.default_rng(0)
    cloud = PointCloud(rng.uniform(-1, 1, (300, 3)) + [10.0, 0.0, 0.0], None, np.full((300, 3), 90, np.uint8))
    sparse = SparseModel(model)
    found = Reconstruction(cloud, sparse.centres, sparse.rotations, tuple(names[:-1]), (), {})
    return PhotoWork(record, replace(found.moved(WORLD_FROM_SFM), cloud=cloud))


def _write_dense(model: Any, folder: Path) -> None:
    """Write the workspace of the dense step, a picture and a depth map for all photos but the first."""
    rng = np.random.default_rng(0)
    for name in ("sparse", "images", "depth"):
        (folder / name).mkdir(parents=True)
    model.write(folder / "sparse")
    for row, image in enumerate(model.images.values()):
        for parent in ("images", "depth"):
            (folder / parent / image.name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / "images" / image.name), rng.integers(0, 255, (120, 160, 3), dtype=np.uint8))
        if row:
            normals = np.broadcast_to(np.array([0, 0, -1], np.float16), (120, 160, 3))
            cost = rng.uniform(0, 1, (120, 160)).astype(np.float16)
            path = folder / "depth" / f"{image.name}.npz"
            np.savez(path, depth=np.ones((120, 160), np.float32), normals=normals, cost=cost)


FACTS = {
    "photos": NUM_PHOTOS + 1,
    "registered": NUM_PHOTOS,
    "unregistered": [{"name": MISSING, "cause": "dark", "sentence": f"{MISSING} is too dark."}],
    "scale_sources": [
        {"source": "camera positions", "items": 6, "left_out": [], "used": True, "scale": 0.12, "up_error_deg": 0.3,
         "scale_error_percent": 0.5, "rms_m": 0.02, "misfits_m": [0.01, 0.02, 0.03]},
    ],
}  # fmt: skip


@pytest.fixture(scope="module")
def tube_with_a_hole(tube: Scenario) -> Scenario:
    """The tube, whose uppermost side nobody saw."""
    is_unseen = tube.cavity.mesh.normals[:, 2] > 0.99
    assert is_unseen.any()
    return replace(tube, cavity=replace(tube.cavity, observed=~is_unseen))


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("out")
    (output / "drawings").mkdir()
    return output


@pytest.fixture(scope="module")
def made(work: PhotoWork, tube_with_a_hole: Scenario, output: Path) -> tuple[Section, dict[str, Any]]:
    with pytest.MonkeyPatch.context() as patch:
        for module in ("camera_map", "coverage_sheet", "depth_sheet", "histograms", "matches"):
            patch.setattr(f"aquanav_tools.report.photos.{module}.DPI", 40)
        cave = CaveMap("tube", tube_with_a_hole.cavity, tube_with_a_hole.guide.centreline, ())
        return photo_section(work, tube_with_a_hole, cave, FACTS, output)


def test_the_section_has_all_drawings_and_says_how_many_photos_found_their_place(
    made: tuple[Section, dict[str, Any]], output: Path
) -> None:
    section, _ = made
    names = [figure.path.name for figure in section.figures]
    assert names == ["cameras.svg", "coverage.png", "matches.png", "quality.svg", "depths.jpg"]
    assert "6 of 7 photos found their place" in section.text
    write_page(Page("Cave", "", sections=(section,)), output / "report.html")
    text = (output / "report.html").read_text()
    assert '<a href="#part-1">The photos</a>' in text
    assert "data:image/jpeg;base64," in text


def test_unregistered_photos_are_listed_with_their_cause(made: tuple[Section, dict[str, Any]]) -> None:
    (table,) = (table for table in made[0].tables if table.title == "Photos that did not register")
    assert table.rows == ((MISSING, "dark", f"{MISSING} is too dark."),)


def test_places_for_more_photos_are_listed_with_where_to_stand_and_look(
    made: tuple[Section, dict[str, Any]], tube_with_a_hole: Scenario
) -> None:
    section, statistics = made
    (table,) = (table for table in section.tables if table.title.startswith("Add photos here"))
    places = json.loads(json.dumps(statistics))["coverage"]["add_photos"]
    assert 0 < len(table.rows) == len(places) <= NUM_PATCHES
    cavity = tube_with_a_hole.cavity
    unseen = cavity.mesh.areas[~cavity.observed & (cavity.labels == WALL)].sum()
    assert sum(place["area"] for place in places) <= unseen + 1e-9
    for row, place in zip(table.rows, places, strict=True):
        assert row[4] == "straight up"
        assert place["stand"][2] == pytest.approx(2.0 - 1.5, abs=0.1)  # before the ceiling


def test_shares_of_the_wall_fall_with_the_number_of_photos(made: tuple[Section, dict[str, Any]]) -> None:
    shares = list(made[1]["coverage"]["share_in_photos"].values())
    assert shares == sorted(shares, reverse=True)
    assert 0.0 <= shares[-1] <= shares[0] <= 1.0


def test_the_recording_reads_back_with_every_camera(made: tuple[Section, dict[str, Any]], output: Path) -> None:
    assert made
    assert "verified without error" in rerun("verify", output / RECORDING)
    listing = rerun("print", "-v", output / RECORDING)
    assert len(set(re.findall(r"/cameras/(\d{4})\b", listing))) == NUM_PHOTOS


def test_cameras_are_drawn_and_recorded_where_they_are_in_the_world(work: PhotoWork) -> None:
    assert work.record.sparse is not None and work.reconstruction is not None
    sparse = read_sparse(work.record.sparse)
    trail = trail_of(work.record, sparse, WORLD_FROM_SFM)
    growth = growth_of(sparse, read_dense_views(work.record), work.reconstruction)
    assert trail.missing == ((NUM_PHOTOS + 1, MISSING),)
    by_name = {photo.name: photo for photo in growth.photos}
    for name, place, ahead in zip(trail.names, trail.positions, trail.ahead, strict=True):
        image = work.record.sparse.model.find_image_with_name(name)
        np.testing.assert_allclose(place, 0.12 * image.projection_center() + [10.0, 0.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(by_name[name].centre, place, atol=1e-9)
        np.testing.assert_allclose(ahead, image.viewing_direction(), atol=1e-9)
        np.testing.assert_allclose(by_name[name].cam_from_world[2], ahead, atol=1e-9)


def test_photos_that_became_no_cave_still_show_what_was_found(work: PhotoWork, tmp_path: Path) -> None:
    section = partial_section(work, "facade", FACTS, tmp_path)
    names = [figure.path.name for figure in section.figures]
    assert names == ["cameras.svg", "matches.png", "quality.svg", "depths.jpg"]
    only_matched = PhotoWork(PhotoRecord(work.record.photos, work.record.database))
    section = partial_section(only_matched, "facade", {}, tmp_path)
    assert [figure.path.name for figure in section.figures] == ["matches.png"]
    assert partial_section(PhotoWork(), "facade", {}, tmp_path).figures == ()


def test_a_cavity_that_was_seen_everywhere_asks_for_no_photos(
    work: PhotoWork, tube: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("draw_camera_map", "draw_coverage", "record_growth", "draw_matches", "draw_quality", "draw_depths"):
        monkeypatch.setattr(f"aquanav_tools.build.photo_report.{name}", lambda *args: None)
    for name in ("cameras.svg", "coverage.png", "matches.png", "quality.svg", "depths.jpg"):
        (tmp_path / "drawings").mkdir(exist_ok=True)
        (tmp_path / "drawings" / name).touch()
    assert isinstance(tube.cavity, Cavity)
    cave = CaveMap("tube", tube.cavity, tube.guide.centreline, ())
    section, _ = photo_section(work, tube, cave, FACTS, tmp_path)
    assert "No place needs more." in section.text
    assert not [table for table in section.tables if table.title.startswith("Add photos")]
