"""A scan with an emulated camera and an emulated robot through the whole graph.

Both devices are driven by one simulated scan, each with a clock of its own that drifts. What the
graph publishes is compared with the same events and true poses given to the pipeline directly.
"""

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial import cKDTree

from driver.emulation import usb_backend
from driver.emulation.controller_process import ControllerProcess
from driver.emulation.scan import EmulatedScan
from graph.graph_world import Watcher
from own import LOOPBACK
from roller_bringup.launching import Runner, load
from roller_core.event_stream import EventStream
from roller_core.outputs import stamp_ns
from roller_core.window_account import WindowAccount, account_of
from roller_emvs.depth_map import DepthMap
from roller_emvs.patch import Patch
from roller_emvs.windows import RefusedWindow
from roller_inspect.pipeline import Pipeline, PipelineSettings
from roller_sim.motion import HAND_EYE_M, HAND_EYE_ROTATION_RAD

pytestmark = pytest.mark.graph

I64 = npt.NDArray[np.int64]
ROOT = Path(__file__).parents[2]
EVENTS, SURFACE = "/event_camera/events", "/roller/surface/points"
ACCOUNTS = "/roller/depth/account"
CAMERA, ROBOT = "event_camera: camera", "ur10: robot"
DEPTH, STITCHED = "emvs: depth", "stitcher: surface"
ROBOT_PPM, CONTROLLER_START_S = 50.0, 1234.0
OVERRIDES = "overrides.yaml"
#: A machine of two cores that has to do it all may miss poses for a while.
MAX_GAP_S = 0.5
#: After the graph gives up its third window of two seconds at standstill, by more than a busy host
#: may be late with the first packet: a window that begins while the robot moves hangs on when.
HOLD_S = 6.2


@dataclass(frozen=True)
class Took:
    """What the graph published, when the scan truly began, ROS time, and its windows."""

    packets: list[Any]
    poses: list[Any]
    cloud: npt.NDArray[np.float32]
    begin_ns: int
    controller_begin_ns: int
    windows: list[WindowAccount]
    skew_ppm: float


def test_emulated_devices_give_the_surface_of_the_direct_path(
    watch: Callable[..., Watcher], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Heights apart by a twentieth of a pixel in the median, but for the devices' delay."""
    pytest.importorskip("rtde_receive", reason="ur_rtde has no wheels for this Python")
    scan = EmulatedScan.simulate(
        scene={"name": "pyramid", "step_mm": 0.04},
        camera={"width": 320, "height": 120, "focal_px": 533.0},
        motion={"speed": 0.1, "start_mm": -6.5, "end_mm": 44.5, "hold_s": HOLD_S},
        clock={"drift_ppm": -40.0},
    )
    watcher = watch(EVENTS, "/tf", "/tf_static", SURFACE, ACCOUNTS)
    took = take_scan(watcher, scan, tmp_path, monkeypatch)

    # The clocks: what was mapped against what is true.
    mapped_ns, sensor_ns, skew_ppm = decoded(took.packets, scan)
    # The node's map is that of its packets; a busy host may have stamped some of them late.
    assert took.skew_ppm == pytest.approx(skew_ppm, abs=5)
    assert took.skew_ppm == pytest.approx(40, abs=35)
    packets_ns = took.begin_ns + np.rint(scan.seconds_of(sensor_ns) * 1e9).astype(np.int64)
    camera_delay = delay_of(mapped_ns, packets_ns, took.begin_ns, "camera")
    assert -20_000 < camera_delay < 2_000_000  # the map's own noise is microseconds
    stamps = np.array([stamp_ns(t) for t in took.poses])
    ticks = np.rint((stamps - took.controller_begin_ns) / 8e6)
    ticks_ns = took.controller_begin_ns + (ticks * 8_000_000).astype(np.int64)
    robot_delay = delay_of(stamps, ticks_ns, took.begin_ns, "robot")
    assert -20_000 < robot_delay < 2_000_000

    # The same events and true poses, one constant apart. The first packet is stamped as it comes,
    # and where windows begin moves the pixels of their depth maps over the relief: a direct path
    # that begins two milliseconds earlier lies 9 µm off.
    true_ns = took.begin_ns + np.rint(scan.seconds_of(scan.events.t_ns) * 1e9).astype(np.int64)
    from_ns = took.windows[0].start_ns
    assert 0 <= from_ns - true_ns[0] < HOLD_S * 1e9 - 6e9, "windows begin anew while it moves"
    events = scan.events.with_times(np.maximum(true_ns + camera_delay, from_ns))
    track = scan.camera_track((ticks_ns - took.begin_ns) * 1e-9, ticks_ns + robot_delay, MAX_GAP_S)
    # The gaps that the graph allows: a busy host misses poses here as well.
    settings = PipelineSettings.load(tmp_path / OVERRIDES)
    pipeline = Pipeline(settings, scan.camera, track, braille=False)
    pipeline.add_events(events)
    found = [r.found for r in pipeline.results(flush=True) if r.found is not None]
    direct = np.concatenate([p.columns() for p in found if isinstance(p, Patch)])
    accounts = [f.account for f in found if isinstance(f, DepthMap | RefusedWindow)]
    begun = [[w.start_ns - from_ns for w in windows] for windows in (took.windows, accounts)]
    assert begun[1] == pytest.approx(begun[0], abs=200_000)

    distance, nearest = cKDTree(direct[:, :2]).query(took.cloud[:, :2])
    near = distance < 2e-5
    apart_um = (took.cloud[near, 3] - direct[nearest[near], 3]) * 1e6
    away_um = np.abs(apart_um)
    print(
        f"{len(took.cloud)} points of the graph, {len(direct)} direct, {near.mean():.1%} matched; "
        f"heights apart by {away_um.mean():.2f} µm in the mean, median {np.median(away_um):.2f}, "
        f"95 % within {np.percentile(away_um, 95):.2f}; delays {camera_delay / 1e3:.0f} and "
        f"{robot_delay / 1e3:.0f} µs"
    )
    assert len(took.cloud) > 5000
    assert near.mean() > 0.98
    assert abs(apart_um.mean()) < 3.0
    # A pixel is 84 µm here. What is left are the maps of the clocks: 30 ppm over the time that a
    # point is seen are 1 µm. At borders single pixels come and go: nine points of ten.
    assert np.sort(away_um)[: int(0.9 * len(away_um))].mean() < 4.0
    assert np.median(away_um) < 4.0
    # The relief is there: a pyramid of steps, 0.4 mm high and more.
    assert np.ptp(np.percentile(took.cloud[:, 3], [2, 98])) > 3e-4


def take_scan(
    watcher: Watcher, scan: EmulatedScan, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> Took:
    """Start cell.launch.xml on the emulated devices, let them scan and wait for the surface."""
    pace = scan.write_words(folder / "words.u4") | {"start_file": str(folder / "start")}
    monkeypatch.setenv(usb_backend.EVENTS_VARIABLE, str(folder / "words.u4"))
    monkeypatch.setenv(usb_backend.PACE_VARIABLE, json.dumps(pace))
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests"), prepend=os.pathsep)
    scan.camera.to_yaml(folder / "camera.yaml")
    camera = {
        "backend": "driver.emulation.usb_backend:from_environment",
        # A reader of best effort has 1000 packets to catch up: four seconds of these.
        "event_message_time_threshold": 0.004,
    }
    robot = {
        "hand_eye_m": HAND_EYE_M,
        "hand_eye_rotation_rad": HAND_EYE_ROTATION_RAD,
    }
    overrides = folder / OVERRIDES
    # A machine that stalls for a second must not make the graph take it for the scan's end.
    gap = {"max_pose_gap_s": MAX_GAP_S, "idle_flush_s": 4.0}
    nodes = {"event_camera": camera, "ur10": robot, "emvs": gap, "stitcher": gap}
    overrides.write_text(json.dumps({n: {"ros__parameters": p} for n, p in nodes.items()}))
    arguments = {
        "robot_ip": LOOPBACK,
        "camera_info": f"file://{folder / 'camera.yaml'}",
        "params": str(overrides),
        "braille": "false",
    }
    path = scan.write_trajectory(folder / "path.npz")
    seen = watcher.seen
    with (
        ControllerProcess(
            trajectory=str(path), clock_ppm=ROBOT_PPM, clock_start_s=CONTROLLER_START_S
        ) as controller,
        load(ROOT / "launch" / "cell.launch.xml", arguments) as plan,
        Runner(plan) as runner,
    ):
        watcher.spin_until(
            lambda: (
                runner.poll() is not None
                or (
                    len(seen["/tf"]) > 250
                    and seen["/tf_static"]
                    and watcher.value(DEPTH, "waiting_events") >= 0
                    # Windows begin with the first event after the first pose that the node has.
                    and watcher.value(DEPTH, "poses") > 20
                    and watcher.value(STITCHED, "poses") > 20
                    and watcher.value(CAMERA, "connects") > 0
                    # A rate off by 50 ppm, as a busy host's first seconds give, is 2 µm of height.
                    and abs(watcher.value(ROBOT, "clock_skew_ppm") + ROBOT_PPM) < 20
                )
            ),
            90,
            "the graph",
        )
        assert runner.poll() is None, runner.exit_codes
        start_s = time.monotonic() + 0.5
        to_ros_ns = time.time_ns() - time.monotonic_ns()
        controller.send(f"start {start_s!r}")
        # Written elsewhere first: the camera reads the file as soon as it is there.
        (folder / "start.new").write_text(repr(start_s))
        (folder / "start.new").rename(folder / "start")
        watcher.spin_until(
            lambda: watcher.value(DEPTH, "events") == len(scan.events), 60, "all events"
        )
        # The last ends where the robot comes to rest: noise goes on for seconds.
        watcher.spin_until(lambda: watcher.value(DEPTH, "windows") == 3, 60, "all windows")
        watcher.spin_until(
            lambda: watcher.value(STITCHED, "depth_maps") == 3
            and watcher.value(STITCHED, "voxels_in_view") == 0
            and sum(m.width for m in seen[SURFACE]) == watcher.value(STITCHED, "points")
            and len(seen[ACCOUNTS]) == 3 + watcher.value(DEPTH, "refused_windows"),
            30,
            "the surface",
        )  # fmt: skip
        watcher.spin_until(
            lambda: seen[EVENTS][-1].seq + 1 == watcher.value(CAMERA, "packets_sent"),
            30, "the packets that the graph has long had",
        )  # fmt: skip
    for status in (CAMERA, ROBOT, DEPTH, STITCHED):
        for name in (
            "lost_packets", "dropped_events", "decode_errors", "packets_dropped", "late_events",
            "clock_steps", "left_out", "faults", "events_without_pose",
        ):  # fmt: skip
            assert watcher.value(status, name) in (0.0, -1.0), (status, name)
    # The robot goes on: what a busy machine held up counts less and less.
    watcher.spin_until(
        lambda: abs(watcher.value(ROBOT, "clock_skew_ppm") + ROBOT_PPM) < 20, 60, "the robot's rate"
    )
    cloud = np.concatenate(
        [np.frombuffer(m.data, np.float32).reshape(-1, 6) for m in seen[SURFACE]]
    )
    return Took(
        seen[EVENTS],
        [t for m in seen["/tf"] for t in m.transforms],
        cloud,
        round(start_s * 1e9) + to_ros_ns,
        round(controller.begin_s * 1e9) + to_ros_ns,
        [account_of(message) for message in seen[ACCOUNTS]],
        watcher.value(DEPTH, "clock_skew_ppm"),
    )


def decoded(packets: list[Any], scan: EmulatedScan) -> tuple[I64, I64, float]:
    """Of each packet's first event ROS time and sensor time, and the clock's skew, ppm."""
    stream = EventStream(scan.camera.width, scan.camera.height)
    events = [
        stream.push(
            m.encoding, m.width, m.height, m.seq, stamp_ns(m), m.time_base,
            m.events,
        )
        for m in packets
    ]  # fmt: skip
    mapped_ns = np.array([part.t_ns[0] for part in events])
    sensor_ns = np.array([m.time_base for m in packets])
    return mapped_ns, sensor_ns, stream.clock.skew * 1e6


def delay_of(mapped_ns: I64, true_ns: I64, begin_ns: int, what: str) -> int:
    """The constant by which stamps are late while the robot moves; it must be one.

    It is the least delay to the host, which no map between clocks can see and a cell
    calibrates.
    """
    moving = (true_ns > begin_ns + HOLD_S * 1e9) & (true_ns < begin_ns + (HOLD_S + 0.42) * 1e9)
    late = (mapped_ns - true_ns)[moving]
    delay = int(np.median(late))
    assert np.abs(late - delay).max() < 100_000, what
    return delay
