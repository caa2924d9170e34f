"""Recordings and films of run episodes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aquanav_tools.envs.pictures.film import SHOWN_FOR, Frame, film, film_size
from aquanav_tools.envs.places import Place
from aquanav_tools.evaluate.task_adapter import adapter_of
from aquanav_tools.report.recording.episode import record_episode
from aquanav_tools.report.track import Track
from aquanav_tools.types import Progress, ignore_progress


def record_track(place: Place, track: Track, path: Path) -> None:
    """Write the rerun recording of a track."""
    record_episode(adapter_of(place).scene(track), track, path)


def film_track(place: Place, track: Track, path: Path, view: str, progress: Progress = ignore_progress) -> None:
    """Write a film of a track.

    Raises:
        InputError: there is no such view, or no film of that kind.
    """
    rate = round(1.0 / float(track.times[1] - track.times[0])) if len(track.times) > 1 else 1
    film(adapter_of(place).camera(track, view, film_size(path)), frames_of(track), path, rate, progress)


def frames_of(track: Track) -> list[Frame]:
    """Return what a film shows of each state of a track."""
    states = np.concatenate([track.positions, track.orientations], axis=1)
    begun = np.zeros(len(states), dtype=np.int64)
    begun[track.contact_states] = 1
    contacts, touched = np.cumsum(begun), track.times[track.collided]
    return [
        Frame(
            state=state,
            time=float(time),
            clearance=max(float(track.clearances[row]), 0.0),
            num_contacts=int(contacts[row]),
            is_touching=bool(((touched <= time) & (touched > time - SHOWN_FOR)).any()),
            progress=float(track.progress[row]),
            speed=float(np.linalg.norm(track.velocities[row, :3])),
        )
        for row, (state, time) in enumerate(zip(states, track.times, strict=True))
    ]
