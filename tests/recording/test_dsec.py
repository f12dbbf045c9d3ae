"""DSEC's HDF5: events with poses; what it lacks is named."""

import sys
from pathlib import Path

import numpy as np
import pytest

from recording.bags import CAMERA, scan
from recording.event_files import check_read_back
from roller_bringup.cli import main
from roller_core.events import EventArray
from roller_recording.reading import RecordingError, open_recording

OFFSET_US = 49_000_000


@pytest.fixture
def own() -> EventArray:
    """Some events of the scan, in whole microseconds."""
    events = scan()[:60_000]
    return events.with_times((events.t_ns - events.t_ns[0]) // 1000 * 1000 + OFFSET_US * 1000)


def write(path: Path, events: EventArray, leave_out: str = "", **other: np.ndarray) -> Path:
    """A file of events, columns but for `leave_out`, in place of some `other` ones."""
    h5py = pytest.importorskip("h5py", reason="an extra")
    with h5py.File(path, "w") as file:
        columns = {
            "x": events.x.astype("u2"), "y": events.y.astype("u2"), "p": events.p.astype("u1"),
            "t": (events.t_ns // 1000 - OFFSET_US).astype("u4"),
        } | other  # fmt: skip
        for name, values in columns.items():
            if name != leave_out:
                file.create_dataset(f"events/{name}", data=values, chunks=(4096,), fletcher32=True)
        t = columns["t"]
        file["ms_to_idx"] = np.searchsorted(t, np.arange(0, t[-1] + 1, 1000)).astype("u8")
        file["t_offset"] = np.int64(OFFSET_US)
    return path


def test_events_come_back(
    own: EventArray, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "events.h5", own)
    poses, camera = check_read_back(path, own, 49, capsys)
    with pytest.raises(RecordingError, match="one stream of events"):
        open_recording(path, poses, camera, topic="left")
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 64] = bytes(64)
    path.write_bytes(data)
    assert main(["info", str(path)]) == 1
    assert "damaged in events 0 to 60000" in capsys.readouterr().err


@pytest.mark.parametrize(("off", "on"), [(0, 255), (-1, 1)])
def test_polarities_in_other_numbers(
    off: int, on: int, own: EventArray, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    p = np.where(own.p > 0, on, off).astype("i2")
    check_read_back(write(tmp_path / "events.h5", own, p=p), own, 49, capsys)


def test_numbers_that_mean_nothing_are_refused(
    own: EventArray, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "events.h5", own, p=np.arange(len(own)) % 2 + 1)
    assert main(["info", str(path)]) == 1
    assert (
        "events/p holds values from 1 to 2; expected 0 and 1 or -1 and 1 or 0 and 255"
        in capsys.readouterr().err
    )
    path = write(tmp_path / "seconds.h5", own, t=own.t_ns * 1e-9)
    with pytest.raises(RecordingError, match="events/t is of float64; expected whole microsec"):
        open_recording(path)


def test_time_that_runs_backwards_is_said(
    own: EventArray, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch
) -> None:
    monkeypatch.setattr("roller_recording.reading.dsec._CHUNK_EVENTS", 10_000)
    twice = EventArray.concatenate([own.shifted(2_000_000_000), own])
    path = write(tmp_path / "events.h5", twice)
    assert main(["info", str(path)]) == 1
    assert "event time runs backwards by 2." in capsys.readouterr().err
    poses, camera = tmp_path / "poses.txt", tmp_path / "camera.yaml"
    poses.write_text("49 0 0 0 0 0 0 1\n52 0.3 0 0 0 0 0 1\n")
    CAMERA.to_yaml(camera)
    steps = list(open_recording(path, poses, camera).items())
    assert [k for k, step in enumerate(steps) if step.restart] == [6]
    assert sum(len(step.events) for step in steps) == len(twice)


def test_what_can_not_be_read_is_named(
    own: EventArray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "events.h5", own, leave_out="p")
    with pytest.raises(RecordingError, match=r"there is no events/p; it has events, ms_to_idx"):
        open_recording(path)
    path.write_bytes(b"\x89HDF nonsense")
    with pytest.raises(RecordingError, match="can't be read as HDF5"):
        open_recording(path)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(RecordingError, match="needs h5py: pip install h5py hdf5plugin"):
        open_recording(path)
    (tmp_path / "notes.txt").write_text("no recording")
    with pytest.raises(RecordingError, match=r"read are also AEDAT4 .* and DSEC"):
        open_recording(tmp_path / "notes.txt")


def test_a_compression_that_is_not_installed_is_named(
    own: EventArray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blosc, filter 32001, as in the dataset; nothing here writes it, so a header claims it."""
    h5py = pytest.importorskip("h5py", reason="an extra")
    monkeypatch.setitem(sys.modules, "hdf5plugin", None)
    path = tmp_path / "events.h5"
    with h5py.File(path, "w") as file:
        for name in ("x", "y", "t", "p"):
            properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            properties.set_chunk((16,))
            properties.set_filter(32001, h5py.h5z.FLAG_OPTIONAL, ())
            space = h5py.h5s.create_simple((16,))
            made = h5py.h5d.create(
                file.require_group("events").id, name.encode(), h5py.h5t.NATIVE_UINT16, space,
                properties,
            )  # fmt: skip
            made.write_direct_chunk((0,), bytes(40))
    CAMERA.to_yaml(tmp_path / "camera.yaml")
    (tmp_path / "poses.txt").write_text("0 0 0 0 0 0 0 1\n")
    recording = open_recording(path, tmp_path / "poses.txt", tmp_path / "camera.yaml")
    with pytest.raises(RecordingError, match="needs hdf5plugin: pip install h5py hdf5plugin"):
        list(recording.items())
