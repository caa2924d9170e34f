"""Make the pictures of README and docs from what ships, by the commands that the pages show.

    python docs/pictures.py [NAME ...] [--out docs/pictures] [--work out/pictures]

What commands leave in the folder for work is kept, and used again. All together take half an hour on two cores: most of
it is the cave from photos and the policy that learns.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import runpy
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from cut_open import PAPER, cut_open, from_outside, view_of
from PIL import Image, ImageDraw, ImageFont

from aquanav_tools.envs.factory import read_any_scenario
from aquanav_tools.envs.pictures.film import film
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.evaluate.env_cache import EpisodeSpec, open_env_cache
from aquanav_tools.evaluate.options import Grid, ProtocolOptions
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.protocol import EpisodePlan, conditions_of
from aquanav_tools.evaluate.recording import frames_of
from aquanav_tools.evaluate.task_adapter import adapter_of
from aquanav_tools.report.picture import draw_cave
from aquanav_tools.report.sea_chart import draw_chart
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sea.generate import MapSettings, generate_map
from aquanav_tools.synthetic.styles.names import STYLE_NAMES
from aquanav_tools.types import Mesh

ROOT = Path(__file__).resolve().parent.parent
CAVE, HARD_CAVE = "cave-test-1", "cave-test-3"
WIDTH, TILE = 1000, (500, 240)
"""Of a picture, and of one of several in it, px."""
MAX_BYTES, MAX_FILM_BYTES = 100_000, 600_000
FILMS = ("dive", "touch", "boat")
EPISODES = 20
"""Dives among which one with a contact is looked for."""
FILM_SIZE, FILM_SECONDS = (320, 240), 10.0
ROCK = (196.0, 186.0, 170.0)
PHOTOS = ("0", "20", "40", "60")
"""Of those that are rendered, by their places in the list."""


def main() -> None:
    """Write the pictures that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(PICTURES), help="without their suffix")
    parser.add_argument("--out", type=Path, default=ROOT / "docs/pictures")
    parser.add_argument("--work", type=Path, default=ROOT / "out/pictures")
    options = parser.parse_args()
    out = options.out.resolve()
    options.work.mkdir(parents=True, exist_ok=True)
    os.chdir(options.work)
    for name in options.names:
        path = PICTURES[name](out / name)
        size, most = path.stat().st_size, MAX_FILM_BYTES if name in FILMS else MAX_BYTES
        print(f"{path.name}: {size / 1e3:.0f} kB")
        if size > most:
            sys.exit(f"That is over {most / 1e3:.0f} kB.")


def command(module: str, *words: str, leaves: str) -> Path:
    """Run a command of aquanav's where what it leaves is not there yet, and return that."""
    if not Path(leaves).exists():
        importlib.import_module(f"aquanav_tools.cli.{module}").main(list(words))
    return Path(leaves)


def cave_of(name: str | Path) -> Scenario:
    """Return a cave by its name or folder."""
    cave = read_any_scenario(name)
    assert isinstance(cave, Scenario), f"{name} is a bay"
    return cave


def save(image: Image.Image, path: Path) -> Path:
    """Write a picture, no wider than a page, as WebP."""
    image = image.convert("RGB")
    image.thumbnail((WIDTH, 4 * WIDTH), Image.Resampling.LANCZOS)
    path = path.with_suffix(".webp")
    image.save(path, quality=80, method=6)
    return path


def cave(path: Path) -> Path:
    """Write the README's cave, cut open."""
    shown = cave_of(CAVE)
    view = view_of(shown.cavity.mesh.vertices, shown.guide.centreline, 1200)
    cut_open(shown, view).quantize(128).save(path.with_suffix(".png"), optimize=True)
    return path.with_suffix(".png")


def dive(path: Path) -> Path:
    """Write ten seconds of a dive as a film."""
    return _film(path, "baseline:reference", CAVE, 1.0, 2.0)


def touch(path: Path) -> Path:
    """Write the seconds around the first contact of a dive as a film."""
    return _film(path, "baseline:reactive", HARD_CAVE, 0.5, None)


def boat(path: Path) -> Path:
    """Write ten seconds of a boat among rocks as a film."""
    return _film(path, "baseline:boat-safe", "bay-rough", 1.0, 15.0)


def _film(path: Path, policy: str, scenario: str, current: float, begin: float | None) -> Path:
    """Write FILM_SECONDS of an episode, from a time on; fewer where they take too much room.

    Without a time it is the first episode with a contact, around that.
    """
    path = path.with_suffix(".webp")
    shown = read_any_scenario(scenario)
    (condition,) = conditions_of(Grid(current=(current,)))
    with open_env_cache(load_policy(policy), ProtocolOptions(episodes=EPISODES)) as env_cache:
        for episode in range(EPISODES):
            plan = EpisodePlan(episode, episode if isinstance(shown, Scenario) else None)  # drawn bays have no list
            spec = EpisodeSpec(episode, shown, condition, plan)
            trajectory, _ = env_cache.run(spec)
            if begin is not None or trajectory.collided.any():
                break
        else:
            sys.exit(f"None of {EPISODES} dives of {policy} in {scenario} touches the wall. Film another policy.")
    camera = adapter_of(shown).camera(trajectory, "chase", FILM_SIZE)
    frames = frames_of(trajectory)
    if begin is None:
        begin = next(frame.time for frame in frames if frame.is_touching) - 0.7 * FILM_SECONDS
    frames = [frame for frame in frames if begin <= frame.time <= begin + FILM_SECONDS]
    film(camera, frames, path, 10.0)
    while path.stat().st_size > MAX_FILM_BYTES:
        frames = frames[: int(0.95 * len(frames) * MAX_FILM_BYTES / path.stat().st_size)]
        film(camera, frames, path, 10.0)
    return path


def report(path: Path) -> Path:
    """Write the top of an evaluation's report, as a browser shows it."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        sys.exit("The picture of a report is taken by chromium, which is not installed. Leave it out, or install it.")
    words = ("baseline:reactive", "--scenario", HARD_CAVE, "--current", "half", "--record", "none", "-o", "out/hard")
    page = command("evaluate", *words, leaves="out/hard/report.html").resolve()
    flags = (
        "--headless",
        "--no-sandbox",
        "--hide-scrollbars",
        f"--window-size={WIDTH},1200",
        "--screenshot=report.png",
    )
    subprocess.run([browser, *flags, page.as_uri()], check=True, capture_output=True, timeout=120)
    return save(Image.open("report.png"), path)


def guide(path: Path) -> Path:
    """Write plan and long section with route, panels and starts."""
    drawn = Path("guide.png")
    draw_cave(cave_of(CAVE), drawn)
    return save(Image.open(drawn), path)


def scan(path: Path) -> Path:
    """Write the tutorial's scan beside the cave that is built from it."""
    if not Path("scan.ply").exists():
        page = (ROOT / "docs/tutorial-scan.md").read_text(encoding="utf-8")
        Path("scan_of_the_tutorial.py").write_text(page.split("```python\n")[1].split("```")[0], encoding="utf-8")
        runpy.run_path("scan_of_the_tutorial.py")
    built = cave_of(
        command("build_cave", "scan.ply", "-o", "caves/scan", "--unit", "cm", leaves="caves/scan").resolve()
    )
    raw = trimesh.load_mesh("scan.ply")
    mesh = Mesh(np.array(raw.vertices) / 100.0, np.array(raw.faces, dtype=np.int64))
    view = view_of(mesh.vertices, built.guide.centreline, WIDTH // 2, 300)
    pale = np.tile(ROCK, (len(mesh.faces), 1))
    return save(_grid([from_outside(mesh, view, pale), cut_open(built, view)], 2), path)


def photos(path: Path) -> Path:
    """Write some of the tutorial's photos above the cave that is built from them."""
    command("info", "render", "--out", "photos", leaves="photos/positions.csv")
    words = ("photos", "-o", "caves/photos", "--positions", "photos/positions.csv")
    command("build_cave", *words, leaves="caves/photos/scenario.toml")
    files = sorted(Path("photos").glob("*.jpg"))
    taken = [Image.open(files[int(place)]).resize((WIDTH // 4, 3 * WIDTH // 16)) for place in PHOTOS]
    built = cave_of(Path("caves/photos").resolve())
    view = view_of(built.cavity.mesh.vertices, built.guide.centreline, WIDTH, WIDTH // 2)
    return save(_grid([_grid(taken, 4), cut_open(built, view)], 1), path)


def survey(path: Path) -> Path:
    """Write the plan of the tutorial's survey."""
    page = (ROOT / "docs/tutorial-survey.md").read_text(encoding="utf-8")
    Path("survey.svx").write_text(page.split("```text\n")[1].split("```")[0], encoding="utf-8")
    command("build_cave", "survey.svx", "-o", "caves/survey", leaves="caves/survey/scenario.toml")
    return save(Image.open("caves/survey/drawings/plan.png"), path)


def training(path: Path) -> Path:
    """Write the curves of the tutorial's training."""
    command("train", "--scenario", CAVE, "--steps", "300000", "-o", "out/train", leaves="out/train/report.html")
    return save(Image.open("out/train/pictures/learning.png"), path)


def trails(path: Path) -> Path:
    """Write the trails of dives that touch the wall."""
    leaves = f"out/hard/pictures/{HARD_CAVE}-trails.png"
    words = ("baseline:reactive", "--scenario", HARD_CAVE, "--current", "half", "--record", "none", "-o", "out/hard")
    return save(Image.open(command("evaluate", *words, leaves=leaves)), path)


def stress(path: Path) -> Path:
    """Write the cases of a search for failures."""
    words = ("stress", "baseline:reference", "--scenario", HARD_CAVE, "--current", "half", "--budget", "200")
    leaves = "out/stress/pictures/cases.png"
    return save(Image.open(command("evaluate", *words, "-o", "out/stress", leaves=leaves)), path)


def export(path: Path) -> Path:
    """Write what trimesh reads of an exported cave: its wall from within, and its route."""
    scene = command("info", "export", CAVE, "--to", "gltf", "-o", "out/gltf", leaves="out/gltf/cave.glb")
    read = trimesh.load(scene, force="mesh")
    up = np.column_stack([read.vertices[:, 0], -read.vertices[:, 2], read.vertices[:, 1]])  # glTF has y up
    mesh = Mesh(up, np.array(read.faces, dtype=np.int64))
    places = json.loads(scene.with_name("scene.json").read_text(encoding="utf-8"))
    lines = [np.array(places["route"])]
    view = view_of(mesh.vertices, cave_of(CAVE).guide.centreline, WIDTH)
    return save(from_outside(mesh, view, np.tile(ROCK, (len(mesh.faces), 1)), lines, is_cut=True), path)


def styles(path: Path) -> Path:
    """Write a drawn cave of every style, cut open."""
    tiles = []
    for style in STYLE_NAMES:
        shown = cave_of(f"generated/{style}/0")
        view = view_of(shown.cavity.mesh.vertices, shown.guide.centreline, *TILE)
        tiles.append(_titled(cut_open(shown, view), f"{style}, {shown.guide.length:.0f} m"))
    return save(_grid(tiles, 2), path)


def bays(path: Path) -> Path:
    """Write the chart of a bay beside a boat in it."""
    bay = generate_map(seed=7, settings=MapSettings())
    draw_chart(bay, Path("bay.png"), boat_width=3.09)
    env = SurfaceEnv(bay, sea="breeze", render_mode="rgb_array", render_size=(640, 480), action="continuous")
    env.reset(seed=1)
    for _ in range(60):
        env.step(np.array([0.0, 1.0]))
    boat = Image.fromarray(env.render())
    env.close()
    chart = Image.open("bay.png").convert("RGB")
    height = round(WIDTH * chart.height / chart.width)
    return save(
        _grid([chart.resize((WIDTH, height)), boat.resize((WIDTH, 3 * WIDTH // 4)).crop((0, 150, WIDTH, 600))], 1), path
    )


def _titled(image: Image.Image, title: str) -> Image.Image:
    font = ImageFont.load_default(size=18)
    ImageDraw.Draw(image).text((12, image.height - 30), title, fill=(225, 235, 238), font=font)
    return image


def _grid(images: list[Image.Image], columns: int) -> Image.Image:
    """Return pictures of one size per row beside and below each other."""
    rows = [images[first : first + columns] for first in range(0, len(images), columns)]
    width = max(sum(image.width for image in row) for row in rows)
    page = Image.new("RGB", (width, sum(row[0].height for row in rows)), PAPER)
    top = 0
    for row in rows:
        left = 0
        for image in row:
            page.paste(image, (left, top))
            left += image.width
        top += row[0].height
    return page


PICTURES: dict[str, Callable[[Path], Path]] = {
    function.__name__: function
    for function in (
        cave,
        dive,
        touch,
        boat,
        report,
        guide,
        scan,
        survey,
        photos,
        training,
        trails,
        stress,
        export,
        styles,
        bays,
    )
}
"""By their names; docs/pictures/sonar.png is made by examples/sonar_ping.py."""

if __name__ == "__main__":
    main()
