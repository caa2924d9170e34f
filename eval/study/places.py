"""Where a study learns and scores: scenarios that ship, and those that are built from the data folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eval.study.commands import aquanav

HAN = "han"
"""The scan of Han-sur-Lesse, as aquanav-build-cave closes it."""
ORIGINAL = ("cave-easy", "cave-easy-1", "cave-easy-2", "cave-easy-3", "cave-medium", "cave-eval1")
"""The original's caves, by the names that aquanav import-original gives them."""


def built_places(names: Sequence[str], data: Path, output: Path) -> dict[str, str]:
    """Return where scenarios lie, or their names where they ship; without its scan, Han-sur-Lesse is left out.

    Raises:
        SystemExit: the original's caves are asked for and not in the data folder.
    """
    found = {name: name for name in names if name != HAN and name not in ORIGINAL}
    if HAN in names:
        found |= _han(data / "scan_han_sur_lesse" / "cave.stl", output / HAN)
    originals = [name for name in ORIGINAL if name in names]
    return found | _original(originals, data / "saferlauv_unity", output / "original")


def _han(scan: Path, folder: Path) -> dict[str, str]:
    if not scan.is_file():
        print(f"There is no {scan}: Han-sur-Lesse is left out. Name its folder with --data.", flush=True)
        return {}
    if not (folder / "scenario.toml").is_file():
        aquanav("build_cave", str(scan), "-o", str(folder), "--overwrite")
    return {HAN: str(folder)}


def _original(names: list[str], project: Path, folder: Path) -> dict[str, str]:
    missing = [name for name in names if not (folder / name / "scenario.toml").is_file()]
    if missing and not project.is_dir():
        raise SystemExit(f"There is no {project}, to build the original's caves from. Name its folder with --data.")
    if missing:
        aquanav("info", "import-original", str(project), "-o", str(folder), "--cave", *missing, "--overwrite")
    return {name: str(folder / name) for name in names}
