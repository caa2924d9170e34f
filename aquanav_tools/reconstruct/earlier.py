"""What an earlier run found in photos that are the same in this one: of a set that grew, only the new are searched."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aquanav_tools.provenance import code_digest, digest
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.store import is_finished, write_whole

_MANIFEST = "photos.json"
"""In a stage's folder: a hash, for every file, of all that its keypoints rest on."""


@dataclass(frozen=True)
class Earlier:
    """COLMAP's database of an earlier run, and the files that are the same in this one."""

    database: Path | None = None
    files: frozenset[str] = frozenset()

    def keypoints(self, files: Iterable[str]) -> dict[str, tuple[Any, Any]]:
        """Return keypoints and descriptors of those files that are the same."""
        known = [file for file in files if file in self.files]
        if self.database is None or not known:
            return {}
        with load_pycolmap().Database.open(self.database) as store:
            ids = {file: store.read_image_with_name(file).image_id for file in known}
            return {file: (store.read_keypoints(ids[file]), store.read_descriptors(ids[file])) for file in known}


NOTHING_EARLIER = Earlier()


def find_earlier(folder: Path, database: str, content: Mapping[str, str], maker: Callable[..., object]) -> Earlier:
    """Return what the run before left of the same stage, and note what this one rests on.

    Args:
        folder: Of the stage now.
        database: Name of the database in it.
        content: For every file, a hash of its content and of the options that count for it alone.
        maker: The function whose code counts.
    """
    keys = {file: digest(one, code_digest(maker)) for file, one in content.items()}
    if is_finished(folder):
        return NOTHING_EARLIER
    write_whole(folder / _MANIFEST, json.dumps(keys, indent=1))
    stage = folder.name.rpartition("-")[0]
    others = [path for path in folder.parent.glob(f"{stage}-*") if path != folder and is_finished(path)]
    others = [path for path in others if (path / _MANIFEST).is_file()]
    if not others:
        return NOTHING_EARLIER
    newest = max(others, key=lambda path: path.stat().st_mtime_ns)
    before: dict[str, str] = json.loads((newest / _MANIFEST).read_text(encoding="utf-8"))
    return Earlier(newest / database, frozenset(file for file, key in keys.items() if before.get(file) == key))
