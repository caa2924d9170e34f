from __future__ import annotations

import struct
from pathlib import Path

import pytest

from aquanav_tools.train.events import FILE, EventFile, _crc32c, _masked


def test_checksum_is_castagnolis() -> None:
    # RFC 3720, appendix B.4, and the usual check value of "123456789".
    assert _crc32c(b"123456789") == 0xE3069283
    assert _crc32c(bytes(32)) == 0x8A9136AA
    assert _crc32c(b"\xff" * 32) == 0x62A8AB43


def test_every_record_is_framed_by_its_length_and_checksums(tmp_path: Path) -> None:
    events = EventFile(tmp_path)
    for step in range(3):
        events.add(step, 0.5 * step, {"rollout/mean_reward": 1.5})
    content, records = (tmp_path / FILE).read_bytes(), 0
    while content:
        (length,) = struct.unpack("<Q", content[:8])
        data = content[12 : 12 + length]
        assert struct.unpack("<I", content[8:12])[0] == _masked(content[:8])
        assert struct.unpack("<I", content[12 + length : 16 + length])[0] == _masked(data)
        content, records = content[16 + length :], records + 1
    assert records == 4


def test_tensorboard_reads_the_numbers(tmp_path: Path) -> None:
    loader = pytest.importorskip("tensorboard.backend.event_processing.event_file_loader")
    EventFile(tmp_path).add(1_000_000, 12.25, {"a/b": -0.75, "c": 3.0})
    events = list(loader.LegacyEventFileLoader(str(tmp_path / FILE)).Load())
    assert events[0].file_version == "brain.Event:2"
    assert (events[1].step, events[1].wall_time) == (1_000_000, 12.25)
    assert {value.tag: value.simple_value for value in events[1].summary.value} == {"a/b": -0.75, "c": 3.0}


def test_tensorboards_accumulator_reads_a_run(tmp_path: Path) -> None:
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    events = EventFile(tmp_path)
    for step in range(1, 4):
        events.add(1000 * step, 2.0 * step, {"rollout/success_rate": 0.25 * step})
    found = accumulator.EventAccumulator(str(tmp_path)).Reload()
    assert found.Tags()["scalars"] == ["rollout/success_rate"]
    scalars = [(one.step, one.wall_time, one.value) for one in found.Scalars("rollout/success_rate")]
    assert scalars == [(1000, 2.0, 0.25), (2000, 4.0, 0.5), (3000, 6.0, 0.75)]
