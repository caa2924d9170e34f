"""Make the README's pictures: a cave cut open, and a moving picture of a dive through it.

    python docs/pictures.py [--scenario cave-test-1] [--policy baseline:reference] [--start 0] [--out docs/pictures]

writes cave.png (1200 px wide) and dive.webp (10 frames a second, below 1.5 MB) and prints their sizes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from aquanav_tools.envs.factory import read_any_scenario
from aquanav_tools.envs.pictures.film import film
from aquanav_tools.envs.pictures.lamp_light import vertex_normals
from aquanav_tools.envs.pictures.triangles import Eye, see
from aquanav_tools.evaluate.env_cache import EpisodeSpec, open_env_cache
from aquanav_tools.evaluate.options import Grid, ProtocolOptions
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.protocol import EpisodePlan, conditions_of
from aquanav_tools.evaluate.recording import frames_of
from aquanav_tools.evaluate.task_adapter import adapter_of
from aquanav_tools.report.relief import plan_and_section
from aquanav_tools.report.scene_model import PORTAL_COLOUR, ROUTE, by_height
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Array

WIDTH, SAMPLES = 1200, 3
"""Of the cave's picture, px, and samples per pixel along each side."""
PAPER = (11, 31, 42)
TAN = 0.30
"""Half the width of the picture at 1 m."""
FILM_SIZE = (400, 300)
MAX_BYTES = 1_500_000


def main() -> None:
    """Write both pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="cave-test-1")
    parser.add_argument("--policy", default="baseline:reference")
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--seconds", type=float, nargs=2, default=(2.0, 12.0), help="of the dive that are shown")
    parser.add_argument("--out", type=Path, default=Path("docs/pictures"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    cave = read_any_scenario(options.scenario)
    assert isinstance(cave, Scenario), "a bay has no walls to cut open"
    draw_cave(cave, options.out / "cave.png")
    film_dive(cave, options, options.out / "dive.webp")
    for path in (options.out / "cave.png", options.out / "dive.webp"):
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


def draw_cave(cave: Scenario, path: Path) -> None:
    """Write the cave seen through its near wall, pale where it is high and blue where it is low, with its route."""
    mesh = cave.cavity.mesh
    eye = _eye(cave, mesh.vertices)
    inside = mesh.faces[:, ::-1]  # only wall that faces the viewer from within is seen
    seen, _ = see(eye, mesh.vertices, inside)
    normals = vertex_normals(mesh)
    towards = eye.centre - mesh.vertices
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    light = 0.45 + 0.65 * np.abs(np.einsum("ij,ij->i", normals, towards)) + 0.25 * np.clip(-normals[:, 2], 0.0, 1.0)
    colours = by_height(mesh.vertices).astype(float)
    shades = np.clip(colours * light[:, None], 0.0, 255.0)[inside].mean(axis=1)
    shades[cave.cavity.labels != 0] = PORTAL_COLOUR
    picture = np.where((seen >= 0)[..., None], shades[seen], PAPER).astype(np.uint8)
    for line, colour in ((cave.guide.centreline, ROUTE), (_ring(cave), PORTAL_COLOUR)):
        points = np.round(8.0 * eye.project(line)).astype(np.int32)
        cv2.polylines(picture, [points], False, colour, 3 * SAMPLES, cv2.LINE_AA, 3)
    image = Image.fromarray(picture).resize((WIDTH, eye.height // SAMPLES), Image.Resampling.BOX)
    image.quantize(128).save(path, optimize=True)


def _ring(cave: Scenario) -> Array:
    goal = cave.guide.panels[-1].polygon
    return np.vstack([goal, goal[:1]])


def _eye(cave: Scenario, vertices: Array) -> Eye:
    """Return a camera that sees the cave's long side from above, as near as all of it fits."""
    _, section = plan_and_section(cave.guide.centreline)
    back = section.towards + np.array([0.0, 0.0, 0.9])
    back /= np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(-back, right), -back])
    flat = vertices @ axes.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    distance = 0.55 * (high[0] - low[0]) / TAN + 0.5 * (high[2] - low[2])
    middle = 0.5 * (low + high) @ axes
    height = round(WIDTH * 1.25 * (high[1] - low[1]) / (high[0] - low[0])) // 2 * 2
    focal = 0.5 * WIDTH * SAMPLES / TAN
    return Eye(WIDTH * SAMPLES, height * SAMPLES, focal, middle + distance * back, axes, 10.0 * distance)


def film_dive(cave: Scenario, options: argparse.Namespace, path: Path) -> None:
    """Write some seconds of a dive, fewer frames where they take too much room."""
    (condition,) = conditions_of(Grid())
    rules = ProtocolOptions(episodes=1)
    with open_env_cache(load_policy(options.policy), rules) as env_cache:
        trajectory, metrics = env_cache.run(EpisodeSpec(0, cave, condition, EpisodePlan(0, options.start)))
    print(f"The dive from start {options.start}: {metrics.outcome} after {metrics.time:.1f} s")
    camera = adapter_of(cave).camera(trajectory, "chase", FILM_SIZE)
    frames = frames_of(trajectory)
    low, high = options.seconds
    shown = [frame for frame in frames if low <= frame.time <= high]
    while True:
        film(camera, shown, path, 10.0)
        if path.stat().st_size <= MAX_BYTES or len(shown) < 20:
            return
        shown = shown[: int(0.9 * len(shown) * MAX_BYTES / path.stat().st_size)]


if __name__ == "__main__":
    main()
