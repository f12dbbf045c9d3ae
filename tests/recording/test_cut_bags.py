"""Bags that were cut off or damaged: all that is whole comes back, and one line says what isn't."""

import random
import shutil
import sqlite3
import struct
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer
from rosbags.rosbag2 import StoragePlugin

from recording.bags import KINDS, Recipe, bag_messages, raw_messages, write_bag
from roller_bringup.cli import main
from roller_recording.raw_message import RawMessage
from roller_recording.reading.bag_reader import BagReader
from roller_recording.reading.base import RecordingError
from roller_recording.writing import BagWriter

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def messages() -> list[RawMessage]:
    return raw_messages(Recipe())


class Chunked:
    """A bag's bytes with a chunk for every four messages.

    Attributes
    ----------
    ends : list of int
        Where each chunk's index ends and the next chunk begins.
    whole_at : list of int
        Where each chunk itself ends.
    """

    def __init__(self, folder: Path, messages: list[RawMessage], compress: bool = False) -> None:
        writer = BagWriter(folder / "bag", KINDS, compress)
        self.ends: list[int] = []
        starts = [writer.bytes_written]
        for k, message in enumerate(messages):
            writer.write(message.topic, message.t_ns, message.data)
            if k % 4 == 3 or k == len(messages) - 1:
                writer.flush()
                self.ends.append(writer.bytes_written)
        writer.close({})
        self.data = (folder / "bag" / "bag.mcap").read_bytes()
        starts += self.ends[:-1]
        heads = [struct.unpack_from("<BQ", self.data, start) for start in starts]
        assert {opcode for opcode, _ in heads} == {6}
        self.whole_at = [s + 9 + length for s, (_, length) in zip(starts, heads, strict=True)]


@pytest.fixture(scope="module")
def chunked(messages: list[RawMessage], tmp_path_factory: pytest.TempPathFactory) -> Chunked:
    return Chunked(tmp_path_factory.mktemp("chunked"), messages)


def read(path: Path) -> tuple[list[bytes], list[str]]:
    """Data of all messages, and faults, in the order they come."""
    data, faults = [], []
    reader = BagReader(path)
    for item in reader.messages(set(reader.topics)):
        if isinstance(item, RawMessage):
            data.append(item.data)
        else:
            faults.append(str(item))
    return data, faults


@settings(
    max_examples=150,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(share=st.floats(0, 1, exclude_max=True), beside=st.integers(-10, 10))
def test_an_mcap_cut_at_any_byte(
    share: float, beside: int, chunked: Chunked, messages: list[RawMessage], tmp_path: Path
) -> None:
    cut = int(share * len(chunked.data))
    if cut % 2:  # where a chunk or its index ends, where it is delicate
        edges = chunked.ends + chunked.whole_at
        cut = min(edges, key=lambda edge: abs(edge - cut)) + beside
    path = tmp_path / "cut.mcap"
    path.write_bytes(chunked.data[:cut])
    chunks = sum(end <= cut for end in chunked.whole_at)
    if not chunks:
        with pytest.raises(RecordingError, match=r"cut off at byte|is no MCAP file|is empty"):
            read(path)
        return
    data, faults = read(path)
    assert data == [m.data for m in messages[: 4 * chunks]], "not what was before the cut"
    assert len(faults) == 1
    assert "cut off at byte" in faults[0]
    assert f"{len(data)} messages" in faults[0]


def test_what_info_says_of_a_cut(chunked: Chunked, tmp_path: Path, capsys: Capture) -> None:
    whole, ends = chunked.data, chunked.ends
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: ends[10] + 50])
    assert main(["info", str(path)]) == 1
    out, err = capsys.readouterr()
    assert "topic      /event_camera/events" in out
    assert err.strip() == (
        f"error: bag {path}: cut off at byte {ends[10]}, after 0.037 s; "
        "the 44 messages before are read"
    )
    path.write_bytes(whole[:-60])
    assert main(["info", str(path)]) == 1
    assert "in the index; all 95 messages are read" in capsys.readouterr().err


def test_zeros_that_a_power_cut_leaves(
    chunked: Chunked, messages: list[RawMessage], tmp_path: Path
) -> None:
    whole, ends = chunked.data, chunked.ends
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: ends[5]] + bytes(100_000))
    data, faults = read(path)
    assert data == [m.data for m in messages[:24]]
    assert f"cut off at byte {ends[5]}," in faults[0]


def test_a_broken_chunk_in_a_cut_file_costs_that_chunk(
    messages: list[RawMessage], tmp_path: Path
) -> None:
    bag = Chunked(tmp_path, messages[:40], compress=True)
    broken, end = bytearray(bag.data), bag.ends[4]
    # All but the head of the sixth chunk.
    broken[end + 60 : bag.whole_at[5]] = bytes(bag.whole_at[5] - end - 60)
    path = tmp_path / "broken.mcap"
    path.write_bytes(broken[:-30])
    data, faults = read(path)
    assert data == [m.data for m in messages[:20] + messages[24:40]]
    assert f"the record at byte {end} is broken" in faults[0]
    assert len(faults) == 2  # and the cut


@pytest.fixture(scope="module")
def sqlite_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(
        tmp_path_factory.mktemp("sqlite") / "bag", Recipe(storage=StoragePlugin.SQLITE3)
    )


@pytest.mark.parametrize("share", [0.15, 0.3, 0.5, 0.75, 0.9, 0.99])
def test_a_sqlite_file_cut_off(
    share: float, sqlite_bag: Path, messages: list[RawMessage], tmp_path: Path
) -> None:
    shutil.copytree(sqlite_bag, tmp_path / "bag")
    file = tmp_path / "bag" / "bag.db3"
    whole = file.read_bytes()
    file.write_bytes(whole[: int(len(whole) * share)])
    data, faults = read(tmp_path / "bag")
    assert data == [m.data for m in messages[: len(data)]]
    assert len(data) > (share - 0.1) * len(messages)
    assert len(faults) == 1
    assert "breaks off" in faults[0]
    assert f"the {len(data)} messages before are read" in faults[0]


@pytest.mark.parametrize("mode", ["WAL", "DELETE"])
def test_a_sqlite_file_that_was_not_closed(
    mode: str, sqlite_bag: Path, messages: list[RawMessage], tmp_path: Path
) -> None:
    """Rows in a write-ahead log count; a transaction that a journal would undo doesn't."""
    source = tmp_path / "source.db3"
    shutil.copyfile(sqlite_bag / "bag.db3", source)
    database = sqlite3.connect(source, isolation_level=None)
    database.execute(f"PRAGMA journal_mode={mode}")
    database.execute("PRAGMA cache_size=2")  # so that pages reach the file before the end
    database.execute("BEGIN")
    for k in range(300):
        row = (1, 2 * 10**18 + k, b"\x00\x01\x00\x00" + bytes(5000))
        database.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", row)
    if mode == "WAL":
        database.execute("COMMIT")
    left = tmp_path / "bag.db3"
    for file in tmp_path.glob("source.db3*"):  # as a process that is killed leaves them
        if not file.name.endswith("-shm"):
            shutil.copyfile(file, left.with_name(file.name.replace("source", "bag")))
    database.close()
    before = {f.name: f.read_bytes() for f in tmp_path.glob("bag.db3*")}
    assert len(before) == 2
    data, faults = read(left)
    assert data[: len(messages)] == [m.data for m in messages]
    assert len(data) - len(messages) == (300 if mode == "WAL" else 0)
    assert "was not closed" in faults[0]
    assert {f.name: f.read_bytes() for f in tmp_path.glob("bag.db3*")} == before  # untouched


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
@pytest.mark.parametrize("content", [b"", b"nothing of the kind", bytes(5000)])
def test_a_file_that_is_no_bag(
    suffix: str, content: bytes, tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / f"x{suffix}"
    path.write_bytes(content)
    assert main(["info", str(path)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"error: bag {path}: ")


def test_random_damage_never_ends_in_an_exception(chunked: Chunked, tmp_path: Path) -> None:
    rng = random.Random(5)
    path = tmp_path / "x.mcap"
    for _ in range(60):
        damaged = bytearray(chunked.data)
        for _ in range(rng.randrange(1, 5)):
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged[: rng.randrange(len(damaged) // 2, len(damaged))])
        with suppress(RecordingError):
            read(path)


def stale(text: str) -> str:
    return text.replace("message_count: 95", "message_count: 12")


def renamed(text: str) -> str:
    return text.replace("bag.mcap", "other.mcap")


@pytest.mark.parametrize(
    ("change", "note"),
    [
        (None, "there is no metadata.yaml; was the recording ended early?"),
        (stale, "metadata.yaml speaks of 12 messages; there are 95"),
        (renamed, "metadata.yaml names other files (other.mcap)"),
        (lambda text: text[:100], "metadata.yaml can't be read ("),
        (lambda text: "[", "metadata.yaml can't be read ("),
    ],
)
def test_metadata_that_are_missing_or_stale_cost_nothing(
    change, note: str, messages: list[RawMessage], tmp_path: Path, capsys: Capture
) -> None:
    bag = write_bag(tmp_path / "bag")
    metadata = bag / "metadata.yaml"
    if change is None:
        metadata.unlink()
    else:
        metadata.write_text(change(metadata.read_text()))
    assert main(["info", str(bag)]) == 0
    assert f"note       {note}" in capsys.readouterr().out
    data, faults = read(bag)
    assert sorted(data) == sorted(m.data for m in messages)
    assert faults == []


@pytest.mark.parametrize("compress", [False, True])
def test_a_damaged_chunk_is_named_and_what_is_behind_it_is_read(
    compress: bool, messages: list[RawMessage], tmp_path: Path, capsys: Capture
) -> None:
    bag = Chunked(tmp_path, messages, compress)
    file = tmp_path / "bag" / "bag.mcap"
    assert main(["info", "--check", str(file.parent)]) == 0
    assert "95 messages are read and decoded" in capsys.readouterr().out
    damaged = bytearray(bag.data)
    damaged[bag.ends[9] + 200] ^= 16  # in the middle of the eleventh chunk
    file.write_bytes(damaged)
    data, (fault,) = read(file.parent)
    assert data == [m.data for m in messages[:40] + messages[44:]]
    assert f"the chunk at byte {bag.ends[9]} is damaged" in fault
    assert "its messages from 0.034 to 0.037 s are lost" in fault
    for words in (["info"], ["info", "--check"], ["replay", "--output", str(tmp_path / "out")]):
        assert main([*words, str(file.parent)]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line == f"error: {fault}"


def test_check_holds_the_index_against_the_file(
    chunked: Chunked, tmp_path: Path, capsys: Capture
) -> None:
    bag = write_bag(tmp_path / "bag")  # by the library, which writes no checksums
    assert main(["info", "--check", str(bag)]) == 0
    out = capsys.readouterr().out
    assert "have no checksum; damage in them can go unseen" in out
    # A chunk that is missing in the index.
    path = tmp_path / "x.mcap"
    damaged = bytearray(chunked.data)
    (offset,) = struct.unpack_from("<Q", chunked.data, len(chunked.data) - 28)
    while damaged[offset] != 8:
        offset += 9 + struct.unpack_from("<Q", damaged, offset + 1)[0]
    damaged[offset] = 0x80  # an opcode that readers pass over
    path.write_bytes(damaged)
    assert main(["info", "--check", str(path)]) == 1
    assert "messages of /event_camera/events; there are" in capsys.readouterr().err


def test_a_bag_without_chunks_is_read_in_any_order(tmp_path: Path, capsys: Capture) -> None:
    """As rosbag2 writes it where speed counts the most."""
    path, channels, messages = (
        tmp_path / "scan.mcap",
        dict[str, int](),
        list(bag_messages(Recipe())),
    )
    middle = len(messages) // 2
    messages[middle], messages[middle + 1] = messages[middle + 1], messages[middle]
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start("ros2")
        for t_ns, topic, kind, data in messages:
            if topic not in channels:
                schema = writer.register_schema(kind, "ros2msg", b"")
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], t_ns, data, t_ns)
        writer.finish()
    reader = BagReader(path)
    found = [getattr(item, "data", item) for item in reader.messages(set(reader.topics))]
    assert found == [data for *_, data in messages]
    assert main(["info", "--check", str(path)]) == 0
    assert capsys.readouterr().err == ""
