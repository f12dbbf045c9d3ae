"""Prophesee files: EVT 3.0 with poses; what else they may be is named."""

from pathlib import Path

import numpy as np
import pytest

from recording.bags import CAMERA, scan
from recording.event_files import check_read_back
from roller_bringup.cli import main
from roller_core.codecs import encode
from roller_core.events import EventArray
from roller_recording.reading import RecordingError, open_recording

SIZE = f"{CAMERA.width}x{CAMERA.height}"


def from_zero() -> EventArray:
    """Some events of the scan, as the file has them: 24 bits of microseconds, from zero."""
    events = scan()[:60_000]
    return events.with_times((events.t_ns - events.t_ns[0]) // 1000 * 1000)


def write(path: Path, header: str, events: EventArray) -> Path:
    path.write_bytes(header.encode() + encode("evt3", events, 0).tobytes())
    return path


@pytest.mark.parametrize(
    "header",
    [
        f"% evt 3.0\n% format EVT3;height={CAMERA.height};width={CAMERA.width}\n% end\n",
        f"% camera_integrator_name Prophesee\n% evt 3.0\n% geometry {SIZE}\n",
        "% evt 3.0\n",  # old ones don't tell their size
    ],
)
def test_events_come_back(header: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = from_zero()
    path = write(tmp_path / "scan.raw", header, own)
    check_read_back(path, own, 0, capsys)
    path.write_bytes(path.read_bytes()[:-1])
    assert main(["info", str(path)]) == 1
    assert "in the middle of a word; what came before is read" in capsys.readouterr().err


def test_a_first_word_that_begins_like_a_header_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """0x8025, a time, has the bytes of a per cent sign and no letter."""
    own = from_zero()[:20_000].shifted((0x25 << 12) * 1000)
    path = write(tmp_path / "scan.raw", f"% evt 3.0\n% geometry {SIZE}\n", own)
    data = path.read_bytes()
    words = data[data.index(SIZE.encode()) + len(SIZE) + 1 :]
    path.write_bytes(data[: -len(words)] + b"%\x80" + words)
    check_read_back(path, own, int(own.t_ns[0]) // 10**9, capsys)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (f"% evt 2.0\n% geometry {SIZE}\n", r"is not of EVT 3.0 \(2.0\)"),
        ("% format EVT21;height=720;width=1280\n", r"is not of EVT 3.0 \(EVT21\)"),
        ("", "its header names no format"),
    ],
)
def test_what_can_not_be_read_is_named(header: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=message):
        open_recording(write(tmp_path / "scan.raw", header, from_zero()[:10]))


def test_info_says_what_of_a_file_means_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Codes that EVT 3.0 doesn't have, events before any time, events outside the image."""
    header = f"% evt 3.0\n% geometry {SIZE}\n"
    path = write(tmp_path / "scan.raw", header, from_zero())
    data, begin = path.read_bytes(), len(header)
    untimed = np.array([0x2003, 0x2004], "<u2").tobytes()
    junk = np.array([0xD000, 0x1234, 0x27FF], "<u2").tobytes()
    path.write_bytes(data[:begin] + untimed + data[begin : begin + 2000] + junk + data[begin:])
    assert main(["info", str(path)]) == 1
    said = capsys.readouterr()
    assert "untimed    2 events before the first time" in said.out
    assert "outside    1 events outside the image" in said.out
    assert f"2 words mean nothing in their encoding, the first in {path}, byte" in said.err
    assert f"byte {begin + 2004} (evt3)" in said.err
