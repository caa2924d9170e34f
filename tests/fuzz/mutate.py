"""Damage to files, as disks, editors and ill-willed people do it. The same generator does the same damage."""

from __future__ import annotations

import hashlib
import io
import random
import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

Damage = Callable[[bytearray, random.Random], None]

TOKENS = (
    b"nan", b"-inf", b"-1", b"0", b"1e308", b"-1e-320", b"4294967295", b"-9223372036854775808", b"18446744073709551616",
    b"9" * 400, b"9" * 5000, b"1e999", b"true", b"null", b"'", b'"', b"[" * 300, b"{" * 300, b"[" * 20000, b"{}",
    b"[[]]", b"\x00", b"\xff\xfe", b"\xc3", b"\xed\xa0\x80", b"\xef\xbb\xbf", b"../../etc/passwd", b"/dev/zero",
    b"%s%n", b"\r", b"\n\n", b"\t", b"=", b",",
)  # fmt: skip
NUMBERS = (0, 1, 2, 3, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 40, (1 << 63) - 1, 1 << 63)
NUMERAL = re.compile(rb"[-+]?[0-9][0-9.eE+-]*")
HEAD = 400
"""Bytes at the beginning where half of all damage is done: headers."""


def flip_bits(content: bytearray, rng: random.Random) -> None:
    """Flip one bit, or a few near each other."""
    at = _place(content, rng)
    for n in range(at, min(at + rng.choice((1, 1, 3, 8)), len(content))):
        content[n] ^= 1 << rng.randrange(8)


def cut_off(content: bytearray, rng: random.Random) -> None:
    """Lose the end."""
    del content[_place(content, rng) :]


def cut_out(content: bytearray, rng: random.Random) -> None:
    """Lose something in the middle."""
    at = _place(content, rng)
    del content[at : at + rng.randrange(1, 200)]


def repeat(content: bytearray, rng: random.Random) -> None:
    """Repeat a part, sometimes very often."""
    at = _place(content, rng)
    content[at:at] = content[at : at + rng.randrange(1, 300)] * rng.choice((1, 1, 2, 50))


def swap(content: bytearray, rng: random.Random) -> None:
    """Let two parts change places."""
    first, second = sorted((_place(content, rng), _place(content, rng)))
    length = min(rng.randrange(1, 64), second - first)
    a, b = content[first : first + length], content[second : second + length]
    content[second : second + length], content[first : first + length] = a, b


def set_number(content: bytearray, rng: random.Random) -> None:
    """Write an extreme integer over 1, 2, 4 or 8 bytes, in either order."""
    size = rng.choice((1, 2, 4, 4, 8))
    at = _place(content, rng)
    value = rng.choice(NUMBERS) & ((1 << 8 * size) - 1)
    content[at : at + size] = value.to_bytes(size, rng.choice(("little", "big")))


def set_numeral(content: bytearray, rng: random.Random) -> None:
    """Write something else over a number in a text."""
    found = list(NUMERAL.finditer(content, 0, 30_000))
    if found:
        content[slice(*rng.choice(found).span())] = rng.choice(TOKENS)


def insert(content: bytearray, rng: random.Random) -> None:
    """Insert something that does not belong."""
    at = _place(content, rng)
    content[at:at] = rng.choice(TOKENS)


def scramble(content: bytearray, rng: random.Random) -> None:
    """Write noise over a part."""
    at, length = _place(content, rng), rng.randrange(1, 40)
    content[at : at + length] = rng.randbytes(length)


DAMAGES: tuple[Damage, ...] = (
    flip_bits, cut_off, cut_out, repeat, swap, set_number, set_number, set_numeral, set_numeral, insert, scramble,
)  # fmt: skip


def _place(content: bytearray, rng: random.Random) -> int:
    length = len(content) if rng.random() < 0.5 else min(len(content), HEAD)
    return rng.randrange(max(length, 1))


def damaged(content: bytes, rng: random.Random) -> bytes:
    """Return a content with some damage; of a zip, often to a member, under sums that are right again."""
    if content[:4] == b"PK\x03\x04" and rng.random() < 0.7:
        return _damaged_zip(content, rng)
    work = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        rng.choice(DAMAGES)(work, rng)
    return bytes(work)


def _damaged_zip(content: bytes, rng: random.Random) -> bytes:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {info: archive.read(info) for info in archive.infolist()}
    victim = rng.choice(list(members))
    members[victim] = damaged(members[victim], rng)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for info, member in members.items():
            archive.writestr(zipfile.ZipInfo(info.filename), member, info.compress_type)
    return stream.getvalue()


def write_case(seed: Path, number: int, folder: Path, salt: int = 0) -> Path:
    """Write the case of a number, a damaged copy of a seed, into a folder, and return its path."""
    rng = random.Random(f"{seed.name}:{number}:{salt}")
    target = folder / (seed.name if seed.is_dir() else f"input{seed.suffix}")
    if not seed.is_dir():
        target.write_bytes(damaged(seed.read_bytes(), rng))
        return target
    shutil.copytree(seed, target)
    victim = rng.choice(sorted(path for path in target.iterdir() if path.is_file()))
    victim.write_bytes(damaged(victim.read_bytes(), rng))
    settings = target / "scenario.toml"
    if settings.exists() and victim != settings and rng.random() < 0.8:
        _list_again(settings, victim)
    return target


def _list_again(settings: Path, victim: Path) -> None:
    """Write a damaged file's hash into its scenario's list, as whoever damaged it on purpose would."""
    new = hashlib.sha256(victim.read_bytes()).hexdigest()
    pattern = rf'(?m)^("{re.escape(victim.name)}" = ")[0-9a-f]+'
    settings.write_text(re.sub(pattern, rf"\g<1>{new}", settings.read_text()))
