"""The scenario in a scan or a cloud, taken from an earlier run where nothing that it rests on has changed."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from aquanav_tools.build.cave_stages import BuiltCave, build_scenario
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions, PhotoScaleOptions
from aquanav_tools.cave.closing.free_space import NONE_KNOWN, FreeSpace
from aquanav_tools.cave.options import ScanOptions
from aquanav_tools.provenance import file_hash
from aquanav_tools.reconstruct.intake.options import IntakeOptions
from aquanav_tools.sim.vehicle import vehicle_path
from aquanav_tools.store import StageStore
from aquanav_tools.types import Array, Mesh, PointCloud
from aquanav_tools.values import kept_value


@dataclass(frozen=True, eq=False)
class _Kept:
    """What the stages of the cave return and tell."""

    built: BuiltCave
    notices: tuple[tuple[str, str], ...]


def kept_scenario(
    scan: Mesh | PointCloud,
    options: BuildOptions,
    journal: Journal,
    store: StageStore,
    free_space: FreeSpace = NONE_KNOWN,
    measured: Array | None = None,
) -> BuiltCave:
    """Return what `build_scenario` returns; a later call with the same scan and options takes it from the store."""
    settings = dataclasses.replace(
        options,
        input=Path(options.input.name),
        further=(),
        output=Path(),
        name=options.title,
        quality="standard",
        overwrite=False,
        recipe=None,
        survey=None,
        scan=ScanOptions(),
        scale=PhotoScaleOptions(),
        intake=IntakeOptions(),
        route=dataclasses.replace(options.route, routes="longest"),
    )
    vehicle = file_hash(vehicle_path(options.vehicle))

    def make() -> _Kept:
        told = len(journal.notices)
        built = build_scenario(scan, options, journal, free_space, measured, store)
        return _Kept(built, tuple(journal.notices[told:]))

    with store.open("cave", build_scenario, scan, options.kind, free_space, measured, settings, vehicle) as folder:
        is_made = not (folder / "cave.npz").is_file()
        kept = kept_value(_Kept, folder / "cave.npz", make)
    if not is_made:
        journal.notices += kept.notices
    return kept.built
