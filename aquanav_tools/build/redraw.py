"""The report and pictures of a scenario that was built, drawn anew from what the build keeps."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from aquanav_tools.build.options import BuildOptions
from aquanav_tools.build.output_folder import WORK_DIR
from aquanav_tools.build.recipe import BuildResult, build_cave
from aquanav_tools.errors import InputError
from aquanav_tools.provenance import file_hash
from aquanav_tools.scenario.replacing import finish_replacing, read_record
from aquanav_tools.tables import from_table
from aquanav_tools.types import Stages, silent


def redraw(folder: Path, display: Stages = silent, announce: Callable[[str], None] | None = None) -> BuildResult:
    """Build a scenario once more with the options that it was built with: its stages are taken from what they keep.

    Args:
        folder: Of the scenario, with its folder `work`.
        display: Shows the progress.
        announce: Tells what long work will take, where code or a library that a stage uses has changed since.

    Raises:
        InputError: it is no scenario that was built here, nothing was kept, or an input is gone or was changed.
    """
    if folder.is_dir():
        finish_replacing(folder)
    record = read_record(folder)
    if "options" not in record:
        raise InputError(f"There is no build.json in {folder} that tells how it was built. Name a scenario's folder.")
    if not any((folder / WORK_DIR).glob("cave-*/cave.npz")):
        raise InputError(
            f"Nothing is kept in {folder / WORK_DIR} from which the report could be drawn: it was deleted, or this "
            "is a cave that ships. Build the cave again, with --overwrite."
        )
    table = {**record["options"], "output": str(folder), "overwrite": True}
    options = from_table(BuildOptions, table, f"{folder}/build.json")
    for path in (options.input, *options.further):
        known = record.get("inputs", {}).get(path.name)
        if path.is_file() and known not in (None, file_hash(path)):
            raise InputError(
                f"{path} was changed since {folder} was built from it: what is kept is of another cave. Build it "
                "again, with --overwrite."
            )
    return build_cave(options, display, announce)
