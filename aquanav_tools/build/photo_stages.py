"""The stages that turn a folder of photos into an oriented point cloud in metres, z up."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import PhotoScaleOptions
from aquanav_tools.cave.enclosure import check_enclosure, free_height
from aquanav_tools.cave.surface import surface_from_cloud
from aquanav_tools.errors import ReconstructionError
from aquanav_tools.reconstruct.depth import DepthOptions, estimate_depth, undistort
from aquanav_tools.reconstruct.diagnosis import Caution
from aquanav_tools.reconstruct.features import FeatureOptions, MatchOptions, extract_features, match_features
from aquanav_tools.reconstruct.fusion import FusionOptions, fuse_depth
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.mapping import MappingOptions, SparseModel, map_photos
from aquanav_tools.reconstruct.scale import GeoreferenceOptions, georeference, level, move_model, read_positions
from aquanav_tools.scenario.folder import file_hash
from aquanav_tools.types import Array, PointCloud

PREVIEW_CELLS = 100
"""Cells along the longest side of the coarse surface that tells whether the photos show a cave."""


@dataclass(frozen=True)
class PhotoRecipe:
    """Settings of the photo stages, as in pipelines/build/photos.toml."""

    features: FeatureOptions = field(default_factory=FeatureOptions)
    matching: MatchOptions = field(default_factory=MatchOptions)
    mapping: MappingOptions = field(default_factory=MappingOptions)
    positions: GeoreferenceOptions = field(default_factory=GeoreferenceOptions)
    depth: DepthOptions = field(default_factory=DepthOptions)
    fusion: FusionOptions = field(default_factory=FusionOptions)


@dataclass(frozen=True, eq=False)
class PhotoCloud:
    """What the photos show."""

    cloud: PointCloud
    """World frame; normals towards the cameras. In arbitrary units when `has_scale` is False."""
    cameras: Array
    """(N, 3) centres of the registered cameras, same frame."""
    has_scale: bool
    facts: dict[str, object]
    """Counts and errors for the report."""


def hash_photos(photos: PhotoSet, recipe: PhotoRecipe, scale: PhotoScaleOptions) -> str:
    """Return a key of everything the photo stages depend on: the bytes of the photos, positions and settings."""
    digest = hashlib.sha256(json.dumps(dataclasses.asdict(recipe), sort_keys=True).encode())
    for name in photos.names:
        digest.update(f"{name} {file_hash(photos.path(name))}\n".encode())
    if scale.positions is not None:
        digest.update(file_hash(scale.positions).encode())
    return digest.hexdigest()


def reconstruct(
    photos: PhotoSet, scale: PhotoScaleOptions, recipe: PhotoRecipe, work_dir: Path, journal: Journal
) -> PhotoCloud:
    """Return the dense cloud of a photo set. Finished stages in `work_dir` are taken from there.

    Raises:
        ReconstructionError: too few photos register, or no surface can be measured; the message says why.
    """
    # Read early: a wrong file must not cost an hour first.
    positions = None if scale.positions is None else read_positions(scale.positions, photos.names)
    database = work_dir / "database.db"
    with journal.stage("Finding features") as progress:
        extract_features(photos, database, recipe.features, progress)
    with journal.stage("Matching photos") as progress:
        match_features(photos, database, recipe.matching, progress)
    with journal.stage("Placing cameras") as progress:
        sparse = map_photos(photos, database, work_dir / "sparse", recipe.mapping, progress)
        placed = level(sparse) if positions is None else georeference(sparse, positions, recipe.positions)
        world = move_model(sparse, placed.world_from_sfm)
    _note(journal, sparse.cautions + (placed.cautions if positions is not None else ()))
    with journal.stage("Measuring depth") as progress:
        undistort(photos, world, work_dir / "dense", recipe.depth)
        depth_paths = estimate_depth(work_dir / "dense", recipe.depth, progress)
    with journal.stage("Fusing depth maps") as progress:
        cloud = fuse_depth(work_dir / "dense", depth_paths, recipe.fusion, progress)
    facts = _facts(photos, sparse, cloud)
    if positions is not None:
        facts |= {"positions_used": placed.num_positions, "positions_rms_m": placed.rms}
    return PhotoCloud(cloud, world.centres, positions is not None, facts)


def check_is_cave(photo_cloud: PhotoCloud, journal: Journal) -> None:
    """Check that the cameras were inside of what they photographed; true to any scale.

    Raises:
        MeshError: they were not: it is a facade or an object.
    """
    with journal.stage("Checking that it is a cave"):
        surface = surface_from_cloud(photo_cloud.cloud, _preview_voxel(photo_cloud.cloud))
        photo_cloud.facts["enclosure"] = check_enclosure(surface, photo_cloud.cameras, "the cameras")


def in_metres(photo_cloud: PhotoCloud, scale: PhotoScaleOptions, journal: Journal) -> PhotoCloud:
    """Return the cloud in metres, scaled by the passage's typical height where no positions gave the scale.

    Raises:
        ReconstructionError: nothing tells the scale.
    """
    if photo_cloud.has_scale:
        return photo_cloud
    if scale.passage_height is None:
        raise ReconstructionError(
            "The photos show a cave, but nothing tells its size: photos alone have no scale. Give known camera "
            "positions with --positions FILE.csv (name,x,y,z in metres), or a typical height with --passage-height."
        )
    surface = surface_from_cloud(photo_cloud.cloud, _preview_voxel(photo_cloud.cloud))
    factor = scale.passage_height / free_height(surface, photo_cloud.cameras)
    journal.warn(
        "rough-scale",
        f"The scale comes from a passage height of {scale.passage_height:g} m alone and may be off by a third. "
        "Give camera positions for a metric model.",
    )
    cloud = PointCloud(factor * photo_cloud.cloud.points, photo_cloud.cloud.normals, photo_cloud.cloud.colours)
    return PhotoCloud(cloud, factor * photo_cloud.cameras, True, photo_cloud.facts)


def write_cloud(cloud: PointCloud, path: Path) -> None:
    """Write a coloured PLY that viewers read."""
    import trimesh

    trimesh.PointCloud(cloud.points, colors=cloud.colours).export(path)


def _preview_voxel(cloud: PointCloud) -> float:
    extent = np.percentile(cloud.points, 99, axis=0) - np.percentile(cloud.points, 1, axis=0)
    return float(extent.max()) / PREVIEW_CELLS


def _facts(photos: PhotoSet, sparse: SparseModel, cloud: PointCloud) -> dict[str, object]:
    return {
        "num_photos": len(photos.photos),
        "num_registered": len(sparse.names),
        "mean_reprojection_error_px": round(float(sparse.model.compute_mean_reprojection_error()), 3),
        "num_points": len(cloud.points),
        "unregistered": [dataclasses.asdict(diagnosis) for diagnosis in sparse.diagnoses],
    }


def _note(journal: Journal, cautions: tuple[Caution, ...]) -> None:
    for caution in cautions:
        journal.warn(caution.code, caution.message)
