"""A graph of separate processes and a node that watches it."""

import re
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from graph.forked import ForkedProcess
from roller_ros import qos, topics

#: Modules of the nodes by name.
MODULES = {
    "emvs": "roller_emvs.emvs_node",
    "stitcher": "roller_emvs.stitcher_node",
    "surface": "roller_emvs.surface_node",
    "braille": "roller_braille.braille_node",
    "inspect": "roller_inspect.inspect_node",
    "player": "roller_recording.player_node",
    "recorder": "roller_recording.recorder_node",
    "virtual_cell": "roller_sim.virtual_cell_node",
    "event_camera": "roller_driver.event_camera_node",
    "ur10": "roller_driver.ur10_node",
}
#: Parameter of `event_camera` that gives it the camera of the environment (`usb_backend`).
EMULATED_CAMERA = "backend: 'driver.emulation.usb_backend:from_environment'"


class Watcher:
    """Collects all messages of some topics and the diagnostics."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.seen: dict[str, list[Any]] = defaultdict(list)
        self.statuses: dict[str, list[tuple[str, dict[str, str]]]] = defaultdict(list)
        self._context = Context()
        rclpy.init(context=self._context)
        self.node = Node("watcher", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        for topic in topics.ALL:
            if topic.path in names:
                keep = self.seen[topic.path].append
                self.node.create_subscription(topic.type, topic.path, keep, topic.qos)
        self.node.create_subscription(
            DiagnosticArray, "/diagnostics", self._diagnose, qos.DIAGNOSTICS
        )

    def _diagnose(self, message: Any) -> None:
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            self.statuses[status.name].append((status.message, values))

    def messages_of(self, status: str) -> list[str]:
        """All messages that a status had."""
        return [message for message, _ in self.statuses[status]]

    def has_said(self, status: str, words: str) -> bool:
        """Whether any message that a status had holds some words."""
        return any(words in message for message in self.messages_of(status))

    def value(self, status: str, key: str) -> float:
        """The newest figure of a status; -1 while there is none."""
        for _, values in reversed(self.statuses[status]):
            if key in values:
                return float(values[key])
        return -1.0

    def summary(self) -> str:
        """What was seen, for who has to find out why a test failed."""
        lines = [f"{topic}: {len(found)} messages" for topic, found in self.seen.items()]
        for name, found in self.statuses.items():
            message, values = found[-1]
            figures = ", ".join(f"{key} {value}" for key, value in values.items())
            lines.append(f"{name}: {message} ({figures})")
        return "\n".join(lines)

    def check_keys(self, *statuses: str) -> None:
        """Hold the newest values of statuses to the page that describes them."""
        for status in statuses:
            check_keys(status, next(v for _, v in reversed(self.statuses[status]) if v))

    def spin_until(self, done: Callable[[], bool], timeout_s: float, what: str) -> None:
        """Take messages until something holds; fail when it takes too long."""
        end = time.monotonic() + timeout_s
        while not done():
            assert time.monotonic() < end, (
                f"{what} did not happen within {timeout_s} s\n{self.summary()}"
            )
            self._executor.spin_once(timeout_sec=0.05)

    def spin(self, seconds: float) -> None:
        """Take messages for some time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.05)

    def spin_until_quiet(self, messages: list[Any], quiet_s: float = 0.3) -> int:
        """Take messages until none has come for a while; how many there are then."""
        for _ in range(100):
            count = len(messages)
            self.spin(quiet_s)
            if len(messages) == count:
                return count
        raise AssertionError(f"messages still come: {count}")

    def call(self, name: str, kind: Any, request: Any) -> Any:
        """Answer of a service."""
        client = self.node.create_client(kind, name)
        self.spin_until(client.service_is_ready, 30, f"service {name}")
        answer = client.call_async(request)
        self.spin_until(answer.done, 30, f"answer of {name}")
        self.node.destroy_client(client)
        return answer.result()

    def close(self) -> None:
        """Leave the graph."""
        time.sleep(0.1)  # Fast DDS can hang where one leaves while others do: see `RollerNode`
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


class Processes:
    """Nodes in processes of their own, ended in order.

    They are forked from one that has loaded their libraries, or `fresh`, whose memory is their own.
    """

    def __init__(self, folder: Path, fresh: bool = False) -> None:
        self._folder, self._fresh = folder, fresh
        self.running: dict[str, ForkedProcess | subprocess.Popen[bytes]] = {}

    def start(self, name: str, parameters: str = "", namespace: str = "") -> None:
        """Start a node with parameters given as the lines of its `ros__parameters`.

        In a namespace it is known here as namespace/name.
        """
        module, words = MODULES[name], ["--ros-args", "-r", f"__ns:=/{namespace}"]
        name = f"{namespace}/{name}" if namespace else name
        (self._folder / namespace).mkdir(exist_ok=True)
        if parameters:
            file = self._folder / f"{name}.yaml"
            file.write_text(f"/**:\n  ros__parameters: {parameters}\n")
            words += ["--params-file", str(file)]
        log = self._folder / f"{name}.log"
        if self._fresh:
            self.run(name, [sys.executable, "-c", f"from {module} import main; main()", *words])
        else:
            self.running[name] = ForkedProcess(module, words, log)

    def run(self, name: str, words: Sequence[str]) -> None:
        """Start any command, as if it were a node."""
        with (self._folder / f"{name}.log").open("a") as file:
            self.running[name] = subprocess.Popen(words, stdout=file, stderr=file)

    def log(self, name: str) -> str:
        """What a node printed."""
        return (self._folder / f"{name}.log").read_text()

    def stop(self) -> dict[str, int]:
        """Interrupt all; exit codes by node."""
        for process in self.running.values():
            if process.poll() is None:
                process.send_signal(2)
        codes = {}
        for name, process in self.running.items():
            try:
                codes[name] = process.wait(timeout=60)
            except subprocess.TimeoutExpired:
                process.kill()
                codes[name] = process.wait()
        return codes


def check_keys(status: str, values: dict[str, str]) -> None:
    """Hold a status to the page that describes it."""
    expected = documented_keys(status)
    found = {key for key in values if not key.startswith("/")}  # the recorder's topics
    assert found == expected, (
        f"{status}: not described {sorted(found - expected)}, not there {sorted(expected - found)}"
    )


def documented_keys(status: str) -> set[str]:
    """Keys of a status, with those of the sections that it names after `With`."""
    page = (Path(__file__).parents[2] / "docs" / "graph.md").read_text()
    sections = {part.split("\n")[0].strip(" `"): part for part in page.split("\n### ")}
    own = sections[status]
    keys = set(re.findall(r"^\| `(\w+)` \|", own, re.MULTILINE))
    shared = re.search(r"^With (.*?)\.", own, re.MULTILINE)
    for name in re.findall(r"Stream|Poses|Clock", shared.group(1) if shared else ""):
        keys |= set(re.findall(r"^\| `(\w+)` \|", sections[name], re.MULTILINE))
    return keys
