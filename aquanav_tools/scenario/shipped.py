"""The scenarios that come with aquanav, by name: found in the cache folder, or built there when first asked for.

scenarios/*.toml say how each is built. Building belongs to the room above this one, so it is left to the command
`aquanav scenarios NAME` in a process of its own; a folder is called by a hash of all that its content rests on.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from aquanav_tools.errors import InputError, ScenarioError
from aquanav_tools.machine import CACHE_VARIABLE, cache_folder, num_cores
from aquanav_tools.provenance import code_digest, digest, file_hash
from aquanav_tools.shipped import shipped_names, shipped_path
from aquanav_tools.store import locked
from aquanav_tools.synthetic.styles.names import MAX_SEED, MIXED, STYLE_NAMES, style_of

CONTENT, BAYS = "scenarios", "scenarios/bays"
"""Folders of the caves, and of the bays for boats, which need no building."""
SETTINGS_FILE = "scenario.toml"
SLOT_PREFIX = "cave-real-"
"""Names of slots for a user's own caves."""
NUM_SLOTS = 3
WORK_SUFFIX = ".work"
"""Of the folder beside a scenario's that is locked while it is built."""
_WRITER = "aquanav_tools.scenario.folder:write_scenario"
BUILDER = (
    "aquanav_tools.build.shipped_scenarios:read_shipped",
    "aquanav_tools.build.shipped_scenarios:made_up",
    "aquanav_tools.build.cave_stages:scenario_in",
    _WRITER,
)
"""The code that the content of a scenario rests on; its report and pictures, for people, are no part of that."""
GENERATED = "generated"
"""First part of the names of caves that are drawn: generated/STYLE/SEED."""
GENERATOR = ("aquanav_tools.build.generated:generate", _WRITER)
"""The same for a drawn cave."""
DRAWN_LIMIT = 10_000_000_000
"""Bytes that drawn caves may take up in the cache: some thousands of them."""


def cache_dir() -> Path:
    """Return the folder for scenarios built from their names: AQUANAV_CACHE, or aquanav in the user's cache.

    Raises:
        InputError: there is neither.
    """
    folder = cache_folder()
    if folder is None:
        raise InputError(
            f"There is no folder to keep built caves in: this user has no home. Set {CACHE_VARIABLE} to a folder."
        )
    return folder


def slot_names() -> list[str]:
    """Return the names under which users may put caves of their own."""
    return [f"{SLOT_PREFIX}{n}" for n in range(1, NUM_SLOTS + 1)]


def scenario_names() -> list[str]:
    """Return all names that stand for scenarios."""
    return [*shipped_names(CONTENT), *slot_names()]


def generated_name(style: str, seed: int) -> str:
    """Return the name of the cave that is drawn in a style from a seed."""
    return f"{GENERATED}/{style}/{seed}"


def drawn_from(name: str) -> tuple[str, int] | None:
    """Return the style and the seed in a name generated/STYLE/SEED; None for a name that does not begin so.

    Raises:
        ScenarioError: there is no such style, or the seed is no whole number in range.
    """
    parts = name.split("/")
    if parts[0] != GENERATED or Path(name).exists():
        return None
    if len(parts) != 3 or not re.fullmatch(r"[0-9]{1,10}", parts[2]) or int(parts[2]) > MAX_SEED:
        raise ScenarioError(
            f"'{name}' is no drawn cave: write {GENERATED}/STYLE/SEED with a whole number from 0 to {MAX_SEED} as "
            f"SEED, such as {GENERATED}/{MIXED}/7. Styles: {', '.join([*STYLE_NAMES, MIXED])}. A style without a seed "
            "stands for all its caves, and only training on the batch and batches of environments take that."
        )
    try:
        style_of(parts[1], int(parts[2]))
    except InputError as error:
        raise ScenarioError(str(error)) from error
    return parts[1], int(parts[2])


def named_folder(name: str) -> Path:
    """Return where a shipped or drawn scenario, or one in a slot, lies or will lie."""
    if name in slot_names():
        return cache_dir() / name
    drawn = drawn_from(name)
    if drawn is not None:
        style, seed = style_of(*drawn), drawn[1]
        return cache_dir() / GENERATED / f"{style}-{seed}-{digest(style, seed, code_digest(*GENERATOR))}"
    key = digest(file_hash(shipped_path(CONTENT, name)), code_digest(*BUILDER))
    return cache_dir() / f"{name}-{key}"


def old_versions() -> list[Path]:
    """Return the folders of shipped scenarios, and of drawn ones, as other recipes or other code made them."""
    cache = cache_dir()
    if not cache.is_dir():
        return []
    kept = {named_folder(name).name for name in shipped_names(CONTENT)}
    names = "|".join(re.escape(name) for name in shipped_names(CONTENT))
    version = re.compile(rf"((?:{names})-[0-9a-f]{{16}})(?:{re.escape(WORK_SUFFIX)})?")
    found = {match[1] for path in cache.iterdir() if (match := version.fullmatch(path.name)) and path.is_dir()}
    drawn = [folder for folder in _drawn_folders() if folder != _drawn_folder_like(folder)]
    return [*(cache / name for name in sorted(found - kept)), *drawn]


def _drawn_folders() -> list[Path]:
    """Return where drawn caves lie, or were begun, in the order of their names."""
    base, version = cache_dir() / GENERATED, re.compile(rf"((?:{'|'.join(STYLE_NAMES)})-\d{{1,10}}-[0-9a-f]{{16}}).*")
    found = {match[1] for path in base.glob("*") if (match := version.fullmatch(path.name))}
    return [base / name for name in sorted(found)]


def _drawn_folder_like(folder: Path) -> Path:
    """Return where this code puts the cave whose folder is given."""
    style, seed, _ = folder.name.rsplit("-", 2)
    return named_folder(generated_name(style, int(seed)))


def mark_used(folder: Path) -> None:
    """Note that a drawn cave is used now: those that were not used for longest go first."""
    with contextlib.suppress(OSError):  # a cache that may only be read
        os.utime(folder)


def trim_drawn(kept: Path) -> None:
    """Remove drawn caves that were not used for longest until the others take up DRAWN_LIMIT bytes at most.

    Args:
        kept: One that stays.
    """
    sizes = {folder: _size_and_use(folder) for folder in _drawn_folders()}
    excess = sum(size for size, _ in sizes.values()) - DRAWN_LIMIT
    for folder in sorted(sizes, key=lambda folder: sizes[folder][1]):
        if excess <= 0:
            return
        if folder != kept and remove_version(folder):
            excess -= sizes[folder][0]


def _size_and_use(folder: Path) -> tuple[int, float]:
    """Return the bytes of a drawn cave, with what its building left, and when it was used last."""
    size, used = 0, 0.0
    for place in (folder, folder.with_name(folder.name + WORK_SUFFIX)):
        with contextlib.suppress(OSError):  # others may be removing it
            used = max(used, place.stat().st_mtime)
            size += sum(path.stat().st_size for path in place.rglob("*") if path.is_file())
    return size, used


def remove_version(folder: Path) -> bool:
    """Remove a scenario from the cache with what its building left; return False where it is being built."""
    work = folder.with_name(folder.name + WORK_SUFFIX)
    try:
        with locked(work):
            (folder / SETTINGS_FILE).unlink(missing_ok=True)  # first: half a scenario must not pass for a whole one
            shutil.rmtree(folder, ignore_errors=True)
    except InputError:
        return False
    shutil.rmtree(work, ignore_errors=True)
    return True


def scenario_folder(spec: str | Path) -> Path:
    """Return the folder of a scenario given by its path or its name, built first where that was not done yet.

    Raises:
        ScenarioError: the slot of that name is empty, or building failed.
    """
    name = str(spec)
    drawn = drawn_from(name)
    if drawn is None and (name not in scenario_names() or (Path(name) / SETTINGS_FILE).is_file()):
        return Path(spec)
    folder = named_folder(name)
    if (folder / SETTINGS_FILE).is_file():
        if drawn is not None:
            mark_used(folder)
        return folder
    if name in slot_names():
        raise ScenarioError(
            f"{name} is a slot for a cave of your own and is empty. Fill it: aquanav-build-cave SCAN -o {folder}"
        )
    if drawn is None:
        _build(name, folder, ["scenarios", name], "about a minute on a free core, and only once")
    else:
        half = " What lies there was left half built, and is replaced." if folder.is_dir() else ""
        words = ["generate", "--style", drawn[0], "--seed", str(drawn[1])]
        _build(name, folder, words, f"some seconds, and only once.{half}")
    return folder


def build_side_by_side(names: Iterable[object]) -> None:
    """Build those of some scenarios that are drawn caves, and are not built yet, on all cores.

    Raises:
        ScenarioError: one could not be built.
    """
    drawn = [name for name in names if isinstance(name, str) and drawn_from(name) is not None]
    missing = [name for name in drawn if not (named_folder(name) / SETTINGS_FILE).is_file()]
    with ThreadPoolExecutor(num_cores()) as threads:
        list(threads.map(scenario_folder, missing))


def _build(name: str, folder: Path, words: list[str], cost: str) -> None:
    """Build a scenario with a command of its own: building belongs to the room above this one.

    Raises:
        ScenarioError: it failed.
    """
    code = "from aquanav_tools.cli.info import main; main()"
    command = [sys.executable, "-c", code, *words]
    is_watched = sys.stderr.isatty()  # then the minute passes with progress bars
    if not is_watched:
        print(f"Building {name} in {folder}: {cost.rstrip('.')}.", file=sys.stderr)
    child = subprocess.run(
        command, stdout=subprocess.DEVNULL, stderr=None if is_watched else subprocess.PIPE, text=True
    )
    if child.returncode != 0 or not (folder / SETTINGS_FILE).is_file():
        told = "see above." if is_watched else child.stderr.strip()[-600:] or "no message."
        raise ScenarioError(
            f"The scenario {name} could not be built in {folder}: {told} Try it by itself: aquanav {' '.join(words)}"
        )
