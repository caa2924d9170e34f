"""Builds without the pictures, for tests of what else a build leaves: drawing takes a third of a small one's time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from PIL import Image


def leave_out_pictures(patch: pytest.MonkeyPatch) -> None:
    """Let every drawing be saved as an empty picture."""

    def save(figure: Any, path: Path, **options: Any) -> None:
        if path.suffix == ".svg":
            path.write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
        else:
            Image.new("RGB", (8, 8)).save(path)

    patch.setattr("matplotlib.figure.Figure.savefig", save)
    for module in ("picture", "views"):
        patch.setattr(f"aquanav_tools.report.{module}.DPI", 20)  # shots of the cave are taken in these pixels
