"""Opening a Stable-Baselines3 zip without trusting it: bounded sizes, plain names, JSON only, nothing unpickled."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

from aquanav_tools.errors import InputError

TRAINED = "eval/policies", ".zip"
"""Where trained policies that ship lie in the content, and how their names end."""
SETTINGS = "data"
WEIGHTS = "policy.pth"
MAX_MEMBERS = 64
MAX_MEMBER_BYTES = 256 << 20
"""Far above a policy of three layers (a megabyte), far below what fills a machine's memory."""

AGAIN = "Save it again with model.save(), or copy it again."
UNREADABLE = (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, NotImplementedError)
"""What zipfile raises for damaged, encrypted or unsupported archives."""


def read_archive(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return the settings and the bytes of the weights in an SB3 zip.

    Raises:
        InputError: no such file, not a zip, damaged, too large, with odd names, or without one of the two members.
    """
    if not path.is_file():
        raise InputError(
            f"There is no policy at {path}. Name an SB3 zip, an ONNX file, module:function, or one of "
            "baseline:reference, baseline:reactive, baseline:random and baseline:oracle."
        )
    try:
        with zipfile.ZipFile(path) as archive:
            _check_members(archive, path)
            missing = {SETTINGS, WEIGHTS} - set(archive.namelist())
            if missing:
                raise InputError(
                    f"{path} has no member {' and '.join(sorted(missing))}, so it is no policy that "
                    f"Stable-Baselines3 saved. {AGAIN}"
                )
            settings, weights = archive.read(SETTINGS), archive.read(WEIGHTS)
    except UNREADABLE as cause:
        raise InputError(
            f"{path} ({path.stat().st_size} bytes) is not a readable zip: {cause}. It was cut off while being written "
            f"or copied, or is something else. {AGAIN}"
        ) from cause
    return _parse_settings(settings, path), weights


def read_weights(weights: bytes, path: Path) -> dict[str, Any]:
    """Return the named tensors in a member that torch.save wrote. Runs no code from it (`weights_only`).

    Raises:
        InputError: it is damaged, holds anything but finite tensors, or unpacks to more than MAX_MEMBER_BYTES.
    """
    import torch

    try:
        with zipfile.ZipFile(io.BytesIO(weights)) as archive:
            _check_sizes(archive, path)
        tensors = torch.load(io.BytesIO(weights), map_location="cpu", weights_only=True)
    except InputError:
        raise
    except Exception as cause:  # whatever damaged or hostile bytes make the parser raise
        reason = str(cause).strip().split("\n")[0]
        raise InputError(
            f"The weights in {path} are not plain tensors: {reason} They are damaged, or hold pickled objects, which "
            f"are never run. {AGAIN}"
        ) from cause
    is_plain = isinstance(tensors, dict) and all(isinstance(value, torch.Tensor) for value in tensors.values())
    if not is_plain:
        raise InputError(f"The weights in {path} are not a table of tensors. {AGAIN}")
    broken = [name for name, value in tensors.items() if not torch.isfinite(value).all()]
    if broken:
        raise InputError(
            f"The weights in {path} have values that are not finite in {', '.join(broken[:3])}. The training diverged. "
            "Train again with a smaller learning rate."
        )
    return dict(tensors)


def _check_members(archive: zipfile.ZipFile, path: Path) -> None:
    # policy.pth is a zip itself: cut off behind it, the file ends like a zip that begins somewhere in the middle.
    if min((member.header_offset for member in archive.infolist()), default=0) != 0:
        raise zipfile.BadZipFile("its first member does not begin at its first byte")
    odd = [name for name in archive.namelist() if "/" in name or "\\" in name or ".." in name]
    if odd:
        raise InputError(f"{path} has a member named '{odd[0]}'. Stable-Baselines3 writes no folders. Do not use it.")
    _check_sizes(archive, path)


def _check_sizes(archive: zipfile.ZipFile, path: Path) -> None:
    members = archive.infolist()
    size = sum(member.file_size for member in members)
    if len(members) > MAX_MEMBERS or size > MAX_MEMBER_BYTES:
        raise InputError(
            f"{path} unpacks to {len(members)} members and {size} bytes, more than {MAX_MEMBERS} and "
            f"{MAX_MEMBER_BYTES}. It is not a policy for this task, or made to fill the memory. Do not use it."
        )


def _parse_settings(text: bytes, path: Path) -> dict[str, Any]:
    try:
        settings = json.loads(text.decode("utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as cause:
        raise InputError(f"The settings in {path} are not JSON: {cause}. {AGAIN}") from cause
    if not isinstance(settings, dict):
        raise InputError(f"The settings in {path} are not a table. {AGAIN}")
    return settings
