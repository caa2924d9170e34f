"""Curves for TensorBoard, without its package: scalars in event files.

Source of the format: TensorFlow's record_writer.h (records with masked CRC-32C checksums) and event.proto.
"""

from __future__ import annotations

import struct
from pathlib import Path

from aquanav_tools.train.wire import chunk, double, integer, single

FILE = "events.out.tfevents.0.aquanav"
"""TensorBoard reads every file of such a name."""
_POLYNOMIAL = 0x82F63B78
"""CRC-32C (Castagnoli), bits reversed."""


class EventFile:
    """Appends scalars to an event file, which TensorBoard can follow while it grows."""

    def __init__(self, folder: Path) -> None:
        """Begin an empty file in a folder, made when absent."""
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / FILE
        self._path.write_bytes(_record(double(1, 0.0) + chunk(3, "brain.Event:2")))

    def add(self, step: int, seconds: float, scalars: dict[str, float]) -> None:
        """Append numbers, by their tags, for one step; `seconds` is the time that TensorBoard shows."""
        values = b"".join(chunk(1, chunk(1, tag) + single(2, value)) for tag, value in scalars.items())
        event = double(1, seconds) + integer(2, step) + chunk(5, values)
        with self._path.open("ab", buffering=0) as stream:
            stream.write(_record(event))


def _record(data: bytes) -> bytes:
    length = struct.pack("<Q", len(data))
    return length + struct.pack("<I", _masked(length)) + data + struct.pack("<I", _masked(data))


def _masked(data: bytes) -> int:
    crc = _crc32c(data)
    return ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF


def _crc32c(data: bytes) -> int:
    crc = 0xFFFFFFFF
    for byte in data:
        crc = _TABLE[(crc ^ byte) & 0xFF] ^ crc >> 8
    return crc ^ 0xFFFFFFFF


def _table() -> list[int]:
    rows = []
    for value in range(256):
        for _ in range(8):
            value = value >> 1 ^ (_POLYNOMIAL if value & 1 else 0)
        rows.append(value)
    return rows


_TABLE = _table()
