"""The whole way from a set of photos to a cloud in metres, one call per stage."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from aquanav_tools.cave.scan.sight import Sight
from aquanav_tools.provenance import digest, file_hash
from aquanav_tools.reconstruct.depth import DepthOptions, estimate_depth, undistort
from aquanav_tools.reconstruct.diagnosis import Caution
from aquanav_tools.reconstruct.earlier import find_earlier
from aquanav_tools.reconstruct.features import FeatureOptions, extract_features
from aquanav_tools.reconstruct.fusion import FusedDepth, FusionOptions, fuse_depth
from aquanav_tools.reconstruct.georeference.place import Georeference
from aquanav_tools.reconstruct.georeference.sources import NOTHING_KNOWN, KnownWorld
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.intake.options import Quality
from aquanav_tools.reconstruct.intake.prepare import find_mask, prepare_photos
from aquanav_tools.reconstruct.mapping import MappingOptions, SparseModel, map_photos
from aquanav_tools.reconstruct.matching import MatchOptions, match_features
from aquanav_tools.reconstruct.record import PhotoRecord
from aquanav_tools.store import StageStore, copied
from aquanav_tools.types import Array, PointCloud, Sim3, Stages, silent
from aquanav_tools.values import kept_value

DATABASE = "database.db"
"""Of COLMAP: keypoints, and in the next stage's copy of it matches too."""


@dataclass(frozen=True)
class ReconstructOptions:
    """The settings of all stages."""

    features: FeatureOptions = field(default_factory=FeatureOptions)
    matching: MatchOptions = field(default_factory=MatchOptions)
    mapping: MappingOptions = field(default_factory=MappingOptions)
    depth: DepthOptions = field(default_factory=DepthOptions)
    fusion: FusionOptions = field(default_factory=FusionOptions)

    @classmethod
    def at(cls, quality: Quality) -> ReconstructOptions:
        """Return the settings of a quality."""
        depth = DepthOptions.at(quality)
        if quality == "draft":
            return cls(FeatureOptions(max_features=3072), MatchOptions(alike=10), depth=depth)
        if quality == "high":
            return cls(FeatureOptions(max_features=8192), MatchOptions(exhaustive_up_to=150, alike=40), depth=depth)
        return cls(depth=depth)


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A passage as its photos show it, in the world frame."""

    cloud: PointCloud
    """Fused points, m, with normals into the water and colours."""
    camera_centres: Array
    """(N, 3) where the registered photos were taken, m."""
    camera_rotations: Array
    """(N, 3, 3) their `cam_from_world` rotations."""
    camera_names: tuple[str, ...]
    """The photos those are."""
    warnings: tuple[Caution, ...]
    statistics: dict[str, Any]
    """Figures for the report, ready for JSON."""
    is_metric: bool = False
    """Whether something gave the scale; else lengths are in an arbitrary unit."""
    world_from_sfm: Sim3 = field(default_factory=Sim3)
    """Where the sparse model lies."""
    sight: Sight | None = None
    """How far each camera looked, for photos with a depth map."""

    def moved(self, b_from_a: Sim3) -> Reconstruction:
        """Return the reconstruction in another frame, for instance after its scale became known."""
        cloud, sight = self.cloud.moved(b_from_a), None if self.sight is None else self.sight.moved(b_from_a)
        centres = b_from_a.apply(self.camera_centres)
        rotations = self.camera_rotations @ b_from_a.rotation.T
        world_from_sfm = b_from_a @ self.world_from_sfm
        return replace(
            self,
            cloud=cloud,
            camera_centres=centres,
            camera_rotations=rotations,
            world_from_sfm=world_from_sfm,
            sight=sight,
        )


def reconstruct(
    photos: PhotoSet,
    workspace: Path,
    options: ReconstructOptions,
    world: KnownWorld = NOTHING_KNOWN,
    stage: Stages = silent,
    record: PhotoRecord | None = None,
) -> Reconstruction:
    """Return the passage that a set of photos shows.

    Args:
        photos: From `read_photos`.
        workspace: What every stage makes is kept there, under a hash of all that it rests on, and taken up again by a
            later call. What is known of the world only moves the result, and rests in no stage.
        options: Of all stages.
        world: What tells scale and up, from `read_world`; without it the scale is arbitrary.
        stage: Shows the stages.
        record: Is told where the stages leave what a report shows, also when a later one stops.

    Raises:
        InputError: photos cannot be used, or show no marker where nothing else can tell the scale.
        ReconstructionError: too few photos register, or their depths do not agree.
        ResourceError: the disk is full; a later call goes on from what was finished.
    """
    record = PhotoRecord() if record is None else record
    store = StageStore(workspace, stage)
    content = [(name, *_content(photos, name)) for name in photos.names]
    record.photos = photos = _prepare(photos, content, store)
    if world.given.marker_size is not None:
        with stage("Looking for markers") as progress:
            world = world.with_markers(photos, progress)
    sparse, models = _place_cameras(photos, content, store, options, record)
    with stage("Finding scale and up"):
        placement = world.place(sparse)
    fused = _measure_depth(photos, sparse, models, store, options, record)
    return assemble(photos, sparse, placement, fused)


def _prepare(photos: PhotoSet, content: list[tuple[str, str, str]], store: StageStore) -> PhotoSet:
    """Return the photos as later stages want them."""
    home = str(photos.folder.resolve())
    with store.stage("Preparing the photos", "prepared", prepare_photos, home, content, _look(photos)) as opened:
        return prepare_photos(photos, *opened)


def _look(photos: PhotoSet) -> tuple[object, ...]:
    """Return the settings that change how photos are looked at."""
    return photos.intake.lens, photos.intake.housing, photos.intake.enhance


def _place_cameras(
    photos: PhotoSet,
    content: list[tuple[str, str, str]],
    store: StageStore,
    options: ReconstructOptions,
    record: PhotoRecord,
) -> tuple[SparseModel, str]:
    """Return the sparse model of prepared photos, and the name of what it rests on.

    Each photo's content is its name, its hash and its mask's.
    """
    look = _look(photos)
    keys = {photo.file: digest(one, look, options.features) for photo, one in zip(photos.photos, content, strict=True)}
    inputs: tuple[object, ...] = (content, look, options.features)
    with store.stage("Finding features", "features", extract_features, *inputs) as (features, progress):
        known = find_earlier(features, DATABASE, keys, extract_features)
        extract_features(photos, features / DATABASE, options.features, progress, known)
    inputs = (features.name, options.matching)
    with store.stage("Matching photos", "matches", match_features, *inputs) as (matches, progress):
        record.database = database = copied(features / DATABASE, matches / DATABASE)
        match_features(photos, database, options.matching, progress)
    inputs = (matches.name, options.mapping)
    with store.stage("Placing cameras", "models", map_photos, *inputs) as (models, progress):
        record.sparse = sparse = map_photos(photos, database, models / "models", options.mapping, progress)
    return sparse, models.name


def _measure_depth(
    photos: PhotoSet,
    sparse: SparseModel,
    models: str,
    store: StageStore,
    options: ReconstructOptions,
    record: PhotoRecord,
) -> FusedDepth:
    """Return the cloud and what the cameras saw, in the frame of a sparse model, which is kept under a name."""
    with store.stage("Measuring depth", "depth", estimate_depth, models, options.depth) as (depth, progress):
        record.dense_dir = dense_dir = depth / "dense"
        undistort(photos, sparse, dense_dir, options.depth)
        record.depth_paths = depth_paths = estimate_depth(dense_dir, options.depth, progress)
    with store.stage("Fusing depth maps", "fused", fuse_depth, depth.name, options.fusion) as (fused, progress):
        return kept_value(
            FusedDepth, fused / "fused.npz", lambda: fuse_depth(dense_dir, depth_paths, options.fusion, progress)
        )


def _content(photos: PhotoSet, name: str) -> tuple[str, str]:
    """Return the hashes of a photo and of its mask, which is empty where there is none."""
    mask = find_mask(photos.folder, name)
    return file_hash(photos.path(name)), "" if mask is None else file_hash(mask)


def assemble(photos: PhotoSet, sparse: SparseModel, placement: Georeference, fused: FusedDepth) -> Reconstruction:
    """Return the result of the stages as one value.

    Args:
        photos: All photos handed in.
        sparse: The sparse model in its own frame.
        placement: Where that lies in the world.
        fused: The cloud and what the cameras saw, in the model's frame.
    """
    names = tuple(sparse.names)
    statistics = {
        "photos": len(photos.photos),
        "registered": len(names),
        "mapping": "global" if sparse.is_at_once else "incremental",
        "sparse_points": int(sparse.model.num_points3D()),
        "reprojection_error_px": round(float(sparse.model.compute_mean_reprojection_error()), 3),
        "cloud_points": len(fused.cloud.points),
        "unregistered": [diagnosis.row for diagnosis in sparse.diagnoses],
        **placement.statistics,
    }
    cautions = sparse.cautions + placement.cautions
    is_metric = placement.scale_error is not None
    found = Reconstruction(
        fused.cloud, sparse.centres, sparse.rotations, names, cautions, statistics, is_metric, sight=fused.sight
    )
    return found.moved(placement.world_from_sfm)
