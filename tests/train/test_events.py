from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
from tensorboardX.proto import event_pb2

from aquanav_tools.train.events import FILE, EventFile

Opened = Callable[[Path], EventFile]


@pytest.fixture
def opened() -> Iterator[Opened]:
    """Return what opens event files, which are closed at the end."""
    with ExitStack() as stack:
        yield lambda folder: stack.enter_context(closing(EventFile(folder)))


def test_each_number_is_in_the_file_as_soon_as_it_is_added(opened: Opened, tmp_path: Path) -> None:
    events = opened(tmp_path)
    for step in range(3):
        events.add(step, 0.5 * step, {"rollout/mean_reward": 1.5 * step})
    content, found = (tmp_path / FILE).read_bytes(), []
    while content:  # a record is its length, a checksum, as many bytes, and a checksum
        (length,) = struct.unpack("<Q", content[:8])
        assert struct.unpack("<I", content[8:12])[0] == masked_checksum(content[:8])
        assert struct.unpack("<I", content[12 + length : 16 + length])[0] == masked_checksum(content[12 : 12 + length])
        found.append(event_pb2.Event.FromString(content[12 : 12 + length]))
        content = content[16 + length :]
    assert found[0].file_version == "brain.Event:2"
    values = [
        (one.step, one.wall_time, one.summary.value[0].tag, one.summary.value[0].simple_value) for one in found[1:]
    ]
    assert values == [(step, 0.5 * step, "rollout/mean_reward", 1.5 * step) for step in range(3)]


def masked_checksum(data: bytes) -> int:
    """CRC-32C (Castagnoli), masked as TensorFlow's record_writer.h says."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    crc ^= 0xFFFFFFFF
    return ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF


def test_a_file_begun_again_holds_only_what_came_after(opened: Opened, tmp_path: Path) -> None:
    opened(tmp_path).add(1, 0.0, {"a": 1.0})
    opened(tmp_path)
    assert b"brain.Event:2" in (tmp_path / FILE).read_bytes()
    assert len((tmp_path / FILE).read_bytes()) < 50


def test_tensorboard_reads_the_numbers(opened: Opened, tmp_path: Path) -> None:
    loader = pytest.importorskip("tensorboard.backend.event_processing.event_file_loader")
    opened(tmp_path).add(1_000_000, 12.25, {"a/b": -0.75, "c": 3.0})
    events = list(loader.LegacyEventFileLoader(str(tmp_path / FILE)).Load())
    assert events[0].file_version == "brain.Event:2"
    assert (events[1].step, events[1].wall_time) == (1_000_000, 12.25)
    assert {value.tag: value.simple_value for value in events[1].summary.value} == {"a/b": -0.75, "c": 3.0}


def test_tensorboards_accumulator_reads_a_run(opened: Opened, tmp_path: Path) -> None:
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    events = opened(tmp_path)
    for step in range(1, 4):
        events.add(1000 * step, 2.0 * step, {"rollout/success_rate": 0.25 * step})
    found = accumulator.EventAccumulator(str(tmp_path)).Reload()
    assert found.Tags()["scalars"] == ["rollout/success_rate"]
    scalars = [(one.step, one.wall_time, one.value) for one in found.Scalars("rollout/success_rate")]
    assert scalars == [(1000, 2.0, 0.25), (2000, 4.0, 0.5), (3000, 6.0, 0.75)]
