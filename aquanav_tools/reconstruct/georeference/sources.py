"""The sources of scale and up that were given, read before the long work and asked after it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.diagnosis import Caution
from aquanav_tools.reconstruct.georeference.camera_positions import read_positions
from aquanav_tools.reconstruct.georeference.clues import Clue
from aquanav_tools.reconstruct.georeference.depth_track import read_depth_track
from aquanav_tools.reconstruct.georeference.floor import LevelFloor
from aquanav_tools.reconstruct.georeference.gps import read_gps
from aquanav_tools.reconstruct.georeference.gravity import read_gravity
from aquanav_tools.reconstruct.georeference.markers import check_dictionary, find_markers
from aquanav_tools.reconstruct.georeference.options import ScaleSources
from aquanav_tools.reconstruct.georeference.picks import read_distances, read_picks, read_stations
from aquanav_tools.reconstruct.georeference.place import UNUSED, Georeference, place
from aquanav_tools.reconstruct.georeference.rig import read_rig
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.types import Progress, ignore_progress


class Source(Protocol):
    """Something that knows about the world, read and checked."""

    def clue(self, sparse: SparseModel) -> Clue:
        """Return what it says of a model; InputError where that is nothing."""


@dataclass(frozen=True, eq=False)
class KnownWorld:
    """The sources of a build."""

    given: ScaleSources
    sources: tuple[Source, ...]
    """Those that could be read: markers only once the photos are prepared."""
    cautions: tuple[Caution, ...] = ()
    """About those that could not."""

    def with_markers(self, photos: PhotoSet, progress: Progress = ignore_progress) -> KnownWorld:
        """Return the sources with the markers that prepared photos show, if there should be some.

        Raises:
            InputError: no two photos show the same marker, and nothing else can tell the scale.
        """
        if self.given.marker_size is None:
            return self
        try:
            markers = find_markers(photos, self.given.marker_size, self.given.marker_dictionary, progress)
        except InputError as error:
            if self.given.scaling == ("marker_size",):
                raise
            return replace(self, cautions=(*self.cautions, Caution(UNUSED, str(error))))
        return replace(self, sources=(*self.sources, markers))

    def place(self, sparse: SparseModel) -> Georeference:
        """Return where a model lies in the world; a source that says nothing of it becomes a caution."""
        clues, cautions = [], list(self.cautions)
        for source in self.sources:
            try:
                clues.append(source.clue(sparse))
            except InputError as error:
                cautions.append(Caution(UNUSED, str(error)))
        placement = place(sparse.centres, sparse.rotations, clues)
        return replace(placement, cautions=(*cautions, *placement.cautions))


NOTHING_KNOWN = KnownWorld(ScaleSources(), ())


def read_world(given: ScaleSources, photos: PhotoSet, seed: int = 0) -> KnownWorld:
    """Return the given sources and the accelerometers of the photos' cameras, read and checked.

    Raises:
        InputError: a file or a name is wrong, or the photos do not hold what they should.
    """
    names = photos.names
    sources: list[Source] = []
    if given.positions is not None:
        sources.append(read_positions(given.positions, names))
    if given.picks is not None:
        picks = read_picks(given.picks, names)
        if given.distance:
            sources.append(read_distances(picks, given.distance))
        if given.stations is not None:
            sources.append(read_stations(picks, given.stations))
    if given.rig is not None:
        sources.append(read_rig(*given.rig, names))
    if given.depth_track is not None:
        sources.append(read_depth_track(given.depth_track, photos, given.clock_ahead))
    if given.gps:
        sources.append(read_gps(photos))
    if given.level_floor:
        sources.append(LevelFloor(seed))
    if given.marker_size is not None:
        check_dictionary(given.marker_dictionary)
    gravity = read_gravity(photos)
    return KnownWorld(given, tuple(sources) if gravity is None else (*sources, gravity))
