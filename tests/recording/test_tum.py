"""Poses in text files."""

import re
from pathlib import Path

import numpy as np
import pytest

from recording.bags import analytic_dataset, camera_track, write_tum
from roller_core.pose_track import PoseError
from roller_recording.reading import open_recording
from roller_recording.reading.tum import read_tum


def test_tum_round_trip(tmp_path: Path) -> None:
    track = camera_track()
    write_tum(track, tmp_path / "poses.txt")
    again = read_tum(tmp_path / "poses.txt")
    np.testing.assert_array_equal(again.times_ns, track.times_ns)
    np.testing.assert_allclose(again.positions, track.positions, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 1 2 3\n", "line 1: 4 fields"),
        ("0 0 0 0 0 0 0 1\nx 0 0 0 0 0 0 1\n", "line 2"),
        ("1 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n", "line 2.*backwards"),
        ("# nothing\n", "no pose"),
        ("1700000000002405079 0 0 0 0 0 0 1\n", "line 1: .*; is it in nanoseconds"),
        ("1e30 0 0 0 0 0 0 1\n", "line 1: .* is no time in seconds"),
        ("1e999999 0 0 0 0 0 0 1\n", "line 1: '1e999999' is no time in seconds; expected"),
        ("0 0 0 0 0 0 0 1\n0.01 3 0 0 0 0 0 1\n", "at 300 m/s; are positions in millimetres"),
    ],
)
def test_tum_faults(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(PoseError, match=message):
        read_tum(path)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1700000000.1 0 0", "line 11: 3 fields; expected 't x y z qx qy qz qw'; what came before"),
        ("1e999999 0 0 0 0 0 0 1", "line 11: '1e999999' is no time in seconds; .*; what came bef"),
        ("x 0 0 0 0 0 0 1", "line 11: 'x' is no time in seconds; .*; what came before is kept"),
        ("-1 0 0 0 0 0 0 1", "line 11: .* time runs backwards, .*; what came before is kept"),
    ],
)
def test_poses_before_a_bad_line_are_kept(line: str, message: str, tmp_path: Path) -> None:
    """As events are: a file that was cut off in the middle of a line is of use up to there."""
    folder = analytic_dataset(tmp_path / "data", 3000)
    poses = folder / "groundtruth.txt"
    lines = poses.read_text().splitlines(keepends=True)
    poses.write_text("".join(lines[:10]) + line)
    recording = open_recording(folder)
    (fault,) = [str(f) for step in recording.steps() for f in step.faults]
    assert re.match(f"poses {poses}, {message}", fault)
    assert recording.counts.events == 3000
    assert len(recording.track) == 10


def test_a_pose_that_is_none_costs_itself_alone(tmp_path: Path) -> None:
    folder = analytic_dataset(tmp_path / "data", 3000)
    poses = folder / "groundtruth.txt"
    first, second, *rest = poses.read_text().splitlines(keepends=True)
    poses.write_text(f"{first.split()[0]} 0 0 nan 0 0 0 1\n{second}{''.join(rest)}")
    recording = open_recording(folder)
    (fault,) = [str(f) for step in recording.steps() for f in step.faults]
    assert re.search("line 1: pose at .* s is not finite; it is left out$", fault)
    assert len(recording.track) == len(rest) + 1


def test_a_byte_order_mark_is_no_part_of_a_time(tmp_path: Path) -> None:
    """Windows' editors write one."""
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 0 0 1\n", encoding="utf-8-sig")
    assert read_tum(tmp_path / "poses.txt").start_ns == 1_000_000_000
