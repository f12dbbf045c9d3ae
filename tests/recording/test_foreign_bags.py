"""Bags as other drivers and `ros2 bag` make them."""

import json
import re
import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode, Reader, StoragePlugin, Writer

from emvs.scenes import CAMERA
from recording.bags import (
    EVENT_ARRAY,
    EVENT_PACKET,
    Recipe,
    analytic_dataset,
    bag_messages,
    camera_track,
    events_in,
    read,
    scan,
    write_bag,
    write_messages,
    write_tum,
)
from roller_bringup.cli import main
from roller_core.camera import Camera, CameraError
from roller_core.events import EventArray
from roller_recording.reading import RecordingError, open_recording
from roller_recording.reading.bag_reader import BagReader

MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3
Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> EventArray:
    return read(write_bag(tmp_path_factory.mktemp("plain") / "bag"))


def assert_same(found: EventArray, expected: EventArray) -> None:
    assert len(found) == len(scan())
    for name in ("x", "y", "t_ns", "p"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.mark.parametrize(
    "recipe",
    [
        pytest.param(Recipe("mono"), id="mono"),
        pytest.param(Recipe("libcaer", SQLITE), id="libcaer_driver, libcaer"),
        pytest.param(Recipe("libcaer_cmp", MCAP), id="libcaer_driver, libcaer_cmp"),
        pytest.param(Recipe("evt3", SQLITE), id="metavision_driver"),
        pytest.param(Recipe("mono", MCAP, EVENT_ARRAY), id="old type, MCAP"),
        pytest.param(Recipe("evt3", SQLITE, EVENT_ARRAY), id="old type, SQLite"),
        pytest.param(Recipe(namespace="/camera_left"), id="another name"),
        pytest.param(Recipe(namespace=""), id="no namespace"),
        pytest.param(Recipe(compression=CompressionMode.STORAGE), id="zstd by chunk"),
        pytest.param(Recipe(compression=CompressionMode.MESSAGE), id="zstd by message"),
        pytest.param(Recipe(compression=CompressionMode.FILE), id="zstd by file"),
        pytest.param(
            Recipe(storage=SQLITE, compression=CompressionMode.MESSAGE), id="SQLite by message"
        ),
        pytest.param(Recipe(storage=SQLITE, compression=CompressionMode.FILE), id="SQLite by file"),
    ],
)
@pytest.mark.parametrize("metadata", [True, False])
def test_every_bag_gives_all_events(
    metadata: bool, recipe: Recipe, plain: EventArray, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / "bag", recipe)
    if not metadata:
        (bag / "metadata.yaml").unlink()
    assert_same(read(bag), plain)


@pytest.mark.parametrize("storage", [MCAP, SQLITE])
def test_metadata_without_a_storage_identifier(
    storage: StoragePlugin, plain: EventArray, tmp_path: Path
) -> None:
    metadata = write_bag(tmp_path / "bag", Recipe(storage=storage)) / "metadata.yaml"
    text, found = re.subn("storage_identifier: .*", "storage_identifier: ''", metadata.read_text())
    assert found == 1
    metadata.write_text(text)
    assert_same(read(metadata.parent), plain)


def test_old_bags_carry_their_definition_in_mcap_only(tmp_path: Path) -> None:
    """Both kinds must be readable, so both must be what the tests above read."""
    for storage, there in ((MCAP, True), (SQLITE, False)):
        bag = write_bag(tmp_path / storage.name, Recipe("mono", storage, EVENT_ARRAY))
        if storage == SQLITE:
            drop_definitions(next(bag.glob("*.db3")))
        with Reader(bag) as reader:
            (events,) = (c for c in reader.connections if c.msgtype == EVENT_ARRAY)
            assert bool(events.msgdef.data) == there
        assert events_in(bag) == len(scan())


def drop_definitions(file: Path) -> None:
    """As rosbag2 wrote SQLite bags up to Humble."""
    import sqlite3

    with sqlite3.connect(file) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("DROP TABLE schema")
        database.execute("DROP TABLE metadata")
        database.execute("ALTER TABLE topics DROP COLUMN type_description_hash")


@pytest.mark.parametrize("events_per_packet", ["few", "many"])
def test_packets_small_and_large(events_per_packet: str, tmp_path: Path, capsys: Capture) -> None:
    """Drivers send by time and by size; a packet may hold a millisecond or next to nothing."""
    many = events_per_packet == "many"

    def edit(topic: str, n: int, message: Any) -> Any:
        if topic != "/event_camera/events" or many:
            return message
        return replace(message, events=message.events[: 8 * (n % 3)])

    bag = write_bag(tmp_path / "bag", Recipe("mono", edit=edit))
    expected = len(scan()) if many else sum(n % 3 for n in range(80))
    assert events_in(bag) == expected
    assert main(["info", str(bag)]) == 0
    assert f"events     {expected} (" in capsys.readouterr().out


def messages_of_two_cameras() -> Iterable[tuple[int, str, str, bytes]]:
    left = list(bag_messages(Recipe(namespace="/left")))
    right = list(bag_messages(Recipe("mono", namespace="/right", tf=False, tf_static=False)))
    return sorted(left + right[:40], key=lambda item: item[0])


def test_several_cameras_need_a_choice(tmp_path: Path, capsys: Capture) -> None:
    bag = tmp_path / "bag"
    write_messages(Writer(bag, version=9, storage_plugin=MCAP), messages_of_two_cameras())
    with pytest.raises(RecordingError, match="on /left/events and /right/events; choose one with"):
        open_recording(bag)
    with pytest.raises(RecordingError, match="/middle/events is no topic of event packets; those"):
        open_recording(bag, topic="/middle/events")
    assert events_in(bag, topic="/left/events") == len(scan())
    words = ["replay", str(bag), "--output", str(tmp_path / "out"), "--no-picture"]
    assert main([*words, "--topic", "/right/events"]) == 0
    totals = json.loads((tmp_path / "out" / "report.json").read_text())["totals"]
    assert 0 < totals["events"] < len(scan())
    capsys.readouterr()
    assert main(["info", str(bag), "--topic", "/right/events"]) == 0
    assert f"events     {totals['events']} (" in capsys.readouterr().out


def test_our_own_topic_goes_before_others(tmp_path: Path) -> None:
    ours = list(bag_messages(Recipe()))
    other = list(bag_messages(Recipe("mono", namespace="/other", tf=False, tf_static=False)))
    bag = tmp_path / "bag"
    items = sorted(ours + other[:20], key=lambda item: item[0])
    write_messages(Writer(bag, version=9, storage_plugin=MCAP), items)
    assert events_in(bag) == len(scan())


def test_both_storages_without_metadata_are_ambiguous(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag")
    other = write_bag(tmp_path / "other", Recipe(storage=SQLITE))
    shutil.copyfile(other / "other.db3", bag / "bag.db3")
    assert events_in(bag) == len(scan())  # the metadata name one
    (bag / "metadata.yaml").unlink()
    with pytest.raises(RecordingError, match=r"both .mcap and .db3"):
        BagReader(bag)
    assert events_in(bag / "bag.db3") == len(scan())


def test_a_bag_without_calibration_or_poses_and_both_from_files(tmp_path: Path) -> None:
    """What metavision_driver alone records."""
    bag = write_bag(
        tmp_path / "bag", Recipe("evt3", namespace="/cam", camera=None, tf=False, tf_static=False)
    )
    CAMERA.to_yaml(tmp_path / "camera.yaml")
    write_tum(camera_track(), tmp_path / "poses.txt")
    given = {"poses": tmp_path / "poses.txt", "camera_file": tmp_path / "camera.yaml"}
    with pytest.raises(RecordingError, match=r"no poses .*; give --poses FILE"):
        open_recording(bag, camera_file=given["camera_file"])
    with pytest.raises(RecordingError, match=r"no /cam/camera_info .*; give --camera FILE"):
        open_recording(bag, poses=given["poses"])
    assert events_in(bag, **given) == len(scan())


def test_poses_of_another_clock_are_reported(tmp_path: Path, capsys: Capture) -> None:
    bag = write_bag(tmp_path / "bag")
    (tmp_path / "poses.txt").write_text(
        "".join(f"{k * 0.008} {k * 0.001} 0 0 0 0 0 1\n" for k in range(100))
    )
    words = ["replay", str(bag), "--output", str(tmp_path / "out"), "--no-picture"]
    assert main([*words, "--poses", str(tmp_path / "poses.txt")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "no event lies within the poses: events from 1700000000.0" in line


def test_big_endian_packets_are_refused(tmp_path: Path) -> None:
    def edit(topic: str, n: int, message: Any) -> Any:
        big = topic == "/event_camera/events" and n == 7
        return replace(message, is_bigendian=True) if big else message

    recording = open_recording(write_bag(tmp_path / "mono", Recipe("mono", edit=edit)))
    faults = [str(f) for step in recording.steps() for f in step.faults]
    (fault,) = faults
    assert fault.startswith(f"bag {tmp_path / 'mono'}: /event_camera/events at 1700000000.0")
    assert fault.endswith(" s: event packet 7 is big-endian; only little-endian ones are read")
    # A sensor's own words are little-endian on every host.
    assert events_in(write_bag(tmp_path / "evt3", Recipe("evt3", edit=edit))) == len(scan())


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("encoding", "foo", "event packets are encoded as 'foo'; known are mono"),
        ("width", 321, "px but the camera is calibrated for"),
    ],
)
def test_packets_that_cant_be_used_are_found(
    field: str, value: Any, said: str, tmp_path: Path, capsys: Capture
) -> None:
    """One wrong packet of many is found by topic and time."""

    def edit(topic: str, n: int, message: Any) -> Any:
        wrong = topic == "/event_camera/events" and n == 7
        return replace(message, **{field: value}) if wrong else message

    bag = write_bag(tmp_path / "bag", Recipe("mono", edit=edit))
    faults = [str(f) for step in open_recording(bag).steps() for f in step.faults]
    (fault,) = faults
    assert fault.startswith(f"bag {bag}: /event_camera/events at 1700000000.")
    assert said in fault
    if field == "encoding":
        assert main(["info", str(bag)]) == 1
        assert fault in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"k": np.zeros(9)}, "focal length 0, 0 px is not positive; is the camera calibrated?"),
        ({"k": np.full(9, np.nan)}, "the camera calibration holds a value that is not finite"),
        ({"distortion_model": "odd"}, "distortion model 'odd' isn't known"),
    ],
)
def test_a_bags_calibration_that_cant_be_used_is_found(
    change: dict[str, Any], said: str, tmp_path: Path
) -> None:
    def edit(topic: str, n: int, message: Any) -> Any:
        return replace(message, **change) if topic.endswith("/camera_info") else message

    bag = write_bag(tmp_path / "bag", Recipe("mono", edit=edit))
    with pytest.raises(CameraError) as caught:
        open_recording(bag)
    assert str(caught.value).startswith(f"bag {bag}: /event_camera/camera_info: {said}")
    assert "give --camera FILE" in str(caught.value)


@pytest.mark.parametrize("encoding", ["evt3", "libcaer_cmp"])
def test_info_says_what_of_packets_means_nothing(
    encoding: str, tmp_path: Path, capsys: Capture
) -> None:
    def edit(topic: str, n: int, message: Any) -> Any:
        if "events" in topic and n in (3, 5):
            message.events = np.append(message.events, np.array([0, 0, 0, 0xB0, 0, 0xC0], np.uint8))
        return message

    bag = write_bag(tmp_path / "bag", Recipe(encoding=encoding, edit=edit))
    assert main(["info", str(bag)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    expected = (
        "error: 4 words mean nothing in their encoding, the first on /event_camera/events at "
    )
    assert line.startswith(f"{expected}1700000000.00")
    assert f"({encoding})" in line


def test_info_says_where_packets_are_missing(tmp_path: Path, capsys: Capture) -> None:
    def edit(topic: str, n: int, message: Any) -> Any:
        return None if topic == "/event_camera/events" and n in (20, 21, 60) else message

    assert main(["info", str(write_bag(tmp_path / "bag", Recipe(edit=edit)))]) == 0
    out = capsys.readouterr().out
    assert "lost       3 packets in 2 gaps: 2 before 0.023 s, 1 before 0.062 s" in out


def test_the_type_of_packets_is_what_counts(tmp_path: Path) -> None:
    assert EVENT_PACKET != EVENT_ARRAY
    bag = write_bag(
        tmp_path / "bag", Recipe(edit=lambda t, n, m: m if t.startswith("/tf") else None)
    )
    with pytest.raises(RecordingError, match="no topic of type event_camera_msgs/msg/EventPacket"):
        open_recording(bag)


@pytest.mark.recordings
@pytest.mark.parametrize(
    ("name", "stamp_s", "events"),
    [("test_events_1", 1_675_956_550, 343_474), ("test_data_mono_cd", 1_639_872_000, 100)],
)
def test_real_bags_of_both_types(
    name: str, stamp_s: int, events: int, shared_data: Path, tmp_path: Path
) -> None:
    """Of metavision_driver (evt3), and of the older type (mono)."""
    Camera(640, 480, 500.0, 500.0, 320.0, 240.0).to_yaml(tmp_path / "camera.yaml")
    times = [stamp_s - 1 + k * 0.008 for k in range(700)]
    poses = "".join(f"{t:.3f} {t - stamp_s:.4f} 0 0 0 0 0 1\n" for t in times)
    (tmp_path / "poses.txt").write_text(poses)
    given = {"poses": tmp_path / "poses.txt", "camera_file": tmp_path / "camera.yaml"}
    assert events_in(shared_data / "ros_event_packets" / name, **given) == events


def test_info_counts_a_dataset_folder(tmp_path: Path, capsys: Capture) -> None:
    folder = analytic_dataset(tmp_path / "data", 1000)
    assert main(["info", str(folder)]) == 0
    assert "events     1000 (" in capsys.readouterr().out
    with (folder / "events.txt").open("a") as file:
        file.write("1 2 3\n")
    assert main(["info", str(folder)]) == 1
    assert "line 1001" in capsys.readouterr().err


def test_many_faults_of_a_kind_are_counted(tmp_path: Path, capsys: Capture) -> None:
    """An hour of a driver's packets that nobody can read is no million lines."""
    t_ns, topic, kind, data = next(m for m in bag_messages(Recipe("mono")) if "events" in m[1])
    broken = data.replace(b"mono", b"none")
    bag = tmp_path / "scan"
    writer = Writer(bag, version=9, storage_plugin=MCAP)
    write_messages(writer, ((t_ns + k, topic, kind, broken) for k in range(150)))
    assert main(["info", str(bag)]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 101
    assert lines[-1].startswith("error: 50 more of this kind")
