"""Recordings and films of flown episodes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aquanav_tools.envs.places import Place
from aquanav_tools.envs.rendering import film, film_size
from aquanav_tools.evaluate.venue import venue_of
from aquanav_tools.report.recording.episode import record_episode
from aquanav_tools.report.track import Track
from aquanav_tools.types import Progress, ignore_progress


def record_track(place: Place, track: Track, path: Path) -> None:
    """Write the rerun recording of a track."""
    record_episode(venue_of(place).scene(track), track, path)


def film_track(place: Place, track: Track, path: Path, view: str, progress: Progress = ignore_progress) -> None:
    """Write a film of a track, as MP4 or GIF.

    Raises:
        InputError: there is no such view, or no film of that kind.
    """
    states = np.concatenate([track.positions, track.orientations], axis=1)
    rate = round(1.0 / float(track.times[1] - track.times[0])) if len(track.times) > 1 else 1
    film(venue_of(place).camera(track, view, film_size(path)), states, path, rate, progress)
