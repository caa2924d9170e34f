"""The output folder of a build: whether it may be written to, whether it holds the result already, and filling it.

A build writes into a folder inside of it and takes the place of what was there at its very end; one that fails, or is
killed, leaves the scenario that was there as it was. build.json names what the result rests on (a hash) and lists all
files with theirs.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from aquanav_tools.build.options import BuildOptions
from aquanav_tools.errors import InputError
from aquanav_tools.provenance import code_digest, digest, file_hash
from aquanav_tools.reconstruct.images import MASKS_DIR
from aquanav_tools.reconstruct.intake.decode import SUFFIXES
from aquanav_tools.scenario.replacing import (
    FAILED_DIR,
    READY_DIR,
    RECORD_FILE,
    STAGED_DIR,
    finish_replacing,
    read_record,
    replace_content,
)
from aquanav_tools.scenario.shipped import SETTINGS_FILE
from aquanav_tools.sim.vehicle import vehicle_path
from aquanav_tools.store import LOCK_FILE, check_room, full_disk, locked

PHOTO_CODE = (
    "aquanav_tools.build.photo_intake:take_in",
    "aquanav_tools.reconstruct.reconstruction:reconstruct",
    "aquanav_tools.build.photo_stages",
    "aquanav_tools.build.photo_free_space:photo_free_space",
    "aquanav_tools.build.kept_cave:kept_scenario",
    "aquanav_tools.scenario.folder:write_scenario",
)
"""What a scenario from photos rests on; not its report and pictures, which are for people."""
WORK_DIR = "work"
"""Where stages keep what a later run can take up; safe to delete."""
ROUTES_DIR = "routes"
"""Where a scenario for each further pair of open ends lies."""


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
    return digest(code_digest(*PHOTO_CODE), settings, content, photos)


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
    record = read_record(options.output)
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
    if options.kind != "photos" or not options.output.is_dir():
        return False
    finish_replacing(options.output)
    if not (options.output / SETTINGS_FILE).is_file():
        return False
    return standing(options, build_key(options)).is_finished


def check_output(options: BuildOptions, key: str) -> None:
    """Check that a build may write to its output folder; files that are missing of the same result may be made again.

    Raises:
        InputError: it is a file, or holds another scenario or other things.
    """
    folder = options.output
    with _told_why(folder):
        if folder.exists() and not folder.is_dir():
            raise InputError(f"The output {folder} is a file. Name a folder to write the scenario to.")
        if not folder.is_dir():
            return
        names = sorted(path.name for path in folder.iterdir())
        has_scenario, is_begun = SETTINGS_FILE in names, (folder / WORK_DIR / LOCK_FILE).exists()
    if has_scenario:
        found = standing(options, key) if key else Standing(is_same=False)
        if options.overwrite or (found.is_same and not found.changed):
            return
        changed = f", of which {', '.join(found.changed[:3])} changed since it was built" if found.changed else ""
        raise InputError(
            f"{folder} already holds a scenario{changed}. Name another folder with -o, or add --overwrite."
        )
    others = [name for name in names if name not in (WORK_DIR, STAGED_DIR, READY_DIR)]
    if others and not is_begun and "aquanav" not in read_record(folder):
        raise InputError(
            f"The output folder {folder} holds other files ({', '.join(others[:3])}). Name a new or an empty folder."
        )


@contextlib.contextmanager
def held_output(folder: Path) -> Iterator[Path]:
    """Hold an output folder for one build, and yield the folder in it to write to; that is removed in the end.

    The output folder is made when absent, and removed again where the build left nothing in it.

    Raises:
        InputError: it cannot be made or written to, or another build holds it; the message says why.
        ResourceError: the disk is full.
    """
    made = [place for place in (folder, *folder.parents) if not os.path.lexists(place)]
    staged = folder / STAGED_DIR
    try:
        with contextlib.ExitStack() as held:
            with _told_why(folder):
                folder.mkdir(parents=True, exist_ok=True)
                with tempfile.TemporaryFile(dir=folder) as probe:
                    probe.write(b"room")
                held.enter_context(locked(folder / WORK_DIR))
                held.callback(_remove_unused, folder / WORK_DIR)
                finish_replacing(folder)
                check_room(folder)
                held.callback(shutil.rmtree, staged, ignore_errors=True)
                if staged.exists():  # of a build that was killed
                    shutil.rmtree(staged)
                staged.mkdir()
            yield staged
    finally:
        for place in made:
            with contextlib.suppress(OSError):  # it holds something
                place.rmdir()


def _remove_unused(work: Path) -> None:
    """Remove the folders of stages that kept nothing; then the work folder itself where only its lock is left."""
    for place in work.glob("*"):
        with contextlib.suppress(OSError):  # it is a file, or holds something
            place.rmdir()
    if [place.name for place in work.glob("*")] == [LOCK_FILE]:
        (work / LOCK_FILE).unlink()
        work.rmdir()


@contextlib.contextmanager
def _told_why(folder: Path) -> Iterator[None]:
    """Turn what the system says about a folder that cannot be used into a sentence."""
    try:
        yield
    except OSError as cause:
        if cause.errno in (errno.ENOSPC, errno.EDQUOT):
            raise full_disk(folder) from cause
        raise InputError(
            f"Nothing can be written to the output folder {folder}: {_reason(folder, cause)}. Name another with -o."
        ) from cause


def _reason(folder: Path, cause: OSError) -> str:
    """Return why a folder cannot be made or written to."""
    nearest = next(place for place in (folder, *folder.absolute().parents) if os.path.lexists(place))
    if nearest.is_symlink() and not nearest.exists():
        return f"{nearest} is a link to {nearest.readlink()}, which does not exist"
    if nearest.exists() and not nearest.is_dir():
        return f"{nearest} is a file"
    reasons = {
        errno.EACCES: f"you have no right to write in {nearest}",
        errno.EPERM: f"you have no right to write in {nearest}",
        errno.EROFS: f"the disk under {nearest} is read-only",
        errno.ENOENT: f"{nearest} is no place for files",
    }
    return reasons.get(cause.errno or 0, f"{cause.strerror or cause} ({nearest})")


def publish(staged: Path, folder: Path, key: str) -> None:
    """Put what a build wrote in the place of what an earlier one left; killed at any moment, one of the two is whole.

    Args:
        staged: from `held_output`; with build.json.
        folder: the output folder.
        key: from `build_key`, or empty.
    """
    record = json.loads((staged / RECORD_FILE).read_text(encoding="utf-8"))
    made = [path for path in sorted(staged.rglob("*")) if path.is_file() and path != staged / RECORD_FILE]
    files = {path.relative_to(staged).as_posix(): file_hash(path) for path in made}
    text = json.dumps({**record, "key": key, "outputs": files}, indent=1, allow_nan=False)
    (staged / RECORD_FILE).write_text(text + "\n", encoding="utf-8")
    replace_content(folder)


def publish_failure(staged: Path, folder: Path) -> Path:
    """Leave what is known of a failed build, beside the scenario that was there or in its place; return where it is."""
    if not (folder / SETTINGS_FILE).exists():
        publish(staged, folder, "")
        return folder
    shutil.rmtree(folder / FAILED_DIR, ignore_errors=True)
    os.replace(staged, folder / FAILED_DIR)
    return folder / FAILED_DIR
