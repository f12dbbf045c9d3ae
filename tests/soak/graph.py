"""The cell's graph over an emulated camera and robot that repeat one scan, and what it says."""

import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray

from driver.emulation.controller_process import ControllerProcess
from driver.emulation.scan import EmulatedScan
from graph.graph_world import Processes, Watcher
from own import LOOPBACK
from roller_core.events import EventArray
from roller_ros.sources import publisher_of
from roller_sim.motion import HAND_EYE_M, HAND_EYE_ROTATION_RAD

from .ledger import Flow, Ledger, Status, Statuses
from .looped_camera import VARIABLE

EVENTS = "/event_camera/events"
#: Of each node its status, and what of that grows while it works.
NODES = {
    "event_camera": ("event_camera: camera", "packets_sent"),
    "ur10": ("ur10: robot", "published"),
    "emvs": ("emvs: depth", "windows"),
    "stitcher": ("stitcher: surface", "points"),
    "braille": ("braille: text", "batches"),
    "recorder": ("recorder: recording", "events"),
    "inspect": ("inspect: findings", "points"),
}
#: The operator's page runs beside them. It says nothing; its memory is looked at.
PAGE = "view"
STATUS = {node: status for node, (status, _) in NODES.items()}
_STREAM = {"lost_packets": 1.0, "left_out_packets": 1.0, "foreign_packets": 1.0}
_SENT = (EVENTS, "event_camera", "packets_sent")
FLOWS = (
    Flow(*_SENT, "emvs", "packets", _STREAM, (), ("waiting_events",), "waiting_packets"),
    Flow(*_SENT, "braille", "packets", _STREAM, (), ("waiting_events",), "waiting_packets"),
    Flow(*_SENT, "recorder", EVENTS, {"lost_packets": 1.0, "lost_messages": 1.0},
         ("waiting_messages",)),
    # A depth map is four messages.
    Flow("/roller/depth", "emvs", "windows", "stitcher", "depth_maps",
         {"left_out": 1.0, "dropped_messages": 0.25, "foreign_results": 0.25},
         ("waiting_messages", "waiting_maps")),
)  # fmt: skip
CONSUMERS = tuple(dict.fromkeys(flow.consumer for flow in FLOWS))
#: The robot's way back, single events after it by which what was lost last is noticed, and how
#: long after the scan all must be taken, s; then there are two statuses more.
BACK_S, LATE_S, SETTLED_S, QUIET_S = 1.5, 0.6, 2.4, 3.5


@dataclass
class Instance:
    """A process of a node, and samples of it: time s, memory MB, handles."""

    name: str
    pid: int
    begin_s: float
    samples: list[tuple[float, float, int]] = field(default_factory=list)

    def sample(self, now_s: float) -> None:
        """Look at it, if it is there."""
        try:
            pages = int(Path(f"/proc/{self.pid}/statm").read_text().split()[1])
            handles = len(os.listdir(f"/proc/{self.pid}/fd"))
        except OSError:
            return
        self.samples.append((now_s, pages * os.sysconf("SC_PAGE_SIZE") / 1e6, handles))


class Eyes(Watcher):
    """Keeps the newest statuses of the nodes, by who sent them."""

    def __init__(self) -> None:
        self.kept = Statuses()
        self._nodes = {status: node for node, status in STATUS.items()}
        super().__init__(())

    def _diagnose(self, message: DiagnosticArray, info: Mapping[str, Any]) -> None:
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            if values and status.name in self._nodes:
                sender = publisher_of(info) or b""
                kept = Status(sender, time.monotonic(), values, status.message)
                self.kept.take(self._nodes[status.name], kept)

    def said(self, node: str) -> str:
        """The message of a node's newest status."""
        status = self.kept.newest(node)
        return "-" if status is None else status.message


class Graph:
    """The nodes' processes, what they are fed with, and the account of what they take.

    Parameters
    ----------
    folder : Path
        For all that they read and write.
    speed_m_s : float
        Of rolling.
    one_of : int
        One of so many simulated events is sent, for a machine that does all of it.
    """

    def __init__(self, folder: Path, speed_m_s: float, one_of: int) -> None:
        self.folder = folder
        self.eyes, self.ledger = Eyes(), Ledger(FLOWS)
        self.processes = Processes(folder, fresh=True)
        self.instances: list[Instance] = []
        self.alive: dict[str, Instance] = {}
        self.latencies: list[float] = []
        self._bags = 0
        self._told: set[str] = set()
        self._prepare(speed_m_s, one_of)
        self.controller = ControllerProcess(
            trajectory=str(folder / "path.npz"), period_s=self.period_s
        )

    def _prepare(self, speed_m_s: float, one_of: int) -> None:
        scan = EmulatedScan.simulate(
            scene={"name": "demo"}, motion={"speed": speed_m_s}, clock={"drift_ppm": 0.0}
        )
        self.scan_s = scan.duration_s
        self.period_s = round(self.scan_s + BACK_S + QUIET_S, 3)
        motion = scan.cell.settings.motion
        self._length_m = abs(motion.end_mm - motion.start_mm) * 1e-3
        late_ns = np.linspace(BACK_S + 0.1, BACK_S + LATE_S, 10) * 1e9 + scan.events.t_ns[-1]
        late = EventArray.from_arrays(
            np.full(10, 320), np.full(10, 240), late_ns.astype(np.int64), np.arange(10) % 2
        )
        events = EventArray.concatenate([scan.events[::one_of], late])
        pace = replace(scan, events=events).write_words(self.folder / "words.u4")
        with np.load(scan.write_trajectory(self.folder / "path.npz")) as data:
            t_s, pose = data["t_s"], data["pose"]
        t_s = np.append(t_s, [t_s[-1] + BACK_S, self.period_s])
        np.savez(self.folder / "path.npz", t_s=t_s, pose=np.vstack([pose, pose[0], pose[0]]))
        scan.camera.to_yaml(self.folder / "camera.yaml")
        words = {
            "words": str(self.folder / "words.u4"),
            "start_file": str(self.folder / "start"),
            "folder": str(self.folder),
            "period_s": self.period_s,
        }
        os.environ[VARIABLE] = json.dumps(words | pace)
        self._parameters = {
            "event_camera": {
                "backend": "soak.looped_camera:from_environment",
                "camerainfo_url": str(self.folder / "camera.yaml"),
                "event_message_time_threshold": 0.004,
            },
            "ur10": {
                "robot_ip": LOOPBACK,
                "hand_eye_m": HAND_EYE_M,
                "hand_eye_rotation_rad": HAND_EYE_ROTATION_RAD,
            },
        }

    def begin(self) -> None:
        """Let camera and robot begin, and start all nodes."""
        self.controller.start(trajectory=str(self.folder / "path.npz"), period_s=self.period_s)
        self.begin_s = time.monotonic() + 2.0
        (self.folder / "start").write_text(repr(self.begin_s))
        self.controller.send(f"start {self.begin_s!r}")
        self._sampled_s, self._looked = 0.0, -1.0
        for name in NODES:
            self.start(name)
        self.start(PAGE)

    @property
    def rolled_m(self) -> float:
        """How far the robot has rolled."""
        return self._length_m * max(0.0, (time.monotonic() - self.begin_s) / self.period_s)

    def start(self, name: str, **more: object) -> None:
        """Start a node, or start it again."""
        values: dict[str, Any] = {**self._parameters.get(name, {}), **more}
        if name == "recorder" and not more:
            shutil.rmtree(self.folder / f"bag_{self._bags}", ignore_errors=True)
            self._bags += 1
            values |= {"output": str(self.folder / f"bag_{self._bags}"), "raw": True}
        if name == PAGE:
            self.processes.run(
                PAGE, [sys.executable, "-m", "roller_bringup.cli", "view", "--port", "0"]
            )
        else:
            self.processes.start(name, json.dumps(values) if values else "")
        instance = Instance(name, self.processes.running[name].pid, time.monotonic())
        self.alive[name] = instance
        self.instances.append(instance)

    def end(self, name: str, number: signal.Signals) -> None:
        """End a node's process."""
        process = self.processes.running[name]
        if process.poll() is None:
            process.send_signal(number)
        process.wait(timeout=60)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Watch for a while, or until something holds; whether it does."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.eyes.spin(0.1)
            now = time.monotonic()
            if now - self._sampled_s > 5.0:
                self._sampled_s = now
                self._sample(now)
            loop, phase = divmod(now - self.begin_s, self.period_s)
            if loop != self._looked and phase > self.period_s - 0.3:
                self._looked = loop
                self.ledger.look(self.eyes.kept, now - phase + self.scan_s + SETTLED_S)
                self._tell()
            if until():
                return True
        return False

    def _tell(self) -> None:
        """Say once of each account that it went wrong."""
        for account in self.ledger.accounts:
            if account.uncounted and (text := str(account)) not in self._told:
                self._told.add(text)
                print(f"{time.monotonic() - self.begin_s:.0f} s: {text}", flush=True)

    def _sample(self, now: float) -> None:
        for instance in self.alive.values():
            instance.sample(now)
        late = self.eyes.kept.figure("emvs", "window_latency_s", now - 5.0)
        if late is not None:
            self.latencies.append(late)

    def work(self, since_s: float = 0.0) -> dict[str, float | None]:
        """What each node has done, by its newest status."""
        return {n: self.eyes.kept.figure(n, NODES[n][1], since_s) for n in NODES}

    def log(self, name: str) -> str:
        """What a node printed."""
        return self.processes.log(name)

    def gone(self) -> list[str]:
        """Nodes whose processes have ended."""
        return [n for n in (*NODES, PAGE) if self.processes.running[n].poll() is not None]

    def idle(self, before: Mapping[str, float | None], since_s: float = 0.0) -> list[str]:
        """Nodes that have done no more than before, or have said nothing since a time."""
        now = self.work(since_s)
        return [n for n, v in now.items() if v is None or v <= (before.get(n) or 0.0)]

    def close(self) -> None:
        """Leave nothing running."""
        for process in self.processes.running.values():
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
        self.processes.stop()
        self.controller.stop()
        self.eyes.close()
