"""CPU time of a frame: python eval/benchmarks/films.py [NUMBER OF FRAMES] [--scenario FOLDER] [--keep] [--smoke].

A film in a cave from behind and from the nose, and one of a boat at sea, each with its numbers on it, as WebM and as
MP4; all threads' time, which is also what it costs where many films are made side by side. Each film is made three
times, of which the least counts: others use the machine too. The first frame, which compiles and reads, is left out.
Without a scenario the cave is a straight tube.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

sys.path.insert(0, str(Path(__file__).parents[2]))  # eval and the tiny caves of the tests are no part of the package

from aquanav_tools.envs.pictures.film import FILM_SIZES, Camera, Frame, film
from aquanav_tools.envs.pictures.sea_camera import SeaCamera
from aquanav_tools.envs.pictures.vehicle_camera import VehicleCamera
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.appearance import vehicle_mesh
from aquanav_tools.sim.sensors import boat_pattern
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, yaw_quaternion
from eval.pages import RESULTS, Record
from eval.smoke import parser_of
from tests.caves import tube_scenario

SECONDS = 0.1
"""Between two frames."""
ROUNDS = 3
"""Films of which the least time counts."""


class BoatCamera:
    """Takes pictures of a boat that lies at its start while the sea goes on."""

    def __init__(self, size: tuple[int, int]) -> None:
        env = SurfaceEnv(0, sea="rough")
        env.reset(seed=0)
        self._water, self.state, self.size = env.water, env.state, size
        pattern = boat_pattern()
        self._lengths = pattern.lengths
        self._camera = SeaCamera(env.vehicle, size, pattern.directions, pattern.lengths)
        self._camera.look_at(env.sea_map)

    def picture(self, state: Array, time: float) -> npt.NDArray[np.uint8]:
        """Return the next picture."""
        self._water.advance(SECONDS)
        return self._camera.picture(state, self._water, self._lengths, time)


def main() -> None:
    """Print a table."""
    parser = parser_of(__doc__)
    parser.add_argument("count", nargs="?", type=int, default=100)
    parser.add_argument("--scenario", type=Path)
    parser.add_argument("--keep", action="store_true", help="put the table into eval/results/films.md")
    options = parser.parse_args()
    record = Record("eval/benchmarks/films.py")
    count = 3 if options.smoke else options.count
    cave = tube_scenario() if options.scenario is None else read_scenario(options.scenario)
    along = np.linspace(0.1, 0.6, count) * cave.guide.length
    route = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(cave.guide.centreline, axis=0), axis=1))])
    places = np.stack([np.interp(along, route, column) for column in cave.guide.centreline.T], axis=1)
    ways = np.diff(places, axis=0, append=2.0 * places[-1:] - places[-2:-1])
    states = [
        np.concatenate([place, yaw_quaternion(float(np.arctan2(way[1], way[0])))])
        for place, way in zip(places, ways, strict=True)
    ]
    record.say(f"{count} frames of each, the least of {ROUNDS} films; one shows each decision, {SECONDS:g} s.\n")
    record.say("| film | px | CPU time per frame, ms | by the clock, ms | first frame, ms |\n|---|---|---|---|---|")
    for suffix in (".webm", ".mp4"):
        size = FILM_SIZES[suffix]
        for view in ("chase", "onboard"):
            record.say(row(f"{cave.name}, {view}", vehicle_camera(cave, view, size), states, suffix))
        boat = BoatCamera(size)
        record.say(row("boat, rough sea", boat, [boat.state] * count, suffix))
    if options.keep:
        record.keep(RESULTS / "films.md", "films")


def vehicle_camera(cave: Scenario, view: str, size: tuple[int, int]) -> VehicleCamera:
    """Return a camera behind or in a BlueROV2."""
    vehicle = load_vehicle("bluerov2")
    return VehicleCamera(cave, vehicle.capsule, vehicle_mesh(vehicle), view, size)


def row(name: str, camera: Camera, states: list[Array], suffix: str) -> str:
    """Return a row of the table."""
    frames = [Frame(state, SECONDS * n, 0.5, 0, False, 1.0, 1.0) for n, state in enumerate(states)]
    spent = np.array([times_of(camera, frames, suffix) for _ in range(ROUNDS)])
    cpu, clock = spent[:, 1:].mean(axis=1).min(axis=0)
    width, height = camera.size
    return f"| {name} | {width} x {height}, {suffix} | {cpu:.0f} | {clock:.0f} | {spent[0, 0, 1]:.0f} |"


def times_of(camera: Camera, frames: list[Frame], suffix: str) -> Array:
    """Return the (N, 2) CPU time and time by the clock of each frame of a film, ms."""
    times = [(time.process_time(), time.perf_counter())]

    def note(*_: int) -> None:
        times.append((time.process_time(), time.perf_counter()))

    with tempfile.TemporaryDirectory() as folder:
        film(camera, frames, Path(folder) / f"film{suffix}", 1.0 / SECONDS, note)
    found: Array = 1e3 * np.diff(times, axis=0)
    return found


if __name__ == "__main__":
    main()
