"""Bad bags get one clear line and a non-zero exit; what was good before is kept."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Writer

from recording.bags import CAMERA, Recipe, bag_messages, write_bag, write_messages
from roller_core.events import EventArray
from roller_emvs.ply import read_ply
from roller_inspect.pipeline import Pipeline

from .refusing import Capture, refuse, run


def on(topic: str, change: Callable[[int, Any], Any]) -> Callable[[str, int, Any], Any]:
    """An edit of one topic's messages."""
    return lambda name, n, message: change(n, message) if name == topic else message


EVENTS, TF, INFO = "/event_camera/events", "/tf", "/event_camera/camera_info"

#: Faults that a replay can't start with: recipe and what the line says.
HOPELESS = {
    "no events": (Recipe(edit=on(EVENTS, lambda n, m: None)), "no topic of type event_camera_msgs"),
    "no camera info": (Recipe(camera=None), "no /event_camera/camera_info.*--camera"),
    "no poses": (Recipe(tf=False, tf_static=False), "no poses .topic /tf.*--poses"),
    "no hand-eye": (
        Recipe(tf_static=False),
        "no path tool0_controller -> event_camera_optical_frame on /tf_static",
    ),
    "uncalibrated camera": (
        Recipe(edit=on(INFO, lambda n, m: replace(m, k=np.zeros(9)))),
        "calibrated",
    ),
}


def earlier_packets(n: int, message: Any) -> Any:
    """From the 50th on, packets of 100 s before."""
    if n < 50:
        return message
    header = message.header
    header = replace(header, stamp=replace(header.stamp, sec=header.stamp.sec - 100))
    return replace(message, header=header, time_base=message.time_base - 4_000_000_000)


def an_earlier_pose(n: int, message: Any) -> Any:
    if n == 8:
        message.transforms[0].header.stamp.sec -= 10
    return message


#: Faults in the middle: recipe and what the line says; good results stay.
LATE = {
    "odd length": (
        Recipe(edit=on(EVENTS, lambda n, m: replace(m, events=m.events[:-1]) if n == 50 else m)),
        "no whole number",
    ),
    "unknown encoding": (
        Recipe(edit=on(EVENTS, lambda n, m: replace(m, encoding="evt9") if n > 50 else m)),
        "'evt9'.*more of this kind",
    ),
    "wrong image size": (
        Recipe(edit=on(EVENTS, lambda n, m: replace(m, width=64) if n == 50 else m)),
        "64×120 px but the camera is calibrated for 320×120",
    ),
    "time runs backwards": (Recipe(edit=on(EVENTS, earlier_packets)), "runs backwards"),
    "poses run backwards": (
        Recipe(edit=on(TF, an_earlier_pose)), "pose at .* older than the one before",
    ),
    "gap in the poses": (
        Recipe(edit=on(TF, lambda n, m: None if 6 <= n < 11 else m)), "gap of 0.048 s",
    ),
    "poses begin late": (
        Recipe(edit=on(TF, lambda n, m: None if n < 5 else m)),
        r"% of the events have no pose: events from 1700000000\.00. to .* poses from .*\.0[34]",
    ),
    "poses end early": (
        Recipe(edit=on(TF, lambda n, m: None if n > 5 else m)), "% of the events have no pose",
    ),
}  # fmt: skip


def test_another_calibration_in_the_middle_is_reported(tmp_path: Path, capsys: Capture) -> None:
    def infos(topic: str, n: int, message: Any) -> Any:
        return message if topic == INFO else None

    (first,) = bag_messages(Recipe(edit=infos))
    (other,) = bag_messages(Recipe(camera=replace(CAMERA, fx=CAMERA.fx * 1.1), edit=infos))
    for name, info, code in (("same", first, 0), ("other", other, 1)):
        again = (info[0] + 40_000_000, *info[1:])
        writer = Writer(tmp_path / name, version=9)
        write_messages(writer, sorted([*bag_messages(Recipe()), again]))
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        assert run(tmp_path, capsys, tmp_path / name)[0] == code, name
    assert "says another camera or calibration" in str(
        json.loads((tmp_path / "out" / "report.json").read_text())["faults"]
    )


@pytest.mark.parametrize("name", HOPELESS)
def test_hopeless_input(name: str, tmp_path: Path, capsys: Capture) -> None:
    recipe, message = HOPELESS[name]
    refuse(tmp_path, capsys, write_bag(tmp_path / "scan", recipe), message)


@pytest.mark.parametrize("name", LATE)
def test_late_fault_keeps_what_is_good(name: str, tmp_path: Path, capsys: Capture) -> None:
    recipe, message = LATE[name]
    refuse(tmp_path, capsys, write_bag(tmp_path / "scan", recipe), message)
    report = assert_kept(tmp_path / "out")
    lost = [reason for w in report["windows"] for reason in w["lost"]]
    over = any("gap of 0.048 s, over the limit" in reason for reason in lost)
    assert over == (name == "gap in the poses")


def assert_kept(output: Path) -> dict[str, Any]:
    report = json.loads((output / "report.json").read_text())
    assert report["totals"]["depth_windows"] >= 1
    assert report["faults"]
    assert len(read_ply(output / "surface.ply")["x"]) > 300
    assert (output / "result" / "metadata.yaml").is_file()
    return dict(report)


def test_input_that_gives_nothing_leaves_the_earlier_result(
    tmp_path: Path, capsys: Capture
) -> None:
    good = write_bag(tmp_path / "good")
    unknown = Recipe(edit=on(EVENTS, lambda n, m: replace(m, encoding="evt9")))
    bad = write_bag(tmp_path / "bad", unknown)
    refuse(tmp_path, capsys, bad, "'evt9'.*more of this kind.$")
    assert json.loads((tmp_path / "out" / "report.json").read_text())["faults"]
    assert run(tmp_path, capsys, good)[0] == 0
    before = {p: p.read_bytes() for p in sorted((tmp_path / "out").rglob("*")) if p.is_file()}
    refuse(tmp_path, capsys, bad, "'evt9'.*; nothing came of it, so the earlier result in .*out")
    after = {p: p.read_bytes() for p in sorted((tmp_path / "out").rglob("*")) if p.is_file()}
    assert after == before


def test_truncated_bag(tmp_path: Path, capsys: Capture) -> None:
    source = write_bag(tmp_path / "scan")
    file = source / "scan.mcap"
    file.write_bytes(file.read_bytes()[: int(file.stat().st_size * 0.8)])
    (source / "metadata.yaml").unlink()
    refuse(
        tmp_path, capsys, source, r"cut off at byte \d+, after 0.0\d\d s; the \d+ messages before"
    )
    assert_kept(tmp_path / "out")


def test_empty_windows(tmp_path: Path, capsys: Capture) -> None:
    """A quiet stretch in the middle is no fault."""
    recipe = Recipe(edit=on(EVENTS, lambda n, m: None if 30 <= n < 60 else m))
    code, _ = run(tmp_path, capsys, write_bag(tmp_path / "scan", recipe), "--method", "emvs")
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["totals"]["lost_packets"] == 30
    assert report["totals"]["depth_windows"] >= 2
    assert code == 0


def test_no_events_at_all(tmp_path: Path, capsys: Capture) -> None:
    empty = Recipe(edit=on(EVENTS, lambda n, m: replace(m, events=m.events[:0])))
    code, _ = run(tmp_path, capsys, write_bag(tmp_path / "scan", empty))
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["totals"]["depth_windows"] == 0
    assert code == 0


def test_an_interrupt_says_what_was_not_processed(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = Pipeline.add_events

    packets = iter(range(40))

    def take(self: Pipeline, events: EventArray, renumbered: bool) -> None:
        taken(self, events, renumbered)
        if next(packets, None) is None:
            raise KeyboardInterrupt

    monkeypatch.setattr(Pipeline, "add_events", take)
    code, (line, last) = run(tmp_path, capsys, write_bag(tmp_path / "scan"))
    assert (code, last) == (130, "interrupted")
    assert re.search(r"scan: \d\d% of it were not processed, nothing is written", line)
    assert not (tmp_path / "out").exists()
