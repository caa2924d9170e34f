"""aquanav: what is installed, whether it works, what ships, synthetic photos, the original's caves, what water does."""

from __future__ import annotations

import importlib
import platform
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from aquanav_tools import __version__
from aquanav_tools.cli.card import Card, run_card
from aquanav_tools.cli.cave_facts import cave_facts, is_built_cave
from aquanav_tools.cli.command import DEBUG_FLAG, run_command
from aquanav_tools.cli.export import Export, run_export
from aquanav_tools.cli.generate import Generate, run_generate
from aquanav_tools.cli.import_original import ImportOriginal, run_import
from aquanav_tools.cli.leaderboard import Leaderboard, run_leaderboard
from aquanav_tools.cli.render import Render, run_render
from aquanav_tools.cli.report import Report, run_report
from aquanav_tools.cli.scenarios import Scenarios, run_scenarios
from aquanav_tools.cli.water_impact import WaterImpact, run_water_impact
from aquanav_tools.errors import ResourceError
from aquanav_tools.libraries import installed_version

DESCRIPTION = """Real caves as navigation benchmarks for underwater vehicles.

  aquanav build scan.stl -o caves/mine
  aquanav train --scenario caves/mine -o out/train
  aquanav eval out/train/policy.zip --scenario caves/mine

`aquanav COMMAND --help` explains each. aquanav-build-cave, aquanav-train and aquanav-eval are the same commands.
Add --version for the version of aquanav alone."""

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
    "bay": "scenarios/bays",
    "build recipe": "pipelines/build",
    "training recipe": "pipelines/train",
    "protocol": "eval/protocols",
    "benchmark": "eval/sets",
}
"""Kinds of shipped files and their folders."""


@dataclass(frozen=True)
class Info:
    """Print the versions that results depend on, or what a vehicle can do, or what gets through a built cave."""

    vehicle: Annotated[str | None, tyro.conf.Positional] = None
    """A shipped vehicle's name, or a .toml file of your own, which is checked; or the folder of a built cave."""


@dataclass(frozen=True)
class Doctor:
    """Try each compiled library that is installed here; exit code 6 when one does not work."""


@dataclass(frozen=True)
class List:
    """Name what ships with aquanav: vehicles, baselines, recipes, scenarios, protocols."""


@dataclass(frozen=True)
class Build:
    """Build a scenario from a scan, a survey, photos or a video; the same as aquanav-build-cave."""


@dataclass(frozen=True)
class Train:
    """Learn a policy; the same as aquanav-train."""


@dataclass(frozen=True)
class Evaluate:
    """Score a policy, compare scores, replay an episode; the same as aquanav-eval."""


@dataclass(frozen=True)
class Options:
    """The command line."""

    command: (
        Annotated[Build, tyro.conf.subcommand("build")]
        | Annotated[Train, tyro.conf.subcommand("train")]
        | Annotated[Evaluate, tyro.conf.subcommand("eval")]
        | Annotated[Info, tyro.conf.subcommand("info")]
        | Annotated[Doctor, tyro.conf.subcommand("doctor")]
        | Annotated[List, tyro.conf.subcommand("list")]
        | Annotated[Render, tyro.conf.subcommand("render")]
        | Annotated[ImportOriginal, tyro.conf.subcommand("import-original")]
        | Annotated[WaterImpact, tyro.conf.subcommand("water-impact")]
        | Annotated[Scenarios, tyro.conf.subcommand("scenarios")]
        | Annotated[Generate, tyro.conf.subcommand("generate")]
        | Annotated[Leaderboard, tyro.conf.subcommand("leaderboard")]
        | Annotated[Card, tyro.conf.subcommand("card")]
        | Annotated[Export, tyro.conf.subcommand("export")]
        | Annotated[Report, tyro.conf.subcommand("report")]
    )
    """What to do."""


COMMANDS = {"build": "build_cave", "train": "train", "eval": "evaluate"}
"""Subcommands that are commands of their own as well, and the modules of these, which read the rest of the line."""
VERSION_FLAG = "--version"
CANNOT_WRITE = re.compile(r"read-only|writ(e|able)|permission denied", re.IGNORECASE)
"""In what a library says that finds no folder to write to."""
NO_PLACE = (
    "They find no folder that they can write to. Set HOME or TMPDIR to one, or, where only some lack a place, "
    "NUMBA_CACHE_DIR, WARP_CACHE_PATH and MPLCONFIGDIR."
)
REINSTALL = (
    "Likely a version that aquanav was not tested with, or an installation that broke off. Install aquanav again with "
    "its pins: pip install --force-reinstall -c constraints.txt ."
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    words = [argument for argument in arguments if argument != DEBUG_FLAG]
    if words[:1] == [VERSION_FLAG]:
        print(f"aquanav {__version__}")
        return
    if words and words[0] in COMMANDS:
        arguments.remove(words[0])
        importlib.import_module(f"aquanav_tools.cli.{COMMANDS[words[0]]}").main(arguments)
        return
    run_command(
        tyro.conf.OmitSubcommandPrefixes[tyro.conf.OmitArgPrefixes[Options]],
        _run,
        "aquanav",
        DESCRIPTION,
        arguments=arguments,
    )


def _run(options: Options) -> None:
    match options.command:
        case Info(vehicle=None):
            _print_table(_versions())
        case Info(vehicle=str(name)) if is_built_cave(Path(name)):
            _print_table(cave_facts(Path(name)))
        case Info(vehicle=str(name)):
            _print_table(_vehicle_facts(name))
        case Doctor():
            _examine_libraries()
        case List():
            _print_table(_shipped())
        case Render() as render:
            run_render(render)
        case ImportOriginal() as chosen:
            run_import(chosen)
        case WaterImpact() as experiment:
            run_water_impact(experiment)
        case Scenarios() as scenarios:
            run_scenarios(scenarios)
        case Generate() as drawing:
            run_generate(drawing)
        case Leaderboard() as leaderboard:
            run_leaderboard(leaderboard)
        case Card() as card:
            run_card(card)
        case Export() as scene:
            run_export(scene)
        case Report() as report:
            run_report(report)


def _print_table(rows: Iterable[tuple[str, str]]) -> None:
    for name, value in rows:
        print(f"{name:<18} {value}")


def _versions() -> list[tuple[str, str]]:
    system = [("python", platform.python_version()), ("system", f"{platform.system()} {platform.machine()}")]
    return [(name, installed_version(name)) for name in PACKAGES] + system


def _vehicle_facts(name: str) -> list[tuple[str, str]]:
    from aquanav_tools.sim.trial import try_out
    from aquanav_tools.sim.vehicle import load_vehicle

    vehicle = load_vehicle(name)
    trial = try_out(vehicle)
    return [
        ("vehicle", f"{vehicle.name}: {vehicle.summary()}"),
        ("hull", f"{vehicle.capsule.length:.3f} m long, {2.0 * vehicle.capsule.radius:.3f} m wide"),
        ("full thrust", f"{trial.ahead:.2f} m/s ahead, {trial.reverse:.2f} m/s in reverse"),
        ("full steer", f"{trial.turn:.2f} rad/s at full thrust"),
        ("full ballast", f"{trial.rise:.2f} m/s up, {trial.sink:.2f} m/s down"),
    ]


def _shipped() -> list[tuple[str, str]]:
    from aquanav_tools.evaluate.policies import PREFIX, baseline_names
    from aquanav_tools.evaluate.shielding import SHIELD
    from aquanav_tools.shipped import shipped_names
    from aquanav_tools.sim.vehicle import known_vehicles, load_vehicle

    rows = [("vehicle", f"{name:<18} {load_vehicle(name).summary()}") for name in known_vehicles()]
    rows += [("baseline", PREFIX + name) for name in baseline_names()]
    rows.append(("shield", f"{SHIELD}POLICY around any policy"))
    return rows + [(kind, name) for kind, folder in CONTENT.items() for name in shipped_names(folder)]


def _examine_libraries() -> None:
    from aquanav_tools.cli.doctor import TRIALS, examine

    ailing, reasons = [], []
    for library in TRIALS:
        finding = examine(library)
        word = {True: "OK", False: "FAILED", None: "absent"}[finding.is_well]
        print(f"{library:<18} {word:<6}  {finding.detail}", flush=True)
        if finding.is_well is False:
            ailing.append(library)
            reasons.append(finding.detail)
    if ailing:
        advice = NO_PLACE if all(map(CANNOT_WRITE.search, reasons)) else REINSTALL
        raise ResourceError(f"{len(ailing)} of {len(TRIALS)} libraries do not work here: {', '.join(ailing)}. {advice}")
