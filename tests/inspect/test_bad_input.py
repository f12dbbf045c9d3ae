"""Bad input gets one clear line and a non-zero exit; what was good before is kept."""

import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Writer

from recording.bags import (
    CAMERA,
    Recipe,
    analytic_dataset,
    bag_messages,
    camera_track,
    write_bag,
    write_messages,
    write_tum,
)
from roller_bringup.cli import main
from roller_core.events import EventArray
from roller_emvs.ply import read_ply
from roller_inspect.pipeline import Pipeline

PARAMS = """
emvs:
  ros__parameters: {window.travel_m: 0.006, focus.sigma_px: 3.0, max_pose_gap_s: 0.03}
"""

Capture = pytest.CaptureFixture[str]


def run(tmp_path: Path, capsys: Capture, source: Path, *more: str) -> tuple[int, list[str]]:
    """Exit code and lines on standard error."""
    params = tmp_path / "params.yaml"
    params.write_text(PARAMS)
    words = ["replay", str(source), "--output", str(tmp_path / "out"), "--no-picture"]
    code = main([*words, "--params", str(params), *more])
    return code, [line for line in capsys.readouterr().err.splitlines() if line.strip()]


def refuse(tmp_path: Path, capsys: Capture, source: Path, pattern: str, *more: str) -> None:
    """Replay what is no good; there is one line, which says so."""
    code, errors = run(tmp_path, capsys, source, *more)
    assert code == 1
    (line,) = errors
    assert_matches(line, pattern)


def assert_matches(line: str, pattern: str) -> None:
    assert line.startswith("error: ")
    assert re.search(pattern, line), line


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


def test_missing_input(tmp_path: Path, capsys: Capture) -> None:
    refuse(tmp_path, capsys, tmp_path / "nothing", "there is no such file or folder")
    for name in ("pipe", "pipe.raw"):
        os.mkfifo(tmp_path / name)
        refuse(tmp_path, capsys, tmp_path / name, "neither a file nor a folder")
        assert main(["info", str(tmp_path / name)]) == 1
        assert_matches(capsys.readouterr().err, "neither a file nor a folder")


def test_a_folder_that_is_no_bag(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "folder").mkdir()
    refuse(tmp_path, capsys, tmp_path / "folder", "no rosbag2 storage")


def test_unwritable_output(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "out").write_text("a file is there already")
    refuse(tmp_path, capsys, write_bag(tmp_path / "scan"), "is a file; give another --output")


def test_a_stranger_in_the_output_is_left_alone(tmp_path: Path, capsys: Capture) -> None:
    stranger = tmp_path / "out" / "result"
    stranger.mkdir(parents=True)
    (stranger / "thesis.tex").write_text("years of work")
    refuse(tmp_path, capsys, write_bag(tmp_path / "scan"), "holds files that roller did not write")
    assert (stranger / "thesis.tex").read_text() == "years of work"


def test_a_result_is_never_the_output_of_its_own_replay(tmp_path: Path, capsys: Capture) -> None:
    folder = tmp_path / "out"
    source = write_bag(folder / "result")
    (folder / "notes.txt").write_text("beside it")
    (tmp_path / "link").symlink_to(folder)
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    for output in (folder, source, source / "new", tmp_path / "link"):
        assert main(["replay", str(source), "--output", str(output), "--no-picture"]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert_matches(line, "overlaps with the input")
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before


def test_a_run_that_can_not_begin_leaves_the_earlier_result(
    tmp_path: Path, capsys: Capture
) -> None:
    assert run(tmp_path, capsys, write_bag(tmp_path / "scan"))[0] == 0
    out = tmp_path / "out"
    before = {file: file.read_bytes() for file in out.rglob("*") if file.is_file()}
    for words in (
        ["replay", str(tmp_path / "nowhere")],
        ["demo", "--scene", "nope"],
        ["simulate", "flat"],  # which replaces nothing, not even of ours
    ):
        assert main([*words, "--output", str(out)]) == 1
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert {file: file.read_bytes() for file in out.rglob("*") if file.is_file()} == before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("emvs: {ros__parameters: {paper.planes: 1}}", "'paper.planes' = 1"),
        ("emvs: {ros__parameters: {plane: 100}}", "unknown entry 'plane'"),
        ("emvs: {ros__parameters: {depth_min_m: 0.05}}", "depth_min_m"),
        ("emvs: [", "not a YAML file"),
    ],
)
def test_bad_parameters(text: str, message: str, tmp_path: Path, capsys: Capture) -> None:
    params = tmp_path / "bad.yaml"
    params.write_text(text)
    source = write_bag(tmp_path / "scan")
    words = ["replay", str(source), "--output", str(tmp_path / "out"), "--params", str(params)]
    assert main(words) == 1
    assert_matches(capsys.readouterr().err.strip(), message)


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        ("events.txt", lambda s: s[:100_000] + "1.0 x 3\n", r"line \d+: expected 't x y p'"),
        ("events.txt", lambda s: s + "0.001 1 1 1\n", "time runs backwards"),
        ("groundtruth.txt", lambda s: s.replace("0 1\n", "0\n", 1), "line 1: 7 fields"),
        ("groundtruth.txt", lambda s: "", "holds no pose"),
        ("calib.txt", lambda s: "800 800\n", "expected 'fx fy cx cy"),
        ("calib.txt", None, "can't be read"),
        ("events.txt", None, "no rosbag2 storage|there is no events.txt"),
    ],
)
def test_bad_dataset(
    file: str,
    change: Callable[[str], str] | None,
    message: str,
    tmp_path: Path,
    capsys: Capture,
) -> None:
    folder = analytic_dataset(tmp_path / "data", 20_000)
    if change is None:
        (folder / file).unlink()
    else:
        (folder / file).write_text(change((folder / file).read_text()))
    refuse(tmp_path, capsys, folder, message)


def test_aedat4_needs_poses_and_camera(tmp_path: Path, capsys: Capture, shared_data: Path) -> None:
    source = shared_data / "aedat4" / "davis346.aedat4"
    refuse(tmp_path, capsys, source, "no poses; give --poses")
    write_tum(camera_track(), tmp_path / "poses.txt")
    given = ["--poses", str(tmp_path / "poses.txt")]
    refuse(tmp_path, capsys, source, "no calibration; give --camera", *given)
    CAMERA.to_yaml(tmp_path / "camera.yaml")
    given += ["--camera", str(tmp_path / "camera.yaml")]
    refuse(tmp_path, capsys, source, "346×260 px but the camera file is for 320×120", *given)


def test_not_an_aedat4_file(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "a.aedat4"
    path.write_bytes(b"nothing of the kind")
    refuse(tmp_path, capsys, path, "not a readable AEDAT4")


def test_truncated_aedat4_keeps_what_came_before(
    tmp_path: Path, capsys: Capture, shared_data: Path
) -> None:
    path = tmp_path / "cut.aedat4"
    shutil.copyfile(shared_data / "aedat4" / "davis346.aedat4", path)
    path.write_bytes(path.read_bytes()[:3_000_000])
    assert main(["info", str(path)]) == 1
    out = capsys.readouterr()
    assert_matches(
        out.err.strip(), r"cut off or broken after 1.\d\d\d s .*; the \d+ events before are read"
    )
    events = int(out.out.split("events")[1].split()[0])
    assert 1000 < events < 78_830


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
