"""Protocol Buffers' wire format, as far as event files and ONNX need it.

Source: protobuf.dev, Encoding.
"""

from __future__ import annotations

import struct


def varint(value: int) -> bytes:
    """Return an integer, not negative, seven bits to a byte."""
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def integer(field: int, value: int) -> bytes:
    """Return a field that holds an integer."""
    return varint(field << 3) + varint(value % (1 << 64))


def chunk(field: int, content: bytes | str) -> bytes:
    """Return a field that holds bytes, a text or a message."""
    data = content.encode() if isinstance(content, str) else content
    return varint(field << 3 | 2) + varint(len(data)) + data


def single(field: int, value: float) -> bytes:
    """Return a field that holds a number of 32 bits."""
    return varint(field << 3 | 5) + struct.pack("<f", value)


def double(field: int, value: float) -> bytes:
    """Return a field that holds a number of 64 bits."""
    return varint(field << 3 | 1) + struct.pack("<d", value)
