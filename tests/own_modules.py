"""Modules as users write them, in the working directory."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

_numbers = itertools.count()
WriteModule = Callable[[str], str]


@pytest.fixture
def own_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[WriteModule]:
    """What writes a module of some text into the working directory and returns its name, which no other test uses."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    written = []

    def write(text: str) -> str:
        written.append(f"own_{next(_numbers)}")
        head = "import numpy as np\nfrom gymnasium.spaces import Box\n\n"
        (tmp_path / f"{written[-1]}.py").write_text(head + text)
        return written[-1]

    yield write
    for name in written:
        sys.modules.pop(name, None)
