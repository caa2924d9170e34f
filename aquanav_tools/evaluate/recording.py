"""Recordings and films of run episodes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.envs.pictures.film import SHOWN_FOR, Frame, film, film_size
from aquanav_tools.evaluate.task_adapter import adapter_of
from aquanav_tools.report.recording.bag import write_bag
from aquanav_tools.report.recording.episode import record_episode
from aquanav_tools.report.trajectory import Trajectory
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Progress, ignore_progress


def record_trajectory(scenario: AnyScenario, trajectory: Trajectory, path: Path) -> None:
    """Write the rerun recording of a trajectory."""
    record_episode(adapter_of(scenario).scene(trajectory), trajectory, path)


def bag_trajectory(scenario: AnyScenario, trajectory: Trajectory, path: Path) -> None:
    """Write the bag of a trajectory, for ROS 2.

    Raises:
        LibraryError: rosbags is not installed.
        InputError: there is something at its path.
    """
    directions = adapter_of(scenario).scene(trajectory).ray_directions
    write_bag(path, trajectory, directions, scenario if isinstance(scenario, Scenario) else None)


def film_trajectory(
    scenario: AnyScenario, trajectory: Trajectory, path: Path, view: str, progress: Progress = ignore_progress
) -> None:
    """Write a film of a trajectory.

    Raises:
        InputError: there is no such view, or no film of that kind.
    """
    rate = round(1.0 / float(trajectory.times[1] - trajectory.times[0])) if len(trajectory.times) > 1 else 1
    film(adapter_of(scenario).camera(trajectory, view, film_size(path)), frames_of(trajectory), path, rate, progress)


def frames_of(trajectory: Trajectory) -> list[Frame]:
    """Return what a film shows of each state of a trajectory."""
    states = np.concatenate([trajectory.positions, trajectory.orientations], axis=1)
    begun = np.zeros(len(states), dtype=np.int64)
    begun[trajectory.contact_states] = 1
    contacts, touched = np.cumsum(begun), trajectory.times[trajectory.collided]
    return [
        Frame(
            state=state,
            time=float(time),
            clearance=max(float(trajectory.clearances[row]), 0.0),
            num_contacts=int(contacts[row]),
            is_touching=bool(((touched <= time) & (touched > time - SHOWN_FOR)).any()),
            progress=float(trajectory.progress[row]),
            speed=float(np.linalg.norm(trajectory.velocities[row, :3])),
        )
        for row, (state, time) in enumerate(zip(states, trajectory.times, strict=True))
    ]
