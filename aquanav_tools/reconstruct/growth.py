"""How a model came about and in which order, kept beside each model: COLMAP's own files do not tell it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

_ORDER_FILE = "placed.txt"
_AT_ONCE_FILE = "at_once.txt"


def keep_order(models: Mapping[int, Any], folder: Path, start: Path | None) -> None:
    """Write the order of each model that a mapper returned and wrote.

    Args:
        models: pycolmap.Reconstruction by the number that its folder is called by.
        folder: Where those folders are.
        start: The model that the mapper went on from; its photos come first. A snapshot's are in the order of their
            ids, since nothing tells more.
    """
    earlier = read_order(start) if start is not None else []
    for number, model in models.items():
        if not (folder / str(number)).is_dir():
            continue  # a mapper that could add nothing to its start writes nothing
        names = {image_id: model.images[image_id].name for image_id in model.reg_image_ids()}
        later = [name for name in names.values() if name not in set(earlier)]
        kept = [name for name in earlier if name in set(names.values())]
        (folder / str(number) / _ORDER_FILE).write_text("".join(f"{name}\n" for name in (*kept, *later)))


def read_order(model: Path) -> list[str]:
    """Return the files of a model's photos in the order they were placed in; none where that was not kept."""
    path = model / _ORDER_FILE
    return path.read_text().split("\n")[:-1] if path.is_file() else []


def note_at_once(model: Path) -> None:
    """Write beside a model that its photos were placed all at once, in no order."""
    (model / _ORDER_FILE).unlink(missing_ok=True)
    (model / _AT_ONCE_FILE).touch()


def was_at_once(model: Path) -> bool:
    """Return whether that was noted."""
    return (model / _AT_ONCE_FILE).is_file()
