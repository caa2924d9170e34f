"""aquanav: what is installed, whether it works here, what ships with it, and photos of a synthetic cave."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from aquanav_tools.cli.command import run_command
from aquanav_tools.errors import InputError, ResourceError

DESCRIPTION = """Real caves as navigation benchmarks for underwater vehicles.

Look around with this command; work with aquanav-build-cave, aquanav-train and aquanav-eval."""

PACKAGES = (
    "aquanav",
    "gymnasium",
    "manifold3d",
    "numba",
    "numpy",
    "open3d",
    "pybullet",
    "pycolmap",
    "rerun-sdk",
    "scipy",
    "stable-baselines3",
    "torch",
    "trimesh",
)
"""What results depend on."""

CONTENT = {
    "scenario": "scenarios",
    "build recipe": "pipelines/build",
    "training recipe": "pipelines/train",
    "protocol": "eval/protocols",
}
"""Kinds of shipped files and their folders."""


@dataclass(frozen=True)
class Info:
    """Print the versions of aquanav and of the libraries that results depend on."""


@dataclass(frozen=True)
class Doctor:
    """Try each compiled library on this machine; exit code 6 when one does not work."""


@dataclass(frozen=True)
class List:
    """Name what ships with aquanav: vehicles, baselines, recipes, scenarios, protocols."""


@dataclass(frozen=True)
class Render:
    """Photograph a synthetic cave by lamp light: input for aquanav-build-cave."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for the photos, their positions (positions.csv) and the true cameras (truth.json)."""
    seed: int = 0
    """Picks the cave, its rock and the noise."""
    stations: int = 13
    """Places along the passage; five photos are taken at each."""
    width: int = 960
    """Width of a photo, px; its height is three quarters of that."""


@dataclass(frozen=True)
class Options:
    """The command line."""

    command: (
        Annotated[Info, tyro.conf.subcommand("info")]
        | Annotated[Doctor, tyro.conf.subcommand("doctor")]
        | Annotated[List, tyro.conf.subcommand("list")]
        | Annotated[Render, tyro.conf.subcommand("render")]
    )
    """What to do."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    run_command(
        tyro.conf.OmitSubcommandPrefixes[tyro.conf.OmitArgPrefixes[Options]],
        _run,
        "aquanav",
        DESCRIPTION,
        arguments=arguments,
    )


def _run(options: Options) -> None:
    match options.command:
        case Info():
            _print_table(_versions())
        case Doctor():
            _examine_libraries()
        case List():
            _print_table(_shipped())
        case Render() as render:
            _render(render)


def _print_table(rows: Iterable[tuple[str, str]]) -> None:
    for name, value in rows:
        print(f"{name:<18} {value}")


def _versions() -> list[tuple[str, str]]:
    system = [("python", platform.python_version()), ("system", f"{platform.system()} {platform.machine()}")]
    return [(name, _version(name)) for name in PACKAGES] + system


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def _shipped() -> list[tuple[str, str]]:
    from aquanav_tools.evaluate.policies import BASELINES, PREFIX
    from aquanav_tools.shipped import shipped_names
    from aquanav_tools.sim.vehicle import known_vehicles

    rows = [("vehicle", name) for name in known_vehicles()]
    rows += [("baseline", PREFIX + name) for name in BASELINES]
    return rows + [(kind, name) for kind, folder in CONTENT.items() for name in shipped_names(folder)]


def _examine_libraries() -> None:
    from aquanav_tools.cli.doctor import TRIALS, examine

    ailing = []
    for library in TRIALS:
        finding = examine(library)
        print(f"{library:<18} {'OK    ' if finding.is_well else 'FAILED'}  {finding.detail}", flush=True)
        if not finding.is_well:
            ailing.append(library)
    if ailing:
        raise ResourceError(
            f"{len(ailing)} of {len(TRIALS)} libraries do not work here: {', '.join(ailing)}. Likely a version that "
            "aquanav was not tested with, or an installation that broke off. Install aquanav again with its pins: "
            "pip install --force-reinstall -c constraints.txt ."
        )


def _render(options: Render) -> None:
    from tqdm import tqdm

    from aquanav_tools.cave.synthetic.caves import CaveOptions, demo_cave
    from aquanav_tools.reconstruct.capture import CaptureOptions
    from aquanav_tools.reconstruct.render import RenderOptions, render_photos

    try:
        capture = CaptureOptions(seed=options.seed, stations=options.stations)
        camera = RenderOptions(options.width, options.width * 3 // 4, seed=options.seed, capture=capture)
    except ValueError as cause:
        raise InputError(f"{cause} Choose larger numbers for --stations and --width.") from cause
    cave = demo_cave(CaveOptions(seed=options.seed))
    with tqdm(unit="photo") as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        photos = render_photos(cave, options.out, camera, show)
    print(f"{len(photos.names)} photos of {camera.width} x {camera.height} px lie in {options.out}.")
    print(f"Build a scenario from them: aquanav-build-cave {options.out} --positions {options.out / 'positions.csv'}")
