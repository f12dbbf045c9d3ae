"""Files of events without poses: an AEDAT4 writer, and what all readers promise."""

from pathlib import Path

import dv_processing as dv
import numpy as np
import pytest

from recording.bags import CAMERA, SENSOR_START_NS, START_NS, scan
from roller_bringup.cli import main
from roller_core.events import EventArray
from roller_recording.reading import RecordingError, open_recording


def write_aedat4(path: Path, streams: dict[str, int]) -> Path:
    """An AEDAT4 file with events of the scan in each stream: every n-th, as it takes one by one."""
    config = dv.io.MonoCameraWriter.Config("camera")
    for name in streams:
        config.addEventStream((CAMERA.width, CAMERA.height), name)
    writer = dv.io.MonoCameraWriter(str(path), config)
    events = scan().shifted(START_NS - SENSOR_START_NS)
    for name, every in streams.items():
        for part in range(0, len(events), 40_000):  # as packets of a few milliseconds
            store = dv.EventStore()
            for k in range(part, min(part + 40_000, len(events)), every):
                store.push_back(
                    int(events.t_ns[k]) // 1000, int(events.x[k]), int(events.y[k]), True
                )
            writer.writeEvents(store, name)
    return path


def check_read_back(
    path: Path, own: EventArray, start_s: int, capsys: pytest.CaptureFixture[str]
) -> tuple[Path, Path]:
    """A file without poses gives its events; what it was read with: poses, and the camera."""
    poses, camera = path.with_name("poses.txt"), path.with_name("camera.yaml")
    poses.write_text(f"{start_s} 0 0 0 0 0 0 1\n{start_s + 1} 0.3 0 0 0 0 0 1\n")
    CAMERA.to_yaml(camera)
    steps = list(open_recording(path, poses, camera).steps())
    found = EventArray.concatenate([step.events for step in steps if len(step.events)])
    for name in ("x", "y", "t_ns", "p"):
        np.testing.assert_array_equal(getattr(found, name), getattr(own, name))
    assert main(["info", "--check", str(path)]) == 0
    assert f"events     {len(own)} (" in capsys.readouterr().out
    with pytest.raises(RecordingError, match="holds no poses; give --poses"):
        open_recording(path, None, camera)
    return poses, camera
