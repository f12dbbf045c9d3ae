"""The grid as an emulated robot shows it to an emulated camera, recorded by a cell's nodes."""

import json
import time
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.blinking_grid import (
    BASE_TARGET,
    LIVE_MARGIN_S,
    LIVE_PERIOD_S,
    LIVE_VIEW_S,
    SENSOR_NS,
    view_events,
)  # fmt: skip
from driver.emulation import usb_backend
from driver.emulation.camera_words import encode_words
from driver.emulation.controller_process import ControllerProcess
from graph.graph_world import EMULATED_CAMERA, Processes, Watcher
from own import LOOPBACK
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.transforms import F64, inverse_pose

CAMERA, RECORDER = "event_camera: camera", "recorder: recording"


def write_motion(path: Path, poses: list[F64], hand_eye: F64) -> Path:
    """The tool as the controller gives it: still while the grid blinks, then to the next place."""
    times, rows = [], []
    for k, pose in enumerate(poses):
        tool = BASE_TARGET @ inverse_pose(pose) @ inverse_pose(hand_eye)
        row = [*tool[:3, 3], *Rotation.from_matrix(tool[:3, :3]).as_rotvec()]
        begin = k * LIVE_PERIOD_S
        times += [begin - LIVE_MARGIN_S, begin + LIVE_VIEW_S + LIVE_MARGIN_S]
        rows += [row, row]
    np.savez(path, t_s=times, pose=rows)
    return path


def record_views(
    bag: Path, camera_file: Path, true: Camera, poses: list[F64], hand_eye: F64
) -> None:
    """Have the nodes of a cell write a bag of what both devices send, in the test's domain."""
    folder = bag.with_name(f"{bag.name}_devices")
    folder.mkdir()
    rng = np.random.default_rng(5)
    begins = [SENSOR_NS + round(k * LIVE_PERIOD_S * 1e9) for k in range(len(poses))]
    events = EventArray.concatenate(
        [view_events(true, p, t, rng, LIVE_VIEW_S) for p, t in zip(poses, begins, strict=True)]
    )
    words, start = folder / "views.u4", folder / "start"
    encode_words(events).tofile(words)
    pace = {"first_us": SENSOR_NS // 1000, "start_file": str(start)}
    motion = write_motion(folder / "motion.npz", poses, hand_eye)
    nodes = Processes(folder)
    with pytest.MonkeyPatch.context() as patch, ExitStack() as stack:
        patch.setenv(usb_backend.EVENTS_VARIABLE, str(words))
        patch.setenv(usb_backend.PACE_VARIABLE, json.dumps(pace))
        controller = stack.enter_context(ControllerProcess(trajectory=str(motion)))
        watcher = stack.enter_context(closing(Watcher(("/tf",))))
        stack.callback(nodes.stop)
        # A recorder of best effort has 1000 packets to catch up: ten seconds of these.
        given = f"camerainfo_url: 'file://{camera_file}', event_message_time_threshold: 0.01"
        nodes.start("event_camera", f"{{{EMULATED_CAMERA}, {given}}}")
        nodes.start("ur10", f"{{robot_ip: {LOOPBACK}}}")
        nodes.start("recorder", f"{{output: '{bag}'}}")
        watcher.spin_until(
            lambda: watcher.value(CAMERA, "connects") > 0 and watcher.value(RECORDER, "/tf") > 20,
            60,
            "the graph",
        )
        begin_s = time.monotonic() + 0.5
        controller.send(f"start {begin_s!r}")
        # Written elsewhere first: the camera reads the file as soon as it is there.
        start.with_suffix(".new").write_text(repr(begin_s))
        start.with_suffix(".new").rename(start)
        end_s = begin_s + LIVE_PERIOD_S * len(poses)
        watcher.spin_until(
            lambda: (
                time.monotonic() > end_s
                and watcher.value(RECORDER, "/event_camera/events")
                == watcher.value(CAMERA, "packets_sent")
            ),
            LIVE_PERIOD_S * len(poses) + 60,
            "all that was sent in the bag",
        )
