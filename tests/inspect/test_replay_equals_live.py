"""One recording through the stages as live nodes feed them, and through the replay: the same.

No DDS: messages go through the functions that a node calls (`feed`, `to_message`), serialised and
back. `tests/graph` plays one through real nodes.
"""

from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

import roller_braille.messages  # noqa: F401 (registers the messages of cells)
import roller_inspect.messages  # noqa: F401 (and of findings)
from recording.bags import Recipe
from recording.bags import write_bag as write_analytic_bag
from roller_braille.braille_stage import BrailleStage
from roller_bringup.cli import main
from roller_core import outputs
from roller_core.bags import typestore
from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.events import EventArray
from roller_core.outputs import Result
from roller_core.parameter_files import read_parameters
from roller_emvs.depth_stage import DepthStage
from roller_emvs.stitcher_stage import StitcherStage
from roller_emvs.surface_stage import SurfaceStage
from roller_inspect.inspect_stage import InspectStage
from roller_inspect.pipeline import Pipeline, PipelineSettings
from roller_ros.feeding import NEW_SOURCE, feed
from roller_ros.messages import to_message
from roller_ros.topics import BY_NAME
from simulated_scans import Scans

PREFIX = "left_"
PARAMS = f"""
/**:
  ros__parameters: {{base_frame: {PREFIX}base, moving_frame: {PREFIX}tool0_controller}}
emvs:
  ros__parameters: {{paper: {{planes: 60, median_px: 9}}, window: {{travel_m: 0.006}}, method: %s}}
"""
#: Messages between two looks for results; results must not depend on it.
LOOKS = 7
STORE = typestore()


@pytest.fixture(scope="module")
def bag(scans: Scans, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scan over four letters of Braille, recorded with `tf_prefix`."""
    source = scans.bag(
        "braille",
        scene={"text": "dfhj", "margin_mm": 3.0, "step_mm": 0.03},
        camera={"width": 280, "height": 166, "focal_px": 711.0},
    )
    path = tmp_path_factory.mktemp("prefixed") / "scan"
    connections: dict[str, Any] = {}
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    with Reader(source) as reader, writer:
        for connection, t_ns, data in reader.messages():
            topic, kind = connection.topic, connection.msgtype
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            if topic in (outputs.TF, outputs.TF_STATIC):
                message: Any = STORE.deserialize_cdr(data, kind)
                for item in message.transforms:
                    item.header.frame_id = prefixed(item.header.frame_id)
                    item.child_frame_id = prefixed(item.child_frame_id)
                data = bytes(STORE.serialize_cdr(message, kind))
            writer.write(connections[topic], t_ns, bytes(data))
    return path


def prefixed(frame: str) -> str:
    return PREFIX + frame if frame in ("base", "tool0_controller") else frame


class Live:
    """Stages as nodes drive them; what they publish, and what they complain of."""

    def __init__(self, params: Path, *kinds: Any) -> None:
        self.stages = [
            kind(kind.model.create(read_parameters(params, kind.node))) for kind in kinds
        ]
        self.published: dict[str, list[bytes]] = defaultdict(list)
        self.faults: list[RollerError] = []

    def play(self, bag: Path) -> None:
        """Feed a bag message by message, then flush as an idle node does."""
        with Reader(bag) as reader:
            for n, (connection, _, data) in enumerate(reader.messages()):
                name = connection.topic
                name = name if name in BY_NAME else name.lstrip("/")
                message = deserialize_message(bytes(data), BY_NAME[name].type)
                for stage in self.stages:
                    if name in stage.inputs:
                        feed(stage, name, message, self.faults.append)
                    if n % LOOKS == 0:
                        self.publish(stage)
        for stage in self.stages:
            self.publish(stage, flush=True)

    def publish(self, stage: Any, flush: bool = False) -> None:
        for result in stage.results(flush):
            if result.fault is not None:
                self.faults.append(result.fault)
            for output in result.outputs:
                topic = BY_NAME[output.topic]
                data = serialize_message(to_message(output))
                self.published[topic.path].append(canonical(data, topic.type_name))
                for other in self.stages:
                    if output.topic in other.inputs:
                        message = deserialize_message(data, topic.type)
                        feed(other, output.topic, message, self.faults.append)
                        self.publish(other)


def canonical(data: Any, kind: str) -> bytes:
    """A message's bytes without what serialisers leave in between fields, and without times."""
    message: Any = STORE.deserialize_cdr(data, kind)
    for status in message.status if kind == "diagnostic_msgs/msg/DiagnosticArray" else ():
        status.values = [v for v in status.values if not v.key.startswith(("cpu_ms", "ms "))]
    return bytes(STORE.serialize_cdr(message, kind))


def canonical_part(data: bytes) -> bytes:
    """A list of findings without the name of the part, which live is another."""
    kind = "roller_msgs/msg/FindingArray"
    message: Any = STORE.deserialize_cdr(data, kind)
    message.part = ""
    return bytes(STORE.serialize_cdr(message, kind))


def replayed(result: Path) -> dict[str, list[bytes]]:
    found: dict[str, list[bytes]] = defaultdict(list)
    with Reader(result) as reader:
        for connection, _, data in reader.messages():
            found[connection.topic].append(canonical(data, connection.msgtype))
    return found


@pytest.mark.parametrize("method", ["emvs", "left_right", "bma", "focus", "surface"])
def test_all_that_goes_out_is_the_same(method: str, bag: Path, tmp_path: Path) -> None:
    params = tmp_path / "params.yaml"
    params.write_text(PARAMS % method)
    inspects = method == "surface"
    words = ["inspect" if inspects else "replay", str(bag)]
    words += ["--output", str(tmp_path / "out"), "--no-picture"]
    reads = method in ("focus", "surface")  # Braille, which has nothing to do with the method
    words += ["--params", str(params), *([] if reads else ["--no-braille"])]
    # The plate has hardly any texture.
    assert main(words) == (4 if inspects else 0)
    expected = replayed(tmp_path / "out" / "result")

    kinds: list[Any] = [SurfaceStage, InspectStage] if inspects else [DepthStage, StitcherStage]
    live = Live(params, *kinds, *([BrailleStage] if reads else []))
    live.play(bag)
    assert live.faults == []
    # Live once a second, in the bag once: the last is the same.
    assert len(expected["/roller/surface/map"]) == 1
    del live.published["/roller/surface/map"][:-1]
    named, part = (p["/roller/inspection/findings"] for p in (live.published, expected))
    assert [canonical_part(m) for m in named] == [canonical_part(m) for m in part]
    assert len(part) > 1 or not inspects
    del live.published["/roller/inspection/findings"], expected["/roller/inspection/findings"]
    assert {k: len(v) for k, v in live.published.items()} == {
        k: len(v) for k, v in expected.items()
    }
    assert live.published == expected
    assert expected["/roller/surface/points"]
    accounts = expected[f"/roller/{'surface' if method == 'surface' else 'depth'}/account"]
    assert len(accounts) >= 2
    assert len(expected["/roller/depth/image"]) >= 2 or method == "surface"
    if reads:
        assert (tmp_path / "out" / "braille.txt").read_text() == "dfhj\n"
        assert len(expected["/roller/braille/markers"]) == len(expected["/roller/braille/cells"])
    head = (tmp_path / "out" / "surface.ply").read_bytes()[:300]
    assert b"frame left_base" in head


def test_a_prefix_that_nobody_named_is_reported(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["replay", str(bag), "--output", str(tmp_path / "out"), "--no-picture"]
    assert main([*words, "--no-braille"]) == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "no poses base -> tool0_controller on /tf; there is left_base -> left_tool0" in line
    assert "set base_frame and moving_frame" in line


DEPTH = """
emvs:
  ros__parameters: {window.travel_m: 0.006, focus.sigma_px: 3.0}
"""


def test_faults_are_reported_and_it_goes_on(tmp_path: Path) -> None:
    """Broken packets and a broken pose: a fault each, and depth before and after."""
    from dataclasses import replace

    def edit(topic: str, n: int, message: Any) -> Any:
        if topic == "/event_camera/events" and n == 5:
            return replace(message, events=message.events[:-1])
        if topic == "/event_camera/events" and n == 6:
            return replace(message, encoding="evt9")
        if topic == "/event_camera/events" and n == 7:
            return replace(message, width=64)
        if topic == "/event_camera/events" and n == 8:
            return None
        if topic == "/tf" and n == 4:
            rotation = message.transforms[0].transform.rotation
            rotation.x = rotation.y = rotation.z = rotation.w = 0.0
        return message

    (tmp_path / "params.yaml").write_text(DEPTH)
    live = Live(tmp_path / "params.yaml", DepthStage)
    assert live.stages[0].health() == (1, "waiting for event_camera/camera_info")
    live.play(write_analytic_bag(tmp_path / "scan", Recipe(edit=edit)))
    reported = " / ".join(map(str, live.faults))
    for part in ("no whole number", "'evt9'", "64×120 px", "quaternion is zero"):
        assert part in reported, reported
    assert len(live.faults) == 4
    assert len(live.published["/roller/depth/image"]) >= 3
    counts = live.stages[0].counts()
    # One packet is missing; the broken ones and the one between decoders count as lost too.
    assert counts["lost_packets"] >= 1
    assert counts["decode_errors"] == 3


def test_a_source_that_starts_again_is_followed(tmp_path: Path) -> None:
    """The same again, ten seconds earlier: time jumps back, depth and surface come twice."""

    def ten_seconds_earlier(topic: str, n: int, message: Any) -> Any:
        stamped = message.transforms if hasattr(message, "transforms") else [message]
        for header in [item.header for item in stamped]:
            header.stamp.sec -= 10
        return message

    (tmp_path / "params.yaml").write_text(DEPTH)
    live = Live(tmp_path / "params.yaml", DepthStage, StitcherStage)
    live.play(write_analytic_bag(tmp_path / "scan"))
    maps, clouds = (list(live.published[f"/roller/{k}"]) for k in ("depth/image", "surface/points"))
    live.play(write_analytic_bag(tmp_path / "earlier", Recipe(edit=ten_seconds_earlier)))
    assert len(live.published["/roller/depth/image"]) == 2 * len(maps) >= 6
    assert len(live.published["/roller/surface/points"]) == 2 * len(clouds) >= 2
    assert live.stages[0].counts()["windows"] == 2 * len(maps)
    assert all("backwards" in str(fault) for fault in live.faults)
    assert live.faults


def later(source: Path, path: Path, shifts_s: list[int], renumbered: bool) -> Path:
    """A bag's messages once for each shift of their times, by one process or one each."""
    connections: dict[str, Any] = {}
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    with writer:
        for shift_s in shifts_s:
            with Reader(source) as reader:
                for connection, t_ns, data in reader.messages():
                    topic, kind = connection.topic, connection.msgtype
                    if topic not in connections:
                        connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
                    message: Any = STORE.deserialize_cdr(data, kind)
                    for item in getattr(message, "transforms", [message]):
                        item.header.stamp.sec += shift_s
                    if topic == "/event_camera/events" and not renumbered:
                        message.seq += shift_s and connection.msgcount
                        message.time_base += shift_s * 10**9
                    writer.write(
                        connections[topic], t_ns + shift_s * 10**9,
                        bytes(STORE.serialize_cdr(message, kind)),
                    )  # fmt: skip
    return path


@pytest.mark.parametrize("renumbered", [True, False])
def test_a_scan_after_a_silence_is_followed(renumbered: bool, bag: Path, tmp_path: Path) -> None:
    """Packets numbered anew are of another process, whose text is on another page."""
    params = tmp_path / "params.yaml"
    params.write_text(PARAMS % "focus")
    both = later(bag, tmp_path / "both", [0, 10], renumbered)
    words = ["--output", str(tmp_path / "out"), "--no-picture", "--params", str(params)]
    assert main(["replay", str(both), *words]) == 1
    expected = replayed(tmp_path / "out" / "result")

    live = Live(params, DepthStage, StitcherStage, BrailleStage)
    live.play(bag)
    once = len(live.published["/roller/depth/image"])
    for stage in live.stages:
        if renumbered and outputs.EVENTS in stage.inputs:
            feed(stage, outputs.EVENTS, NEW_SOURCE, live.faults.append)
    live.play(later(bag, tmp_path / "second", [10], renumbered))
    for topic in ("depth/image", "braille/cells"):
        assert live.published[f"/roller/{topic}"] == expected[f"/roller/{topic}"]
    assert len(expected["/roller/depth/image"]) == 2 * once >= 4
    text = "dfhj\ndfhj\n" if renumbered else "dfhj\n"
    assert (tmp_path / "out" / "braille.txt").read_text() == text


def test_what_was_ready_before_a_silence_comes_once() -> None:
    pipeline = Pipeline(PipelineSettings.load(None), Camera(64, 48, 100.0, 100.0, 31.5, 23.5))
    before = Result(None, notice="before")
    pipeline._ready = [before]
    for t_s in (10, 20):
        pipeline.add_events(EventArray.from_arrays([1], [1], [t_s * 10**9], [1]))
    assert [result for result in pipeline.results() if result is before] == [before]
