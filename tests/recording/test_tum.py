"""Poses in text files."""

from pathlib import Path

import numpy as np
import pytest

from recording.bags import camera_track, write_tum
from roller_core.pose_track import PoseError
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
    ],
)
def test_tum_faults(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(PoseError, match=message):
        read_tum(path)
