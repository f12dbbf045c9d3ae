"""`roller record` on a running graph: what was sent is in the bag, or counted as lost."""

import json
import re
import signal
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader, Writer

from graph.forked import ForkedProcess
from graph.graph_world import Processes
from recording.bags import EVENT_ARRAY, Recipe, bag_messages, write_messages
from roller_bringup.cli import main
from roller_core.codecs import RawPacket
from roller_recording.raw_message import RawMessage
from roller_recording.reading.bag_reader import BagReader
from waiting import wait_until

pytestmark = pytest.mark.graph

EVENTS = "/event_camera/events"
HOUR_NS = 3600 * 10**9


class Recording:
    """`roller record` in a process of its own."""

    def __init__(self, bag: Path, *options: str) -> None:
        self.bag, self._log = bag, bag.with_suffix(".log")
        words = ["record", "--output", str(bag), *options]
        self.process = ForkedProcess("roller_bringup.cli", words, self._log)

    def end(self, how: int = signal.SIGINT) -> tuple[int, str]:
        """Exit code and output, after a signal."""
        self.process.send_signal(how)
        return self.process.wait(timeout=60), self._log.read_text()


@pytest.fixture
def record(domain: int) -> Iterator[Callable[..., Recording]]:
    """Begin a recording; what still runs at the end is killed."""
    made: list[Recording] = []

    def begin(bag: Path, *options: str) -> Recording:
        made.append(Recording(bag, *options))
        return made[-1]

    yield begin
    for one in made:
        if one.process.poll() is None:
            one.process.kill()
            one.process.wait()


def source(tmp_path: Path, *options: str) -> ForkedProcess:
    words = ["--sent", str(tmp_path / "sent.json"), *options]
    return ForkedProcess("graph.event_source", words, tmp_path / "source.log")


def packets(bag: Path) -> dict[int, int]:
    """Checksum of the events by number of the packets in a bag, which lie in order."""
    found: dict[int, int] = {}
    last_ns = 0
    for item in BagReader(bag).messages({EVENTS}):
        if isinstance(item, RawMessage):
            assert item.t_ns >= last_ns
            last_ns = item.t_ns
            packet = RawPacket.parse(item.data)
            found[packet.seq] = zlib.crc32(packet.payload)
    assert list(found) == sorted(found)
    return found


def test_what_is_recorded_is_what_was_sent(
    record: Callable[..., Recording], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of two recorders one is ended in order, and one is killed on the way."""
    ended, killed = record(tmp_path / "ended"), record(tmp_path / "killed", "--raw")
    skipped = ("1200", "1201", "1900")
    sender = source(
        tmp_path, "--encoding", "libcaer_cmp", "--rate", "2", "--seconds", "3", "--skip", *skipped
    )
    file = killed.bag / "killed.mcap"
    wait_until(lambda: file.is_file() and file.stat().st_size >= 3_000_000)
    assert killed.end(signal.SIGKILL)[0] == -signal.SIGKILL
    assert sender.wait(timeout=90) == 0
    code, output = ended.end()
    sent = {int(k): v for k, v in json.loads((tmp_path / "sent.json").read_text()).items()}

    found = packets(ended.bag)
    assert len(found) > 500
    assert found.items() <= sent.items()  # nothing else, and unchanged
    # Every packet between the first and the last is there or counted, those skipped included.
    counted = {k: int(v) for k, v in BagReader(ended.bag).custom.items()}
    lost = sum(counted.values())
    assert len(found) + lost == max(found) - min(found) + 1
    assert lost >= len(skipped)
    assert code == 1
    assert re.search(r"error: lost: \d+ event packets in \d+ gaps never came", output), output
    assert "Traceback" not in output
    with Reader(ended.bag) as reader:  # rosbags finds it whole, with what the cell has
        counts = {c.topic: c.msgcount for c in reader.connections}
    assert counts["/tf_static"] == 1
    assert counts["/tf"] > 200
    assert counts["/event_camera/camera_info"] > 20  # although nobody latches it
    assert counts["/diagnostics"] > 1  # the recorder's own
    assert counts[EVENTS] == len(found)
    assert main(["info", "--check", str(ended.bag)]) == 0
    capsys.readouterr()

    found = packets(killed.bag)
    assert found.items() <= sent.items()
    assert len(found) > 100
    assert main(["info", str(killed.bag)]) == 1
    out, err = capsys.readouterr()
    assert f"packets    {len(found)}" in out
    assert err.count("error: ") == 1
    assert "cut off at byte" in err
    assert not (killed.bag / "metadata.yaml").exists()


def test_of_two_cameras_at_once_one_is_recorded(
    record: Callable[..., Recording], tmp_path: Path
) -> None:
    running = record(tmp_path / "bag", "--raw")
    file = running.bag / "bag.mcap"
    first = source(tmp_path, "--rate", "1", "--seconds", "100")
    try:
        wait_until(lambda: file.is_file() and file.stat().st_size >= 1_000_000)
        (tmp_path / "other").mkdir()
        other = source(tmp_path / "other", "--rate", "1", "--seconds", "1")
        assert other.wait(timeout=90) == 0
        code, output = running.end()
    finally:
        first.kill()
        first.wait()
    assert code == 1
    assert re.search(
        r"error: lost: another camera sent at the same time \(stop all but one\), not written: "
        rf"\d+ of {EVENTS} from",
        output,
    ), output
    assert len(packets(running.bag)) > 500  # which rise
    counted = BagReader(running.bag).custom
    assert int(counted["event_packets_of_other_cameras"]) > 500
    assert counted["event_packet_numbers_restarted"] == "0"


def test_a_bag_of_another_driver_played_and_recorded(
    record: Callable[..., Recording], processes: Processes, tmp_path: Path
) -> None:
    """An old type on a topic of another name comes out as the graph's own.

    Camera and mounting told of themselves an hour before the scan: nobody waits for that hour.
    """
    recipe = Recipe("evt3", event_type=EVENT_ARRAY, namespace="/left", force_n=25.0)
    early = {"/left/camera_info": HOUR_NS, "/tf_static": HOUR_NS}
    bag = tmp_path / "theirs"
    write_messages(
        Writer(bag, version=9, storage_plugin=recipe.storage),
        ((t_ns - early.get(topic, 0), topic, *rest) for t_ns, topic, *rest in bag_messages(recipe)),
    )
    running = record(tmp_path / "bag", "--raw")
    processes.start(
        "player", f"{{bag: {bag}, wait_s: 30.0, listeners: recorder, exit_when_done: true}}"
    )
    assert processes.running["player"].wait(timeout=90) == 0
    code, output = running.end()
    assert code == 0, output
    reader = BagReader(running.bag)
    played = [i for i in reader.messages(set(reader.topics)) if isinstance(i, RawMessage)]
    expected = [
        (topic.replace("/left", "/event_camera"), data)
        for _, topic, _, data in bag_messages(recipe)
    ]
    for name in (EVENTS, "/tf", "/event_camera/camera_info", "/roller/robot/wrench"):
        # DDS pads messages to a multiple of four bytes.
        mine = [i.data.rstrip(b"\0") for i in played if i.topic == name]
        assert mine == [data.rstrip(b"\0") for topic, data in expected if topic == name], name
    assert reader.topics[EVENTS] == "event_camera_msgs/msg/EventPacket"


def test_what_can_not_be_recorded_is_said(
    domain: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "bag"
    for options, message in (
        (("--output", "/proc/nowhere"), "/proc/nowhere: can't be written"),
        (("--output", "."), ".: is there already"),
        (("--topic", "two words"), "parameters of node 'recorder': 'events_topic'"),
        (("--queue-mb", "0"), "parameters of node 'recorder': 'queue_mb'"),
    ):
        assert main(["record", "--output", str(bag), *options]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"error: {message}")
        assert not bag.exists()
    with pytest.raises(SystemExit):
        main(["record", "--output", str(bag), "--duration", "1s"])
    assert "'1s' is not a number of seconds" in capsys.readouterr().err
    assert main(["record", "--output", str(bag), "--duration", "0.5"]) == 1
    err = capsys.readouterr().err
    assert "error: no event packet came on /event_camera/events (ROS domain" in err
    with Reader(bag) as reader:  # whole, if empty
        assert EVENTS not in [c.topic for c in reader.connections]
