"""The recorder without a graph: what it is given is in the bag, or counted as lost."""

import os
import re
import resource
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from recording.bags import DURATION_S, KINDS, Recipe, raw_messages, scan
from roller_bringup.cli import main
from roller_core import outputs
from roller_core.errors import UnwritableOutputError
from roller_recording.raw_message import RawMessage
from roller_recording.reading.bag_reader import BagReader
from roller_recording.writing import BagWriter, Recorder
from roller_recording.writing.queue import ByteQueue
from roller_ros import topics
from waiting import wait_until

EVENTS = "/event_camera/events"


def sent(encoding: str = "mono") -> list[RawMessage]:
    return raw_messages(Recipe(encoding))


def written(path: Path) -> list[RawMessage]:
    """What our reader finds; it must be whole."""
    reader = BagReader(path)
    found = []
    for item in reader.messages(set(reader.topics)):
        assert isinstance(item, RawMessage), item
        found.append(RawMessage(item.t_ns, item.topic, item.data))
    return found


def record(
    path: Path,
    messages: list[RawMessage],
    compress: bool = False,
    keep_free: int = 0,
    queue: int = 512_000_000,
) -> Recorder:
    recorder = Recorder(BagWriter(path, KINDS, compress, keep_free), [EVENTS], queue)
    for k in range(0, len(messages), 7):
        recorder.take(messages[k : k + 7])
    assert recorder.drain(30)
    recorder.stop()
    return recorder


@pytest.mark.parametrize("compress", [False, True])
def test_everything_is_in_the_bag(compress: bool, tmp_path: Path) -> None:
    messages = sent("libcaer_cmp")
    recorder = record(tmp_path / "bag", messages, compress)
    assert recorder.fault is None
    assert recorder.losses.total == 0
    assert recorder.losses.lines(0) == []
    progress = recorder.progress()
    assert progress.packets == 80
    assert progress.events == len(scan())
    with Reader(tmp_path / "bag") as reader:  # rosbags itself, with index and metadata
        found = [RawMessage(t, c.topic, d) for c, t, d in reader.messages()]
        offered = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
        assert reader.message_count == len(messages)
    assert sorted(found) == sorted(messages)
    assert offered[EVENTS].reliability.name == "BEST_EFFORT"
    assert offered[EVENTS].depth == 1000  # the graph's, not the recorder's
    assert offered["/tf_static"].durability.name == "TRANSIENT_LOCAL"
    assert progress.bytes_written == (tmp_path / "bag" / "bag.mcap").stat().st_size


def test_a_recording_replays_as_the_bag_it_came_from(tmp_path: Path) -> None:
    record(tmp_path / "bag", sent())
    words = ["replay", str(tmp_path / "bag"), "--output", str(tmp_path / "out"), "--no-picture"]
    assert main(words) == 0


class Slow(BagWriter):
    """A disk that takes nothing until it is let."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, KINDS)
        self.go = threading.Event()

    def write(self, topic: str, t_ns: int, data: bytes | memoryview) -> None:
        self.go.wait()
        super().write(topic, t_ns, data)


def test_what_the_queue_refuses_is_counted_and_the_rest_is_written(tmp_path: Path) -> None:
    messages = sent()
    size = sum(len(m.data) for m in messages)
    writer = Slow(tmp_path / "bag")
    recorder = Recorder(writer, [EVENTS], size // 3)
    recorder.take(messages)
    lost = recorder.losses.here
    assert 20 < lost < 80
    assert set(recorder.losses.dropped) == {EVENTS}  # poses and calibration had room
    writer.go.set()
    assert recorder.drain(30)
    recorder.stop()
    found = Counter(m.topic for m in written(tmp_path / "bag"))
    given = Counter(m.topic for m in messages)
    assert found[EVENTS] == given[EVENTS] - lost
    assert found["/tf"] == given["/tf"]
    (line,) = recorder.losses.lines(messages[0].t_ns)
    assert line.startswith(f"the queue was full (the disk is too slow), not written: {lost} of")
    # The bag itself tells, too.
    assert BagReader(tmp_path / "bag").custom["messages_dropped_by_recorder"] == str(lost)


def test_the_queue_is_bounded_in_bytes() -> None:
    queue = ByteQueue(1_000_000)
    large = [RawMessage(k, EVENTS, bytes(99_800)) for k in range(20)]
    assert len(queue.put(large)) == 10
    small = [RawMessage(k, "/tf", bytes(800)) for k in range(200)]
    assert len(queue.put(small)) == 100  # a tenth more for what is small
    assert queue.waiting_bytes == 1_100_000
    assert queue.get(0) == large[0]
    assert queue.put([large[0]]) == [large[0]]


def test_missing_numbers_are_no_drops(tmp_path: Path) -> None:
    messages = [m for k, m in enumerate(sent()) if k not in (30, 31, 50)]
    recorder = record(tmp_path / "bag", messages)
    given = Counter(m.topic for m in messages)
    assert recorder.losses.before.lost == 80 - given[EVENTS] > 0
    assert recorder.losses.here == 0
    (line,) = recorder.losses.lines(recorder.start_ns)
    assert "never came (driver or DDS): " in line


def test_numbers_that_begin_anew_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = sent()
    later = [replace(m, t_ns=m.t_ns + 10**10) for m in messages]
    recorder = record(tmp_path / "bag", [*messages, *later])
    assert recorder.progress().seq_restarts == 1
    assert recorder.losses.before.lost == 0
    assert main(["info", str(tmp_path / "bag")]) == 0
    out = capsys.readouterr().out
    assert "restarts   1 times the packets' numbers fell" in out
    once = DURATION_S - 0.001  # of the last packet's events, about
    found = re.search(r"duration   ([0-9.]+) s, the sensor's time began 1 times anew", out)
    assert found, out
    assert float(found[1]) == pytest.approx(2 * once, abs=0.002)


def test_what_waits_at_a_hurried_end_is_counted(tmp_path: Path) -> None:
    messages = sent()
    writer = Slow(tmp_path / "bag")
    recorder = Recorder(writer, [EVENTS])
    recorder.take(messages)
    assert not recorder.drain(0.1)
    threading.Timer(0.3, writer.go.set).start()
    recorder.stop()
    found = written(tmp_path / "bag")
    assert len(found) < len(messages)
    assert recorder.losses.here == len(messages) - len(found)


@contextmanager
def file_size_limit(size: int) -> Iterator[None]:
    """No file may grow beyond some bytes: a full disk, as far as a writer can tell."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def flushed_often(monkeypatch: pytest.MonkeyPatch, every: int = 5) -> None:
    """Close a chunk after a few messages."""
    write = BagWriter.write
    count = [0]

    def write_and_flush(self: BagWriter, topic: str, t_ns: int, data: bytes) -> None:
        write(self, topic, t_ns, data)
        count[0] += 1
        if count[0] % every == 0:
            self.flush()

    monkeypatch.setattr(BagWriter, "write", write_and_flush)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.95])
def test_a_disk_that_gets_full(
    share: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flushed_often(monkeypatch)
    messages = sent()
    size = record(tmp_path / "whole", messages).progress().bytes_written
    with file_size_limit(int(size * share)):
        recorder = record(tmp_path / "bag", messages)
    assert isinstance(recorder.fault, UnwritableOutputError)
    assert "the bag can't be written (File too large)" in str(recorder.fault)
    reader = BagReader(tmp_path / "bag")
    found = [m for m in reader.messages(set(reader.topics)) if isinstance(m, RawMessage)]
    assert [m.data for m in found] == [m.data for m in messages[: len(found)]]
    assert len(found) + recorder.losses.here == len(messages)
    if share > 0.1:
        assert len(found) > 5
    assert recorder.progress().packets == sum(m.topic == EVENTS for m in found)


def test_an_index_that_has_no_room(tmp_path: Path) -> None:
    messages = sent()
    writer = BagWriter(tmp_path / "bag", KINDS)
    for message in messages:
        writer.write(message.topic, message.t_ns, message.data)
    writer.flush()
    with (
        file_size_limit(writer.bytes_written + 100),
        pytest.raises(UnwritableOutputError, match="the index can't be written"),
    ):
        writer.close({})
    assert not list(tmp_path.rglob("*.tmp"))
    reader = BagReader(tmp_path / "bag")
    assert reader.counts.total() == len(messages)
    assert "cut off at byte" in str(reader.faults[0])


def test_a_disk_without_room_to_spare(tmp_path: Path) -> None:
    disk = os.statvfs(tmp_path)
    free = disk.f_bavail * disk.f_frsize
    with pytest.raises(UnwritableOutputError, match=r"nearly full: \d+ MB are free"):
        BagWriter(tmp_path / "bag", KINDS, keep_free_bytes=2 * free)
    assert not (tmp_path / "bag").exists()


def test_a_disk_that_fills_up_ends_the_recording_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages = sent()
    recorder = Recorder(BagWriter(tmp_path / "bag", KINDS), [EVENTS])
    recorder.take(messages[:50])
    while recorder.progress().waiting_messages:
        pass
    monkeypatch.setattr(recorder._writer, "_keep_free", 10**18)
    wait_until(lambda: recorder.fault is not None)
    recorder.take(messages[50:])
    recorder.stop()
    assert recorder.losses.here == len(messages) - 50
    assert written(tmp_path / "bag") == messages[:50]


def test_a_process_that_is_killed_leaves_all_but_the_last_chunk(tmp_path: Path) -> None:
    """What is in the file while it is written is what a kill leaves."""
    messages = sent()
    recorder = Recorder(BagWriter(tmp_path / "bag", KINDS), [EVENTS])
    recorder.take(messages)
    wait_until(lambda: sum(recorder._writer.counts.values()) == len(messages))
    wait_until(lambda: not recorder._writer.pending)  # after half a second without more
    left = BagReader(tmp_path / "bag")
    assert not (tmp_path / "bag" / "metadata.yaml").exists()
    found = [m for m in left.messages(set(left.topics)) if isinstance(m, RawMessage)]
    assert [m.data for m in found] == [m.data for m in messages]
    assert "cut off at byte" in str(left.faults[0])
    recorder.stop()
    assert written(tmp_path / "bag") == messages


def test_a_chunk_is_pending_until_the_file_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who sees that nothing is pending may read: the disk's time is part of it."""
    writer, seen = BagWriter(tmp_path / "bag", KINDS), []
    message = sent()[0]
    writer.write(message.topic, message.t_ns, message.data)
    take = os.writev

    def slow_disk(fd: int, parts: list[memoryview]) -> int:
        seen.append(writer.pending)
        return take(fd, parts)

    monkeypatch.setattr(os, "writev", slow_disk)
    writer.flush()
    assert seen == [True]
    assert not writer.pending
    writer.close({})


def test_output_that_is_there_or_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "bag" / "mine").mkdir(parents=True)
    with pytest.raises(UnwritableOutputError, match="is there already"):
        BagWriter(tmp_path / "bag", KINDS)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UnwritableOutputError, match="can't be written"):
        BagWriter(tmp_path / "file" / "bag", KINDS)


def test_which_topics_are_recorded() -> None:
    everything = {t.name for t in topics.recorded()}
    assert everything == {t.name for t in topics.ALL} - {outputs.SURFACE_MAP}
    raw = {t.name for t in topics.recorded(raw=True, events_topic="/left/events")}
    own = {"/left/events", "/left/camera_info", "/tf", "/tf_static"}
    assert raw == own | {outputs.WRENCH}  # what inspection holds a part to


def test_a_cell_in_a_namespace_is_recorded_whole() -> None:
    shared = {t.name for t in topics.ALL if t.name.startswith("/")}
    cell = {f"/left/{t.name}" for t in topics.ALL if not t.name.startswith("/")}
    asked = topics.recorded(events_topic="/left/event_camera/events")
    assert {t.name for t in asked} == (cell | shared) - {f"/left/{outputs.SURFACE_MAP}"}
    # Elsewhere only the camera's are known to lie beside it.
    others = {t.name for t in topics.recorded(events_topic="/left/dvs/events")}
    assert {"/left/dvs/camera_info", outputs.DEPTH_IMAGE, "/tf"} <= others
