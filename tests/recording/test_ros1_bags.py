"""ROS 1 bags, and arrays of dvs_msgs in bags of either kind, give the same events."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from recording.bags import CAMERA, EVENT_ARRAY, EVENT_PACKET, Recipe, bag_messages, scan
from roller_bringup.cli import main
from roller_core.bags import typestore
from roller_core.codecs import PacketDecoder
from roller_recording.reading import RecordingError, open_recording
from roller_recording.reading.dvs_messages import DVS_ARRAY, DvsPackets

EVENTS = "/event_camera/events"
_EVENT = "uint16 x\nuint16 y\nbuiltin_interfaces/Time ts\nbool polarity\n"
_ARRAY = "std_msgs/Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n"


@pytest.fixture(scope="module")
def store() -> Typestore:
    store = typestore()
    types = get_types_from_msg(_EVENT, "dvs_msgs/msg/Event")
    store.register(types | get_types_from_msg(_ARRAY, DVS_ARRAY))
    return store


def array_of(store: Typestore, packet: Any) -> Any:
    """The events of a packet as dvs_msgs has them, in ROS time."""
    types = store.types
    events = PacketDecoder(packet.encoding, CAMERA.width, CAMERA.height).decode(
        packet.events, packet.time_base
    ).events  # fmt: skip
    stamp = packet.header.stamp.sec * 10**9 + packet.header.stamp.nanosec
    offset = stamp - int(events.t_ns[0])
    listed = [
        types["dvs_msgs/msg/Event"](
            int(x), int(y),
            types["builtin_interfaces/msg/Time"](*divmod(int(t) + offset, 10**9)), bool(p),
        )
        for x, y, t, p in zip(events.x, events.y, events.t_ns, events.p, strict=True)
    ]  # fmt: skip
    return types[DVS_ARRAY](packet.header, packet.height, packet.width, listed)


def dvs_messages(store: Typestore, packets: int) -> Iterator[tuple[int, str, str, bytes]]:
    """A bag's messages with the first packets as arrays of dvs_msgs."""
    for t_ns, topic, kind, data in bag_messages(Recipe("mono")):
        if topic != EVENTS:
            yield t_ns, topic, kind, data
        elif packets > 0:
            packets -= 1
            array = array_of(store, store.deserialize_cdr(data, kind))
            yield t_ns, topic, DVS_ARRAY, bytes(store.serialize_cdr(array, DVS_ARRAY))


def write_ros1(
    path: Path, store: Typestore, messages: Iterator[tuple[int, str, str, bytes]]
) -> Path:
    connections: dict[str, Any] = {}
    with Ros1Writer(path) as writer:
        for t_ns, topic, kind, data in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], t_ns, bytes(store.cdr_to_ros1(data, kind)))
    return path


def events_in(path: Path) -> np.ndarray:
    """x, y, polarity and ROS time of all events."""
    found = []
    for step in open_recording(path).steps():
        assert not step.faults
        e = step.events
        found.append(np.column_stack([e.x, e.y, e.p, e.t_ns]))
    return np.concatenate(found)


@pytest.mark.parametrize("kind", [EVENT_PACKET, EVENT_ARRAY])
def test_packets_in_a_ros1_bag(
    kind: str, store: Typestore, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = bag_messages(Recipe("evt3", event_type=kind))
    bag = write_ros1(tmp_path / "scan.bag", store, messages)
    assert len(events_in(bag)) == len(scan())
    assert main(["info", "--check", str(bag)]) == 0
    assert f"events     {len(scan())} (" in capsys.readouterr().out


def test_dvs_arrays_of_both_kinds_of_bags(store: Typestore, tmp_path: Path) -> None:
    first = write_ros1(tmp_path / "scan.bag", store, dvs_messages(store, 2))
    second = tmp_path / "scan"
    connections: dict[str, Any] = {}
    with Writer(second, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for t_ns, topic, kind, data in dvs_messages(store, 2):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], t_ns, data)
    found = events_in(first)
    expected = scan()[: len(found)]
    assert len(found) > 10_000
    np.testing.assert_array_equal(found[:, 0], expected.x)
    np.testing.assert_array_equal(found[:, 1], expected.y)
    np.testing.assert_array_equal(found[:, 2], expected.p)
    np.testing.assert_array_equal(np.diff(found[:, 3]), np.diff(expected.t_ns))
    np.testing.assert_array_equal(events_in(second), found)


@pytest.mark.parametrize("n", [0, 1, 2, 5])
@pytest.mark.parametrize("frame", ["", "dvs", "frame"])
def test_arrays_of_any_length_and_frame(n: int, frame: str, store: Typestore) -> None:
    types, rng = store.types, np.random.default_rng(n)
    rows = rng.integers(0, 300, (n, 3)).tolist()
    time = types["builtin_interfaces/msg/Time"]
    listed = [
        types["dvs_msgs/msg/Event"](x, y, time(7, 1000 * k), bool(p % 2))
        for k, (x, y, p) in enumerate(rows)
    ]
    header = types["std_msgs/msg/Header"](time(7, 0), frame)
    cdr = bytes(store.serialize_cdr(types[DVS_ARRAY](header, 480, 640, listed), DVS_ARRAY))
    packet: Any = store.deserialize_cdr(DvsPackets().from_cdr("e", cdr), EVENT_PACKET)
    ros1 = bytes(store.cdr_to_ros1(cdr, DVS_ARRAY))
    assert DvsPackets().from_ros1("e", ros1) == DvsPackets().from_cdr("e", cdr)
    assert (packet.width, packet.height, packet.header.frame_id) == (640, 480, frame)
    events = PacketDecoder("mono", 640, 480).decode(packet.events, packet.time_base).events
    assert events.x.tolist() == [x for x, _, _ in rows]
    assert events.y.tolist() == [y for _, y, _ in rows]
    assert events.p.tolist() == [p % 2 for _, _, p in rows]
    assert events.t_ns.tolist() == [7 * 10**9 + 1000 * k for k in range(n)]


def test_a_ros1_bag_that_was_cut_off(store: Typestore, tmp_path: Path) -> None:
    bag = write_ros1(tmp_path / "scan.bag", store, bag_messages(Recipe("evt3")))
    bag.write_bytes(bag.read_bytes()[:-2000])
    with pytest.raises(RecordingError, match=r"ROS 1 bag .*reindex"):
        open_recording(bag)
