"""Faults that the graph must survive, in an order of chance."""

import os
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import rclpy
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import TransformStamped
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from roller_ros import topics

from .graph import CONSUMERS, NODES, Graph

#: Set where /dev/shm is this run's own.
OWN_SHM = "SOAK_OWN_SHM"

Fault = Callable[[], str | None]


class Faults:
    """Gives names and functions, over and over.

    A function returns None once its fault is over, or why it can't be made here.

    Parameters
    ----------
    graph : Graph
        Suffers them.
    chance : random.Random
        Says their order.
    """

    def __init__(self, graph: Graph, chance: random.Random) -> None:
        self.graph, self.random = graph, chance
        #: What a fault saw go wrong; empty: nothing.
        self.failed = ""
        self._context = Context()
        rclpy.init(context=self._context)
        self._stranger = Node("stranger", context=self._context)
        self._publishers = {
            t.path: self._stranger.create_publisher(t.type, t.path, t.qos)
            for t in topics.ALL
            if t.type in (EventPacket, CameraInfo, TFMessage, Image)
        }

    def close(self) -> None:
        """Leave the graph."""
        self._stranger.destroy_node()
        self._context.try_shutdown()

    def kill(self, name: str) -> None:
        self.graph.end(name, signal.SIGKILL)
        self.graph.run(2.0)
        self.graph.start(name)

    def stop(self, name: str, seconds: float) -> None:
        process = self.graph.processes.running[name]
        process.send_signal(signal.SIGSTOP)
        self.graph.run(seconds)
        process.send_signal(signal.SIGCONT)

    def garbage(self, path: str) -> None:
        """A second publisher of a topic: nonsense, and what could be true."""
        publisher = self._publishers[path]
        for _ in range(100):
            publisher.publish(self._nonsense(publisher.msg_type))
            self.graph.run(0.02)
        self.graph.ledger.close(*CONSUMERS)  # its messages are among those taken

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
        self.graph.controller.send("step_back 5.0")
        self.graph.run(1.0)

    def step_camera_clock(self) -> None:
        (self.graph.folder / "step").write_text("60000")
        self.graph.run(1.0)

    def unplug(self) -> None:
        (self.graph.folder / "unplugged").touch()
        self.graph.run(3.0)
        (self.graph.folder / "unplugged").unlink()

    def protective_stop(self) -> None:
        self.graph.controller.send("protective_stop")
        self.graph.run(4.0)
        self.graph.controller.send("normal")

    def disconnect(self) -> None:
        self.graph.controller.send("disconnect")
        self.graph.run(1.0)

    def full_disk(self) -> str | None:
        """The recorder on a disk that gets full; then on another."""
        disk = self.graph.folder / "small_disk"
        disk.mkdir(exist_ok=True)
        mount = ["mount", "-t", "tmpfs", "-o", "size=12m", "tmpfs", str(disk)]
        if subprocess.run(mount, capture_output=True).returncode:
            return "no right to mount a tmpfs"
        try:
            self.graph.end("recorder", signal.SIGINT)
            self.graph.start("recorder", output=str(disk / "bag"), raw=True, keep_free_mb=1.0)
            # In a burst a chunk may be larger than what was to be kept free.
            words = ("full", "No space left")
            full = self.graph.run(
                60.0, lambda: any(w in self.graph.eyes.said("recorder") for w in words)
            )
            code = self.graph.processes.running["recorder"].poll()
            self.graph.end("recorder", signal.SIGINT)
            if not full or code is not None:
                self.failed = f"the disk was full: said so: {full}, exit code {code}"
        finally:
            subprocess.run(["umount", "-l", str(disk)], check=False)
        self.graph.start("recorder")
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
            self.graph.run(10.0)
        finally:
            os.unlink("/dev/shm/soak")
        return None

    def flood_of_faults(self) -> str | None:
        """Thousands of faults a second: the log must not follow."""
        logs = [self.graph.folder / f"{name}.log" for name in NODES]
        before = sum(log.stat().st_size for log in logs)
        publisher = self._publishers["/tf"]
        for _ in range(200):
            for _ in range(50):
                publisher.publish(self._nonsense(TFMessage))
            self.graph.run(0.02)
        grown = sum(log.stat().st_size for log in logs) - before
        print(f"flood: logs grew by {grown / 1e3:.0f} kB", flush=True)
        return None

    def __iter__(self) -> Iterator[tuple[str, Fault]]:
        """All faults in an order of chance, over and over."""
        every: list[tuple[str, Fault]] = []
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
            name = self.random.choice(list(NODES))
            more = [(f"stop {name} 30 s", lambda n=name: self.stop(n, 30.0))]  # type: ignore[misc]
            order = [*every, *more]
            self.random.shuffle(order)
            yield from order
