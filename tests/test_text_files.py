from __future__ import annotations

import re
from pathlib import Path

import pytest

from aquanav_tools.errors import InputError, ScenarioError
from aquanav_tools.tables import from_table, read_toml
from aquanav_tools.text_files import check_utf8, read_json, read_text
from aquanav_tools.types import Capsule
from tests.conftest import REPOSITORY

OWN_FILES = {
    "benchmark/submission.py", "build/built.py", "build/output_folder.py", "cave/scan/decoder_process.py",
    "evaluate/results.py", "outdated_code.py", "provenance.py", "reconstruct/earlier.py", "reconstruct/growth.py",
    "reconstruct/intake/memory.py", "reconstruct/intake/video.py", "reconstruct/matching.py", "report/html.py",
    "scenario/replacing.py", "store.py",
}  # fmt: skip
"""What reads texts that aquanav itself, or the system, has just written."""


def write(tmp_path: Path, content: bytes) -> Path:
    path = tmp_path / "a.txt"
    path.write_bytes(content)
    return path


def test_the_byte_that_is_not_utf8_is_named_with_its_line(tmp_path: Path) -> None:
    path = write(tmp_path, "é = 1\nb = ".encode() + b"\xe9\n")  # é takes two bytes in UTF-8, one in Latin-1
    words = r"a\.txt is not text in UTF-8: byte 11 \(line 2\) is 0xe9"
    with pytest.raises(InputError, match=words):
        read_text(path)
    with pytest.raises(InputError, match=words):
        check_utf8(path)
    with pytest.raises(ScenarioError, match=words):
        read_toml(path, ScenarioError)
    with pytest.raises(ScenarioError, match=words):
        read_json(path, ScenarioError)


def test_texts_in_utf8_come_back_and_a_mark_of_byte_order_can_be_left_out(tmp_path: Path) -> None:
    path = write(tmp_path, b"\xef\xbb\xbfname,x\n")
    check_utf8(path)
    assert read_text(path) == "\ufeffname,x\n"
    assert read_text(path, encoding="utf-8-sig") == "name,x\n"


def test_a_file_that_is_too_large_or_missing_is_refused_before_it_is_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has 2,000,000 bytes; such a file has at most 1,000,000"):
        read_text(write(tmp_path, bytes(2_000_000)), max_bytes=1_000_000)
    with pytest.raises(InputError, match=r"b\.txt cannot be read: No such file"):
        read_text(tmp_path / "b.txt")
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        read_text(tmp_path)


@pytest.mark.parametrize("content", [b"[" * 100_000, b"9" * 5000, b'{"a": 1', b"", b"\x00"])
def test_json_that_breaks_the_parser_in_whatever_way_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(InputError, match=r"a\.txt is not valid JSON"):
        read_json(write(tmp_path, content))


@pytest.mark.parametrize("content", [b"a = " + b"[" * 100_000, b"a = " + b"9" * 5000, b"a =", b"a = \x00"])
def test_toml_that_breaks_the_parser_in_whatever_way_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(InputError, match=r"a\.txt is not valid TOML"):
        read_toml(write(tmp_path, content))


def test_a_whole_number_too_large_for_a_float_is_refused() -> None:
    with pytest.raises(InputError, match="the table: radius has more than 308 digits"):
        from_table(Capsule, {"radius": 10**400, "axis_length": 1.0}, "the table")


def test_texts_of_others_are_read_in_one_place() -> None:
    root = REPOSITORY / "aquanav_tools"
    found = {
        path.relative_to(root).as_posix()
        for path in root.rglob("*.py")
        if re.search(r"\.read_text\(|json\.load\(|tomllib\.load\(|\.open\((\"r\"|newline|encoding)", path.read_text())
    }
    assert found - OWN_FILES == set(), "read_text and read_json of text_files say which byte of a file is no text"
