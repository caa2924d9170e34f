from __future__ import annotations

from pathlib import Path

import pytest
import torch

from aquanav_tools.errors import InputError
from aquanav_tools.train.checkpoint import CHECKPOINT_FILE, read_checkpoint


def test_damage_of_which_the_parser_says_nothing_is_told_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise EOFError  # as the unpickler does at some cuts

    (tmp_path / CHECKPOINT_FILE).write_bytes(b"PK")
    monkeypatch.setattr(torch, "load", fail)
    with pytest.raises(InputError, match=r"\(2 bytes\) cannot be read: EOFError"):
        read_checkpoint(tmp_path)
