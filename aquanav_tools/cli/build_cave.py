"""The command aquanav-build-cave: photos, a scan or a survey in, scenario folder out."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from aquanav_tools.build.options import BuildOptions, PhotoScaleOptions, read_recipe
from aquanav_tools.cave.options import ClosingOptions, RouteOptions, ScanOptions
from aquanav_tools.cli.command import file_after, run_command, stage_bar
from aquanav_tools.reconstruct.intake.options import IntakeOptions

if TYPE_CHECKING:
    from aquanav_tools.build.built import BuiltScenario

DESCRIPTION = """Build a scenario from a real cave.

  aquanav-build-cave photos/ -o caves/mine --positions photos/positions.csv
  aquanav-build-cave dive.mp4 -o caves/mine --housing flat-port --passage-height 2.5
  aquanav-build-cave scan.stl -o caves/mine --unit cm --up y
  aquanav-build-cave scan-1.e57 scan-2.e57 -o caves/mine
  aquanav-build-cave survey.3d -o caves/mine

Photos are matched, placed and measured; scans of any mesh format or point cloud are read as they are; a survey becomes
a cave through its splays and passage dimensions. The result is a folder with a watertight cavity, portals, route,
panels, start poses and a report with drawings.

A build that was killed, or ran out of disk, goes on where it stopped when the same command is run again: from photos
within each stage, from scans and surveys after the last stage that keeps its result (the closed cavity, then all of the
cave). With a changed option, only what depends on it is made again. What that takes up lies in the folder "work" of the
output; it may be deleted.

With --overwrite, the scenario that is there stays as it is until the new one is complete. If the build fails, what is
known about it lies in the folder "failed" of the output."""


@dataclass(frozen=True)
class Options(BuildOptions):
    """The command line."""

    input: tyro.conf.Positional[Path]
    """Folder of photos, or a video (.mp4, .mov, .avi, .mkv); or a scan: a mesh (.ply, .obj, .stl, .off, .glb, .gltf,
    .dae, .3mf, .fbx, .usdz, .usd, .usda, .usdc) or a point cloud (.ply, .las, .laz, .e57, .ptx, .pts, .pcd, .xyz,
    .csv); or a survey: Survex (.svx, .3d) or Therion (.th)."""
    further: tyro.conf.Positional[tuple[Path, ...]] = ()
    """More scans of the same cave, in the same coordinates: scan-1.e57 scan-2.e57 and so on."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Scenario folder to write."""
    scan: tyro.conf.OmitArgPrefixes[ScanOptions] = field(default_factory=ScanOptions)
    scale: tyro.conf.OmitArgPrefixes[PhotoScaleOptions] = field(default_factory=PhotoScaleOptions)
    closing: tyro.conf.OmitArgPrefixes[ClosingOptions] = field(default_factory=ClosingOptions)
    route: tyro.conf.OmitArgPrefixes[RouteOptions] = field(default_factory=RouteOptions)
    intake: tyro.conf.OmitArgPrefixes[IntakeOptions] = field(default_factory=IntakeOptions)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    run_command(Options, _run, "aquanav-build-cave", DESCRIPTION, defaults=_read_defaults, arguments=arguments)


def _read_defaults(arguments: Sequence[str]) -> Options | None:
    """Return the options with the settings of the file after --recipe; None without one."""
    path = file_after("--recipe", arguments)
    if path is None:
        return None
    return Options(input=tyro.MISSING, output=tyro.MISSING, **vars(read_recipe(path)))


def _run(options: Options) -> None:
    from aquanav_tools.build.built import build_scenario

    began = time.perf_counter()
    plain = BuildOptions(**{field.name: getattr(options, field.name) for field in dataclasses.fields(BuildOptions)})
    built = build_scenario(plain, stage_bar, lambda sentence: print(sentence, file=sys.stderr))
    for code, sentence in built.warnings:
        print(f"warning ({code}): {sentence}", file=sys.stderr)
    if built.was_finished:
        deed = f"{plain.output} is already what these photos and options lead to; nothing was done"
    else:
        deed = f"Built {plain.output}"
    print(f"{deed} ({time.perf_counter() - began:.0f} s).\n{_summary(built)}")


def _summary(built: BuiltScenario) -> str:
    """Return the size of a built cave, and where to look."""
    folder, recording = built.folder, built.folder / "build.rrd"
    shown = f"Recording: rerun {recording}\n" if recording.exists() else ""
    routes = "".join(f"Another route: {place}\n" for place in built.routes)
    return (
        f"A passage of {built.route_length:.1f} m, {built.volume:.1f} m3, {built.num_triangles} triangles, watertight; "
        f"{built.num_portals} portal{'s' * (built.num_portals != 1)}, {built.num_panels} panels, "
        f"{built.num_starts} starts.\n{built.passability}\n"
        f"Report: {folder / 'report.html'}\nPicture: {folder / 'cave.png'}\n"
        f"{shown}{routes}Next: aquanav-eval baseline:reactive --scenario {folder}"
    )
