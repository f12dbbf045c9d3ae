"""A bag of an event camera that looks at a blinking grid of dots from many places."""

from pathlib import Path

import cv2
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.spatial.transform import Rotation

from recording.bags import CAMERA_INFO, EVENT_PACKET, TF_MESSAGE, write_messages
from roller_calibration.dot_grid import DotGrid
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.frame_names import BASE_FRAME, TOOL_FRAME
from roller_core.transforms import F64, inverse_pose, pose_matrix
from roller_sim.bag import BagMessages
from roller_sim.cell import Packet

START_NS = 1_700_000_000_000_000_000
SENSOR_NS = 5_000_000_000
VIEW_S, PAUSE_S, BLINK_S = 1.0, 1.0, 0.125
#: The same where an emulated robot shows the grid, which takes as long as it takes.
LIVE_VIEW_S, LIVE_PERIOD_S, LIVE_MARGIN_S = 0.6, 1.1, 0.1
GRID = DotGrid(4e-3)
#: The grid in base.
BASE_TARGET = pose_matrix([0.6, -0.2, 0.1], [0.0, 0.0, 0.0, 1.0])


def target_poses(count: int, tilt_deg: float, seed: int = 3) -> list[F64]:
    """The grid in the camera: before it, some 70 mm away, moved and tilted."""
    rng = np.random.default_rng(seed)
    middle = np.append(GRID.points_m[:, :2].mean(axis=0), 0.0)
    out = []
    for _ in range(count):
        turn = Rotation.from_rotvec(np.radians(rng.uniform(-tilt_deg, tilt_deg, 3)))
        place = np.array([*rng.uniform(-0.006, 0.006, 2), rng.uniform(0.075, 0.09)])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn.as_matrix(), place - turn.apply(middle)
        out.append(pose)
    return out


def dots_image(camera: Camera, pose: F64, blur_px: float = 1.0) -> F64:
    """How much of each pixel is dot, 0–1, shape (height, width)."""
    turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    ring = 0.2 * GRID.pitch_m * np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
    image = np.zeros((camera.height, camera.width), np.uint8)
    for dot in GRID.points_m.astype(float):
        edge = camera.project((dot + ring) @ pose[:3, :3].T + pose[:3, 3])
        cv2.fillPoly(image, [np.round(edge * 256).astype(np.int32)], 255, cv2.LINE_AA, 8)
    return cv2.GaussianBlur(image, (0, 0), blur_px) / 255.0


def view_events(
    camera: Camera, pose: F64, begin_ns: int, rng: np.random.Generator, view_s: float = VIEW_S
) -> EventArray:
    """Blinking dots for a while, with noise and a hot pixel."""
    share = dots_image(camera, pose)
    parts = []
    for k in range(round(view_s / BLINK_S)):
        v, u = np.nonzero(rng.random(share.shape) < share)
        t = begin_ns + int(k * BLINK_S * 1e9) + rng.integers(0, 2_000_000, len(u))
        parts.append((t, u, v, np.full(len(u), k % 2)))
    n = 2000
    noise = rng.integers(0, int(view_s * 1e9), 2 * n) + begin_ns
    u, v = rng.integers(0, camera.width, 2 * n), rng.integers(0, camera.height, 2 * n)
    u[:n], v[:n] = 17, 23
    parts.append((noise, u, v, rng.integers(0, 2, 2 * n)))
    t, u, v, p = (np.concatenate(column) for column in zip(*parts, strict=True))
    return EventArray(
        u.astype(np.uint16), v.astype(np.uint16), t, p.astype(np.uint8)
    ).sorted_by_time()


def write_grid_bag(
    path: Path, camera: Camera, poses: list[F64], hand_eye: F64 | None = None
) -> Path:
    """The bag; with `hand_eye` the camera's calibration and the robot's poses are in it."""
    make, rng = BagMessages(camera), np.random.default_rng(5)
    items = []
    if hand_eye is not None:
        items.append((START_NS - 1, "/event_camera/camera_info", CAMERA_INFO,
                      make.camera_info(START_NS)))  # fmt: skip
    for k, pose in enumerate(poses):
        begin = int(k * (VIEW_S + PAUSE_S) * 1e9)
        events = view_events(camera, pose, SENSOR_NS + begin, rng)
        edges = np.arange(0, int(VIEW_S * 1e9), 20_000_000) + SENSOR_NS + begin
        cuts = np.searchsorted(events.t_ns, [*edges, edges[-1] + 20_000_000])
        for n, (base, a, b) in enumerate(zip(edges.tolist(), cuts, cuts[1:], strict=False)):
            if b > a:
                stamp = START_NS + int(events.t_ns[a]) - SENSOR_NS
                packet = Packet(k * len(edges) + n, stamp, base, stamp, events[a:b])
                items.append((stamp, "/event_camera/events", EVENT_PACKET,
                              make.packet(packet, "libcaer_cmp")))  # fmt: skip
        if hand_eye is not None:
            tool = BASE_TARGET @ inverse_pose(pose) @ inverse_pose(hand_eye)
            quaternion = Rotation.from_matrix(tool[:3, :3]).as_quat()
            for t in range(
                begin - 60_000_000, begin + int(VIEW_S * 1e9) + 300_000_000, 300_000_000
            ):
                message = make.transform(
                    START_NS + t, BASE_FRAME, TOOL_FRAME, tool[:3, 3], quaternion
                )
                items.append((START_NS + t, "/tf", TF_MESSAGE, message))
    items.sort(key=lambda item: item[0])
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    write_messages(
        writer, ((t, n, k, bytes(make.store.serialize_cdr(m, k))) for t, n, k, m in items)
    )
    return path
