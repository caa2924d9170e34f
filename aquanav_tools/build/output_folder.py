"""The output folder of a build: whether it may be written to, whether it holds the result already, and filling it.

build.json names what the result rests on (a hash) and lists all files with theirs. It is put into place first: from
then on the folder is known to be a build's, whenever the process ends. scenario.toml, which makes it a scenario, comes
last.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aquanav_tools.build.options import BuildOptions
from aquanav_tools.errors import InputError
from aquanav_tools.provenance import code_digest, digest, file_hash
from aquanav_tools.reconstruct.images import MASKS_DIR
from aquanav_tools.reconstruct.intake.decode import SUFFIXES
from aquanav_tools.scenario.shipped import SETTINGS_FILE
from aquanav_tools.sim.vehicle import vehicle_path
from aquanav_tools.store import LOCK_FILE

WORK_DIR = "work"
"""Where photo stages keep what a later run can take up; safe to delete."""
RECORD_FILE = "build.json"
BESIDE = ("cloud.ply", "cameras.json")
"""Written by the photo stages before the rest."""


@dataclass(frozen=True)
class Standing:
    """How a folder stands to a build that is asked for."""

    is_same: bool
    """It holds a scenario of the same inputs, options, code and libraries."""
    missing: tuple[str, ...] = ()
    """Files of that which are gone."""
    changed: tuple[str, ...] = ()
    """Files of that which were changed since."""

    @property
    def is_finished(self) -> bool:
        """Whether nothing is left to do."""
        return self.is_same and not self.missing and not self.changed


def build_key(options: BuildOptions) -> str:
    """Return a hash of all that the result of a build from photos or a video rests on.

    Raises:
        InputError: a file that the options name does not exist.
    """
    files = [path for path in (options.recipe, options.survey, *options.scale.files) if path is not None]
    for path in files:
        if not path.is_file():
            raise InputError(f"There is no file {path}. Check the path.")
    settings = dataclasses.replace(options, input=Path(), output=Path(), overwrite=False, name=options.title)
    files.append(vehicle_path(options.vehicle))
    content = [(str(path), file_hash(path)) for path in files]
    photos = [(name, file_hash(path)) for name, path in _input_files(options.input)]
    return digest(code_digest("aquanav_tools.build.recipe"), settings, content, photos)


def _input_files(source: Path) -> Iterator[tuple[str, Path]]:
    """Yield a video, or the photos and masks in a folder, by their names in it."""
    if source.is_file():
        yield source.name, source
        return
    for folder in (source, source / MASKS_DIR):
        for path in sorted(folder.iterdir()) if folder.is_dir() else ():
            if path.is_file() and path.suffix.lower() in SUFFIXES:
                yield path.relative_to(source).as_posix(), path


def standing(options: BuildOptions, key: str) -> Standing:
    """Return how the output folder stands to a build with a key from `build_key`."""
    record = _read_record(options.output)
    if record.get("key") != key or not (options.output / SETTINGS_FILE).is_file():
        return Standing(is_same=False)
    files: dict[str, str] = record["outputs"]
    missing = tuple(name for name in files if not (options.output / name).is_file())
    changed = tuple(
        name for name, expected in files.items() if name not in missing and file_hash(options.output / name) != expected
    )
    return Standing(True, missing, changed)


def is_finished(options: BuildOptions) -> bool:
    """Return whether the output folder already is the result of this build; of photos and videos alone."""
    if options.kind != "photos" or not (options.output / SETTINGS_FILE).is_file():
        return False
    return standing(options, build_key(options)).is_finished


def check_output(options: BuildOptions, key: str) -> None:
    """Check that a build may write to its output folder; files that are missing of the same result may be made again.

    Raises:
        InputError: it is a file, or holds another scenario or other things.
    """
    folder = options.output
    if folder.exists() and not folder.is_dir():
        raise InputError(f"The output {folder} is a file. Name a folder to write the scenario to.")
    if not folder.is_dir():
        return
    if (folder / SETTINGS_FILE).exists():
        found = standing(options, key) if key else Standing(is_same=False)
        if options.overwrite or (found.is_same and not found.changed):
            return
        changed = f", of which {', '.join(found.changed[:3])} changed since it was built" if found.changed else ""
        raise InputError(
            f"{folder} already holds a scenario{changed}. Name another folder with -o, or add --overwrite."
        )
    others = sorted(path.name for path in folder.iterdir())
    is_begun = others == [WORK_DIR] or (folder / WORK_DIR / LOCK_FILE).exists()
    is_ours = is_begun or "aquanav" in _read_record(folder)
    if others and not is_ours:
        raise InputError(
            f"The output folder {folder} holds other files ({', '.join(others[:3])}). Name a new or an empty folder."
        )


def publish(partial: Path, folder: Path, key: str) -> None:
    """Move a finished build into its folder; a run that is killed meanwhile leaves no scenario, and can be repeated."""
    folder.mkdir(parents=True, exist_ok=True)
    record = json.loads((partial / RECORD_FILE).read_text(encoding="utf-8"))
    made = [path for path in sorted(partial.rglob("*")) if path.is_file() and path.name != RECORD_FILE]
    beside = [folder / name for name in BESIDE if (folder / name).is_file()]
    files = {path.relative_to(partial).as_posix(): file_hash(path) for path in made}
    files |= {path.name: file_hash(path) for path in beside}
    text = json.dumps({**record, "key": key, "outputs": files}, indent=1, allow_nan=False)
    (partial / RECORD_FILE).write_text(text + "\n", encoding="utf-8")
    (folder / SETTINGS_FILE).unlink(missing_ok=True)
    last = (RECORD_FILE, SETTINGS_FILE)
    os.replace(partial / RECORD_FILE, folder / RECORD_FILE)
    for path in sorted(partial.iterdir(), key=lambda path: path.name in last):
        if path.is_dir():
            shutil.rmtree(folder / path.name, ignore_errors=True)
        os.replace(path, folder / path.name)
    partial.rmdir()


def _read_record(folder: Path) -> dict[str, Any]:
    """Return build.json of a folder; nothing where it is absent or not ours."""
    try:
        record = json.loads((folder / RECORD_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}
