"""`make soak`: the cell's whole graph for as long as asked, while faults are injected.

Emulated camera and robot repeat one simulated scan, with a quiet stretch after each. In a quiet
stretch everything that was sent has been taken or lost, so packets can be accounted for: what the
camera's node sent since the last such moment must have been taken, or be counted as lost, left
out or foreign, by each node that was there all the time.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import TransformStamped
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from driver.emulation.controller_process import ControllerProcess
from driver.emulation.scan import EmulatedScan
from graph.graph_world import Processes, Watcher
from own import LOOPBACK, ros_domain
from roller_core.output_folder import OutputFolder
from roller_ros import topics
from roller_sim.motion import HAND_EYE_M, HAND_EYE_ROTATION_RAD

from .looped_camera import VARIABLE

NODES = ("event_camera", "ur10", "emvs", "stitcher", "braille", "recorder")
STATUS = {
    "event_camera": "event_camera: camera", "ur10": "ur10: robot", "emvs": "emvs: depth",
    "stitcher": "stitcher: surface", "braille": "braille: text", "recorder": "recorder: recording",
}  # fmt: skip
#: What of a node's status grows while it works.
WORK = {
    "event_camera": "packets_sent", "ur10": "published", "emvs": "windows", "stitcher": "points",
    "braille": "batches", "recorder": "events",
}  # fmt: skip
CONSUMERS = ("emvs", "braille", "recorder")
EVENTS = "/event_camera/events"
SPEED_M_S = 0.1
#: The robot's way back, the quiet after it, and how long after the scan all must be taken, s.
BACK_S, QUIET_S, SETTLED_S = 1.5, 3.5, 1.5
#: Longest time until all work again after a fault is over, s.
RECOVERY_S = 120.0
#: Memory is looked at from so long after a process's start, over at least so long, s.
WARM_S, LEAST_S = 120.0, 120.0


@dataclass
class Instance:
    """A process of a node, and samples of it: time s, memory MB, handles."""

    name: str
    pid: int
    begin_s: float
    samples: list[tuple[float, float, int]] = field(default_factory=list)


@dataclass
class Ledger:
    """What a consumer took and missed of what one process of the camera's node sent."""

    pair: tuple[int, int]
    sent: float
    taken: float
    missed: float
    #: Since the begin of the ledger.
    accounted: int = 0
    uncounted: int = 0
    counted: int = 0


class Eyes(Watcher):
    """Keeps the newest status of each node, with its arrival."""

    def __init__(self) -> None:
        self.newest: dict[str, tuple[float, dict[str, str], str]] = {}
        super().__init__(())

    def _diagnose(self, message: Any) -> None:
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            if values:
                self.newest[status.name] = time.monotonic(), values, status.message

    def figure(self, node: str, key: str, since_s: float = 0.0) -> float | None:
        """A figure of a node's newest status; None if there is none that is newer."""
        at_s, values, _ = self.newest.get(STATUS[node], (0.0, {}, ""))
        text = values.get(key, "")
        return float(text) if at_s > since_s and text else None


class Soak:
    """The graph, the faults and the account."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder, self.random, self.failed = folder, random.Random(seed), ""
        self.eyes = Eyes()
        self.processes = Processes(folder)
        self.instances: list[Instance] = []
        self.alive: dict[str, Instance] = {}
        self.rows: list[dict[str, Any]] = []
        self.latencies: list[float] = []
        self.ledgers: dict[str, Ledger] = {}
        self.closed: list[Ledger] = []
        self.bags = 0
        self._context = Context()
        rclpy.init(context=self._context)
        self.stranger = Node("stranger", context=self._context)
        self._publishers = {
            t.path: self.stranger.create_publisher(t.type, t.path, t.qos)
            for t in topics.ALL
            if t.type in (EventPacket, CameraInfo, TFMessage, Image)
        }

    def prepare(self) -> None:
        """Simulate the scan; everything that the nodes are started with."""
        scan = EmulatedScan.simulate(
            scene={"name": "demo"}, motion={"speed": SPEED_M_S}, clock={"drift_ppm": 0.0}
        )
        # As much as a busy scan has, on a machine that does all of it.
        scan = replace(scan, events=scan.events[::3])
        self.scan_s = scan.duration_s
        self.period_s = round(self.scan_s + BACK_S + QUIET_S, 3)
        motion = scan.cell.settings.motion
        self.length_m = abs(motion.end_mm - motion.start_mm) * 1e-3
        pace = scan.write_words(self.folder / "words.u4")
        self.trajectory = scan.write_trajectory(self.folder / "path.npz")
        with np.load(self.trajectory) as data:
            t_s, pose = data["t_s"], data["pose"]
        back = np.array([t_s[-1] + BACK_S, self.period_s])
        np.savez(
            self.trajectory, t_s=np.append(t_s, back), pose=np.vstack([pose, pose[0], pose[0]])
        )
        scan.camera.to_yaml(self.folder / "camera.yaml")
        os.environ[VARIABLE] = json.dumps(
            {
                "words": str(self.folder / "words.u4"),
                "start_file": str(self.folder / "start"),
                "folder": str(self.folder),
                "period_s": self.period_s,
                **pace,
            }
        )
        self.parameters = {
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

    def start(self, name: str, **more: object) -> None:
        """Start a node, or start it again."""
        values: dict[str, Any] = {**self.parameters.get(name, {}), **more}
        if name == "recorder" and not more:
            shutil.rmtree(self.folder / f"bag_{self.bags}", ignore_errors=True)
            self.bags += 1
            values |= {"output": str(self.folder / f"bag_{self.bags}"), "raw": True}
        self.processes.start(name, json.dumps(values) if values else "")
        instance = Instance(name, self.processes.running[name].pid, time.monotonic())
        self.alive[name] = instance
        self.instances.append(instance)

    def begin(self) -> None:
        """Let camera and robot begin."""
        self.begin_s = time.monotonic() + 2.0
        (self.folder / "start").write_text(repr(self.begin_s))
        self.controller.send(f"start {self.begin_s!r}")
        self._sampled_s = self._settled = 0

    @property
    def rolled_m(self) -> float:
        """How far the robot has rolled."""
        return self.length_m * max(0.0, (time.monotonic() - self.begin_s) / self.period_s)

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
            if loop != self._settled and phase > self.period_s - 0.4:
                self._settled = loop
                self._account(now - phase + self.scan_s + SETTLED_S)
            if until():
                return True
        return False

    def _sample(self, now: float) -> None:
        for instance in self.alive.values():
            try:
                pages = int(Path(f"/proc/{instance.pid}/statm").read_text().split()[1])
                handles = len(os.listdir(f"/proc/{instance.pid}/fd"))
            except OSError:
                continue
            megabytes = pages * os.sysconf("SC_PAGE_SIZE") / 1e6
            instance.samples.append((now, megabytes, handles))
        if (late := self.eyes.figure("emvs", "window_latency_s", now - 5.0)) is not None:
            self.latencies.append(late)

    def _account(self, since_s: float) -> None:
        """Hold what each consumer took and missed against what was sent; all is quiet."""
        sent = self.eyes.figure("event_camera", "packets_sent", since_s)
        for name in CONSUMERS:
            keys = (
                ("packets", "lost_packets", "left_out_packets", "foreign_packets")
                if name != "recorder"
                else (EVENTS, "lost_packets", "lost_messages")
            )
            figures = [self.eyes.figure(name, key, since_s) for key in keys]
            waiting = self.eyes.figure(name, "waiting_messages", since_s)
            if name != "recorder" and self.eyes.figure(name, "waiting_events", since_s) is None:
                continue  # packets wait for the calibration
            if sent is None or waiting != 0 or None in figures:
                continue
            taken, missed = sum(figures), sum(figures[1:])  # type: ignore[arg-type]  # no None
            pair = self.alive["event_camera"].pid, self.alive[name].pid
            ledger = self.ledgers.get(name)
            if ledger is None or ledger.pair != pair:
                self.close_ledger(name)
                ledger = self.ledgers[name] = Ledger(pair, sent, taken, missed)
            ledger.accounted = int(sent - ledger.sent)
            # What was lost last is noticed with the next packet, so the last look counts.
            ledger.uncounted = max(0, ledger.accounted - int(taken - ledger.taken))
            ledger.counted = int(missed - ledger.missed)

    def close_ledger(self, name: str) -> None:
        """The account with a process of the camera's node, or of a consumer, is over."""
        if (ledger := self.ledgers.pop(name, None)) is not None:
            self.closed.append(ledger)

    def _work(self) -> dict[str, float]:
        return {n: self.eyes.figure(n, WORK[n]) or 0.0 for n in NODES}

    def gone(self) -> list[str]:
        """Nodes whose processes have ended."""
        return [n for n in NODES if self.processes.running[n].poll() is not None]

    def working(self) -> bool:
        """Whether every node does its work, or one is gone, which won't get better."""
        if self.gone():
            return True
        now = time.monotonic()
        fresh = {n: self.eyes.figure(n, WORK[n], now - 3.0) for n in NODES}
        for name, value in fresh.items():
            if value is None or value <= self._before.get(name, 0.0):
                return False
        return True

    def inject(self, what: str, fault: Callable[[], str | None]) -> None:
        """Inject a fault, wait until all works again, and note what came of it."""
        begin = time.monotonic()
        self.failed = ""
        row: dict[str, Any] = {"at_s": round(begin - self.begin_s), "fault": what}
        reason = fault()
        if reason is not None:
            self.rows.append(row | {"outcome": "skipped", "recovery_s": None, "said": reason})
            return
        over = time.monotonic()
        self._before = {n: v for n, v in self._work().items() if self.alive[n].begin_s < begin}
        recovered = self.run(RECOVERY_S, self.working)
        gone = self.gone()
        bad = gone or ([] if recovered else [
            n for n, v in self._work().items() if v <= self._before.get(n, 0.0)
        ])  # fmt: skip
        said = [self.failed] if self.failed else []
        said += [f"{n}: {self.eyes.newest.get(STATUS[n], (0, {}, '-'))[2]}" for n in bad]
        self.rows.append(
            row | {
                "outcome": "survived" if not said else "ended" if gone else "stuck",
                "recovery_s": round(time.monotonic() - over, 1),
                "said": "; ".join(said),
            }
        )  # fmt: skip
        print(self.rows[-1], flush=True)
        for name in bad:
            self.end(name, signal.SIGKILL)
            self.start(name)

    def end(self, name: str, number: signal.Signals) -> None:
        """End a node's process."""
        process = self.processes.running[name]
        if process.poll() is None:
            process.send_signal(number)
        process.wait(timeout=60)

    # Faults; each returns None once it is over, or why it can't be made here.

    def kill(self, name: str) -> None:
        self.end(name, signal.SIGKILL)
        self.run(2.0)
        self.start(name)

    def stop(self, name: str, seconds: float) -> None:
        process = self.processes.running[name]
        process.send_signal(signal.SIGSTOP)
        self.run(seconds)
        process.send_signal(signal.SIGCONT)

    def garbage(self, path: str) -> None:
        """A second publisher of a topic: nonsense, and what could be true."""
        publisher = self._publishers[path]
        for _ in range(100):
            publisher.publish(self._nonsense(publisher.msg_type))
            self.run(0.02)
        for name in CONSUMERS:
            self.close_ledger(name)  # its packets are among those taken

    def _nonsense(self, kind: type) -> Any:
        some = self.random
        number = some.choice([0, 1, 2**31, 2**32 - 1])
        if kind is EventPacket:
            message = EventPacket(
                encoding=some.choice(["mono", "libcaer", "libcaer_cmp", "evt3", "trigger", "x"]),
                width=some.choice([640, number]), height=some.choice([480, number]),
                seq=some.choice([0, 2**63, 2**64 - 1]), time_base=some.choice([0, 2**64 - 1]),
            )  # fmt: skip
            message.events.frombytes(some.randbytes(some.choice([0, 7, 4096])))
            return message
        if kind is CameraInfo:
            return CameraInfo(width=number, height=number, k=[some.choice([0.0, np.nan])] * 9)
        if kind is Image:
            return Image(
                encoding=some.choice(["32FC1", "?"]), width=number, height=3, step=number,
                data=some.randbytes(64),
            )  # fmt: skip
        item = TransformStamped(child_frame_id=some.choice(["tool0_controller", "a b", ""]))
        item.header.frame_id = "base"
        item.header.stamp.sec = some.choice([0, 2**31 - 1, int(time.time())])
        item.transform.translation.x = some.choice([0.0, np.nan, np.inf, 1e300])
        item.transform.rotation.w = some.choice([0.0, 1.0, np.nan])
        return TFMessage(transforms=[item])

    def step_robot_clock(self) -> None:
        self.controller.send("step_back 5.0")
        self.run(1.0)

    def step_camera_clock(self) -> None:
        (self.folder / "step").write_text("60000")
        self.run(1.0)

    def unplug(self) -> None:
        (self.folder / "unplugged").touch()
        self.run(3.0)
        (self.folder / "unplugged").unlink()

    def protective_stop(self) -> None:
        self.controller.send("protective_stop")
        self.run(4.0)
        self.controller.send("normal")

    def disconnect(self) -> None:
        self.controller.send("disconnect")
        self.run(1.0)

    def full_disk(self) -> str | None:
        """The recorder on a disk that gets full; then on another."""
        disk = self.folder / "small_disk"
        disk.mkdir(exist_ok=True)
        mount = ["mount", "-t", "tmpfs", "-o", "size=12m", "tmpfs", str(disk)]
        if subprocess.run(mount, capture_output=True).returncode:
            return "no right to mount a tmpfs"
        try:
            self.end("recorder", signal.SIGINT)
            self.start("recorder", output=str(disk / "bag"), raw=True, keep_free_mb=1.0)
            full = self.run(60.0, lambda: "full" in self.eyes.newest[STATUS["recorder"]][2])
            code = self.processes.running["recorder"].poll()
            self.end("recorder", signal.SIGINT)
            if not full or code is not None:
                self.failed = f"the disk was full: said so: {full}, exit code {code}"
        finally:
            subprocess.run(["umount", "-l", str(disk)], check=False)
        self.start("recorder")
        return None

    def full_shared_memory(self) -> str | None:
        """No room in /dev/shm, in which a node begins."""
        if not os.environ.get(OWN_SHM):
            return "/dev/shm is the machine's, there was no right to mount another"
        with open("/dev/shm/soak", "wb") as file:
            free = shutil.disk_usage("/dev/shm").free
            os.posix_fallocate(file.fileno(), 0, max(free - 4096, 1))
        try:
            self.kill("emvs")
            self.run(10.0)
        finally:
            os.unlink("/dev/shm/soak")
        return None

    def flood_of_faults(self) -> str | None:
        """Thousands of faults a second: the log must not follow."""
        logs = [self.folder / f"{name}.log" for name in NODES]
        before = sum(log.stat().st_size for log in logs)
        publisher = self._publishers["/tf"]
        for _ in range(200):
            for _ in range(50):
                publisher.publish(self._nonsense(TFMessage))
            self.run(0.02)
        grown = sum(log.stat().st_size for log in logs) - before
        print(f"flood: logs grew by {grown / 1e3:.0f} kB", flush=True)
        return None

    def faults(self) -> Iterator[tuple[str, Callable[[], str | None]]]:
        """All faults in an order of chance, over and over."""
        every: list[tuple[str, Callable[[], str | None]]] = []
        for n in NODES:
            every.append((f"kill {n}", lambda n=n: self.kill(n)))  # type: ignore[misc]
        for n in NODES:
            every.append((f"stop {n} 5 s", lambda n=n: self.stop(n, 5.0)))  # type: ignore[misc]
        for path in self._publishers:
            every.append((f"garbage on {path}", lambda p=path: self.garbage(p)))  # type: ignore[misc]
        every += [
            ("clock of the robot 5 s back", self.step_robot_clock),
            ("clock of the camera 60 s on", self.step_camera_clock),
            ("clock of the machine", lambda: "it is everybody's"),
            ("camera unplugged", self.unplug),
            ("protective stop", self.protective_stop),
            ("robot disconnects", self.disconnect),
            ("full disk", self.full_disk),
            ("full /dev/shm", self.full_shared_memory),
            ("flood of faults", self.flood_of_faults),
        ]
        while True:
            name = self.random.choice(NODES)
            more = [(f"stop {name} 30 s", lambda n=name: self.stop(n, 30.0))]  # type: ignore[misc]
            order = [*every, *more]
            self.random.shuffle(order)
            yield from order

    def close(self) -> None:
        """Leave nothing running."""
        for process in self.processes.running.values():
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
        self.processes.stop()
        self.eyes.close()
        self.stranger.destroy_node()
        self._context.try_shutdown()


#: Set where /dev/shm is this run's own.
OWN_SHM = "SOAK_OWN_SHM"


def growth(instance: Instance) -> tuple[float, float] | None:
    """Memory, MB, and handles that a process grew by a minute once it was warm."""
    warm = [s for s in instance.samples if s[0] - instance.begin_s > WARM_S]
    if not warm or warm[-1][0] - warm[0][0] < LEAST_S:
        return None
    minutes = [(s[0] - warm[0][0]) / 60 for s in warm]
    return tuple(float(np.polyfit(minutes, [s[k] for s in warm], 1)[0]) for k in (1, 2))  # type: ignore[return-value]


def table(soak: Soak, seconds: float, seed: int) -> tuple[str, dict[str, Any]]:
    """The account, as a page and as data."""
    done = [r for r in soak.rows if r["outcome"] != "skipped"]
    survived = sum(r["outcome"] == "survived" for r in done)
    late = sorted(soak.latencies)
    ledgers = [*soak.closed, *soak.ledgers.values()]
    figures: dict[str, Any] = {
        "minutes": round(seconds / 60, 1),
        "seed": seed,
        "metres rolled": round(soak.rolled_m, 1),
        "faults injected": len(done),
        "survived": survived,
        "skipped": len(soak.rows) - len(done),
        "packets accounted for": sum(ledger.accounted for ledger in ledgers),
        "lost and counted": sum(ledger.counted for ledger in ledgers),
        "lost and not counted": sum(ledger.uncounted for ledger in ledgers),
        "latency, median s": round(statistics.median(late), 2) if late else None,
        "latency, 95 % s": round(late[int(0.95 * (len(late) - 1))], 2) if late else None,
    }
    nodes = {}
    for name in NODES:
        own = [i for i in soak.instances if i.name == name]
        grown = [(i.samples[-1][0] - i.begin_s, g) for i in own if (g := growth(i)) is not None]
        slopes = max(grown)[1] if grown else (None, None)
        most = max((s[1] for i in own for s in i.samples), default=0.0)
        nodes[name] = {
            "processes": len(own),
            "most MB": round(most),
            "MB a minute": None if slopes[0] is None else round(slopes[0], 2),
            "handles a minute": None if slopes[1] is None else round(slopes[1], 2),
        }
    lines = ["# Soak", "", "| | |", "|---|---|"]
    lines += [f"| {k} | {'–' if v is None else v} |" for k, v in figures.items()]
    lines += ["", "| node | " + " | ".join(next(iter(nodes.values()))) + " |", "|---" * 5 + "|"]
    lines += [
        f"| {n} | " + " | ".join("–" if v is None else str(v) for v in values.values()) + " |"
        for n, values in nodes.items()
    ]
    lines += ["", "| at, s | fault | outcome | works again after, s | |", "|---" * 5 + "|"]
    lines += [
        f"| {r['at_s']} | {r['fault']} | {r['outcome']} | {r['recovery_s'] or '–'} | {r['said']} |"
        for r in soak.rows
    ]
    return "\n".join(lines) + "\n", {"totals": figures, "nodes": nodes, "faults": soak.rows}


def main() -> int:
    """Run it; 0 if all faults were survived and nothing was lost uncounted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--calm", action="store_true", help="no faults: what an hour grows by")
    parser.add_argument("--output", type=Path, default=Path("output/soak"))
    args = parser.parse_args()
    os.environ["ROLLER_TRACEBACK"] = "1"
    with ExitStack() as stack:
        output = stack.enter_context(OutputFolder(args.output, "soak"))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="roller_soak_")))
        os.environ["ROS_DOMAIN_ID"] = str(stack.enter_context(ros_domain()))
        soak = Soak(folder, args.seed)
        stack.callback(soak.close)
        soak.prepare()
        soak.controller = stack.enter_context(
            ControllerProcess(trajectory=str(soak.trajectory), period_s=soak.period_s)
        )
        begin = time.monotonic()
        soak.begin()
        for name in NODES:
            soak.start(name)
        soak._before = {}
        if not soak.run(180.0, soak.working) or soak.gone():
            print(f"the graph does not work: {soak._work()}, {soak.gone()}", file=sys.stderr)
            for name in soak.gone():
                print(soak.processes.log(name), file=sys.stderr)
            return 1
        soak.run(20.0)
        end = begin + args.minutes * 60
        if args.calm:
            soak.run(end - time.monotonic())
        for what, fault in soak.faults():
            if time.monotonic() > end:
                break
            soak.inject(what, fault)
            soak.run(soak.random.uniform(0.0, soak.period_s))
        soak.run(2 * soak.period_s)
        page, data = table(soak, time.monotonic() - begin, args.seed)
        (output.partial / "soak.md").write_text(page)
        (output.partial / "soak.json").write_text(json.dumps(data, indent=1) + "\n")
        for name in NODES:
            shutil.copy(folder / f"{name}.log", output.partial)
        print(page)
        totals = data["totals"]
        bad = (
            totals["faults injected"] - totals["survived"]
            or totals["lost and not counted"]
            or soak.gone()
        )
    return 1 if bad else 0


def own_shared_memory() -> None:
    """Go on with a /dev/shm of one's own, where that may be had: filling it harms nobody."""
    if OWN_SHM in os.environ or not shutil.which("unshare"):
        return
    script = 'mount -t tmpfs -o size=1g tmpfs /dev/shm && exec env SOAK_OWN_SHM=1 "$@"'
    words = ["unshare", "--mount", "sh", "-c", script, "sh"]
    if subprocess.run([*words, "true"], capture_output=True).returncode == 0:
        os.execvp("unshare", [*words, sys.executable, "-m", "soak.soak", *sys.argv[1:]])


if __name__ == "__main__":
    own_shared_memory()
    sys.exit(main())
