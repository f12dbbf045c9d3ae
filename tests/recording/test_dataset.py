"""Folders of the public event-camera dataset: what a text file of events may hold."""

from pathlib import Path

import numpy as np
import pytest

from recording.bags import CAMERA, analytic_dataset, scan
from roller_bringup.cli import main
from roller_core.camera import CameraError
from roller_core.pose_track import PoseError
from roller_recording.reading import RecordingError, open_recording

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return analytic_dataset(tmp_path / "data", 3000)


def test_comments_cost_no_events(folder: Path, capsys: Capture) -> None:
    text = folder / "events.txt"
    text.write_text("# t x y p\n" + text.read_text() + "# the end\n")
    steps = list(open_recording(folder).steps())
    assert sum(len(step.events) for step in steps) == 3000
    assert not any(step.faults for step in steps)
    text.write_text(text.read_text() + "0.9 1 x 1\n0.9 1 1 1\n")
    assert main(["info", str(folder)]) == 1
    out, err = capsys.readouterr()
    assert "events     3000 (" in out
    assert "line 3003: expected 't x y p', got '0.9 1 x 1'" in err


@pytest.mark.parametrize("text", ["", "# t x y p\n", "\n\n"])
def test_a_file_without_events_is_named(text: str, folder: Path) -> None:
    (folder / "events.txt").write_text(text)
    with pytest.raises(RecordingError, match="there are no events"):
        open_recording(folder)


@pytest.mark.parametrize("t", ["1e12", "inf", "-1e300", "nan"])
def test_times_that_are_none_end_the_file(t: str, folder: Path, capsys: Capture) -> None:
    with (folder / "events.txt").open("a") as file:
        file.write(f"{t} 1 1 1\n")
    assert main(["info", str(folder)]) == 1
    out, err = capsys.readouterr()
    assert "events     3000 (" in out
    assert "line 3001: expected 't x y p'" in err


def test_pixels_beyond_the_image_are_left_out_on_every_side(folder: Path, capsys: Capture) -> None:
    events = scan()[:3000]
    rows = np.loadtxt(folder / "events.txt")
    rows[:, 1] -= 40
    np.savetxt(folder / "events.txt", rows, fmt="%.9f %d %d %d")
    inside = int((events.x >= 40).sum())
    assert 0 < inside < 3000
    CAMERA.to_yaml(folder / "camera.yaml")
    steps = open_recording(folder, None, folder / "camera.yaml").steps()
    assert sum(len(step.events) for step in steps) == inside
    assert main(["info", str(folder)]) == 0
    assert f"outside    {3000 - inside} events" in capsys.readouterr().out


def test_events_are_counted_without_poses_or_calibration(folder: Path, capsys: Capture) -> None:
    for name in ("groundtruth.txt", "calib.txt"):
        (folder / name).unlink()
    assert main(["info", str(folder)]) == 0
    assert "events     3000 (" in capsys.readouterr().out
    with pytest.raises(PoseError, match=r"groundtruth.txt: can't be read"):
        open_recording(folder)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a b c d", "expected 'fx fy cx cy k1 k2 p1 p2 k3'"),
        ("0 0 1 1", "focal length 0, 0 px is not positive"),
        ("nan 1 1 1", "the camera calibration holds a value that is not finite"),
    ],
)
def test_a_calibration_that_cant_be_used_is_named(text: str, said: str, folder: Path) -> None:
    (folder / "calib.txt").write_text(text)
    with pytest.raises(CameraError) as caught:
        open_recording(folder)
    assert str(caught.value).startswith(f"camera {folder / 'calib.txt'}: {said}")
