"""What the stage gives beside the cells: text and markers, when a scan ends and another begins."""

from dataclasses import replace
from typing import Any

import pytest

pytest.importorskip("rclpy")

from visualization_msgs.msg import Marker

import roller_braille.messages  # noqa: F401 (registers the messages of cells)
from braille.synthetic import CAMERA, Plate, over, scan
from roller_braille.braille_stage import BrailleParameters, BrailleStage
from roller_core._clock_kernels import map_times
from roller_core.codecs import ENCODED_ENCODINGS
from roller_core.event_stream import EventStream
from roller_core.events import EventArray
from roller_core.frame_transforms import Transform
from roller_core.outputs import BRAILLE_CELLS, BRAILLE_MARKERS, BRAILLE_TEXT
from roller_core.pose_track import PoseOrderError
from roller_ros.messages import to_message
from roller_ros.topics import BY_NAME

FRAMES = "base", "tool0_controller"


def messages(stage: BrailleStage, flush: bool = False) -> list[tuple[str, Any]]:
    return [(o.topic, to_message(o)) for r in stage.results(flush) for o in r.outputs]


def stage_after_a_scan() -> BrailleStage:
    plate = Plate().text("abc")
    track = over(plate)
    stage = BrailleStage(BrailleParameters.create({}))
    stage.take_poses(track)
    stage.take_camera(CAMERA)
    assert messages(stage) == []
    stage.take_events(scan(plate, track))
    return stage


def is_delete_all(message: Any) -> bool:
    return [m.action for m in message.markers] == [Marker.DELETEALL]


def test_markers_of_an_earlier_scan_go_and_its_text_stays() -> None:
    stage = stage_after_a_scan()
    stage.restart()
    found = messages(stage)
    *scanned, (topic, last) = found
    assert sum(t == BRAILLE_CELLS for t, _ in scanned) == 3
    assert not any(t == BRAILLE_MARKERS and is_delete_all(m) for t, m in scanned)
    assert topic == BRAILLE_MARKERS
    assert is_delete_all(last)
    assert stage.text() == ["abc"]
    stage.restart()
    assert messages(stage) == []  # nothing is shown that could go


def test_the_first_pose_of_a_recording_played_once_more_begins_anew() -> None:
    stage, still = BrailleStage(BrailleParameters.create({"pose_smoothing": 0})), (0.0, 0.0, 0.0)

    def take(t_ns: int, *, static: bool = False) -> None:
        frames = ("tool0_controller", "event_camera_optical_frame") if static else FRAMES
        stage.take_transform(Transform(*frames, t_ns, still, (0.0, 0.0, 0.0, 1.0), static))

    take(0, static=True)
    stage.take_camera(CAMERA)
    take(500_000_000)
    with pytest.raises(PoseOrderError):
        take(0)  # late, or the first of the second time
    assert stage.frames.track.start_ns == 500_000_000
    stage.new_source()
    take(1_000_000)  # that time ran backwards is said already
    take(3_000_000)
    assert (stage.frames.track.start_ns, stage.frames.track.end_ns) == (0, 3_000_000)


def test_markers_of_a_cell_that_turns_out_blank_go() -> None:
    stage = stage_after_a_scan()
    found = [o for r in stage.results(flush=True) for o in r.outputs if o.topic == BRAILLE_MARKERS]
    shown = found[0].data
    blank = replace(shown, cell=replace(shown.cell, mask=0, character=" "))
    assert to_message(replace(found[0], data=blank)).markers == []
    again = to_message(replace(found[0], data=replace(blank, again=True))).markers
    assert [(m.action, m.id) for m in again] == 2 * [(Marker.DELETE, 1)]


def test_clear_forgets_text_and_markers() -> None:
    stage = stage_after_a_scan()
    stage.services()["clear"]()
    (*_, (_, read), _, _, (_, text)) = found = messages(stage)
    assert [t for t, _ in found[-2:]] == [BRAILLE_MARKERS, BRAILLE_TEXT]
    assert is_delete_all(found[-2][1])
    assert text.data == ""
    assert read.data == "abc"
    assert stage.text() == []
    assert BY_NAME[BRAILLE_TEXT].qos.durability.name == "TRANSIENT_LOCAL"


def test_the_topic_of_the_text_is_bounded() -> None:
    """It comes with each cell, and keeps the last hundred for who is late."""
    stage = stage_after_a_scan()
    stage._earlier = [f"{n:4d} {50 * 'x'}" for n in range(100)]
    texts = [m.data for t, m in messages(stage, flush=True) if t == BRAILLE_TEXT]
    whole = "\n".join(stage.text())
    assert len(whole) > 5000
    assert whole.endswith("  99 " + 50 * "x" + "\nabc")
    assert texts[-1] == "…" + whole[-2000:]
    assert {len(text) for text in texts} == {2001}


def test_of_a_line_without_end_the_end_is_read() -> None:
    stage = stage_after_a_scan()
    messages(stage, flush=True)
    assert stage.pipeline is not None
    lines = stage.pipeline._page._lines
    for k in range(9000):
        lines.put(0, 3 + k, lines.at(0, k % 3))
    assert stage.newest_text() == "…" + (3001 * "abc")[-2000:]
    assert lines._texts == {}  # nothing else was read
    assert stage.text() == [3001 * "abc"]


def test_warming_up_decodes_packets_of_every_encoding(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first packets of a scan would wait for it."""
    decoded: list[str] = []
    push = EventStream.push

    def watched(stream: EventStream, encoding: str, *given: Any) -> EventArray:
        found = push(stream, encoding, *given)
        decoded.extend([encoding] * (len(found) > 0))
        return found

    monkeypatch.setattr(EventStream, "push", watched)
    BrailleStage(BrailleParameters.create({})).warm_up()
    assert decoded == [encoding for encoding in ENCODED_ENCODINGS for _ in range(2)]
    assert map_times.signatures
