"""DDS: does a message make it from one process to another, a large one too."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roller_ros.dds_profile import PROFILE

from .dds_peer import LARGE, MESSAGES, SMALL
from .result import Result, fault, ok, warning
from .ros import IMPORT, fault_apart

_TIMEOUT_S = 20.0
#: Starts a node.
_START = (
    "import rclpy; from roller_ros.refusals import init_ros; init_ros(); "
    "rclpy.create_node('doctor').destroy_node(); rclpy.shutdown()"
)
#: Each participant takes 34 MB of shared memory (config/fastdds.xml); a graph has up to ten.
_SHARED_MEMORY = 400e6


@dataclass(frozen=True)
class TransportFacts:
    """What decides how messages travel."""

    #: Fast DDS profile file that is set; empty: none.
    profile: str
    #: What it holds; None: it can't be read.
    profile_text: str | None
    #: Discovery range in force.
    discovery: str
    #: ROS domain.
    domain: str
    #: Free shared memory; None: none can be written.
    shared_memory_bytes: float | None


@dataclass(frozen=True)
class Exchange:
    """What made it from one process to another."""

    #: Messages received, of `dds_peer.MESSAGES` each.
    small: int = 0
    large: int = 0
    #: Median of the large ones' time in transit; 0 where none came.
    milliseconds: float = 0.0
    #: Why nothing could be tried, and what to do.
    fault: str = ""
    remedy: str = "see ROS 2, above"


def find_transport(
    environment: Mapping[str, str] | None = None, shared_memory: str = "/dev/shm"
) -> TransportFacts:
    """Look at the environment and at the shared memory."""
    environment = os.environ if environment is None else environment
    profile, text = environment.get(PROFILE, ""), None
    if profile:
        try:
            text = Path(profile.removeprefix("file://")).read_text()
        except (OSError, UnicodeDecodeError):
            text = None
    discovery = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "")
    if not discovery:
        local = environment.get("ROS_LOCALHOST_ONLY") == "1"
        discovery = "LOCALHOST" if local else "SUBNET (the default)"
    free = None
    if os.access(shared_memory, os.W_OK):
        with suppress(OSError):
            free = float(shutil.disk_usage(shared_memory).free)
    return TransportFacts(profile, text, discovery, environment.get("ROS_DOMAIN_ID", "0"), free)


def judge_transport(facts: TransportFacts) -> Result:
    """Whether large messages can travel."""
    name = "DDS set-up"
    found = f"discovery {facts.discovery}, domain {facts.domain}"
    if not facts.profile:
        return warning(
            name,
            f"{found}; no Fast DDS profile is set",
            f"launch files set one; for nodes started by hand: export {PROFILE}="
            "…/config/fastdds.xml, or depth images are lost",
        )
    if facts.profile_text is None:
        return fault(
            name,
            f"{found}; the Fast DDS profile {facts.profile} can't be read",
            f"export {PROFILE}=…/config/fastdds.xml",
        )
    if "segment_size" not in facts.profile_text:
        return warning(
            name,
            f"{found}; the profile {facts.profile} doesn't enlarge the shared memory",
            "take config/fastdds.xml, or its transport: messages above 0.5 MB are lost",
        )
    if facts.shared_memory_bytes is None:
        return fault(
            name,
            f"{found}; shared memory can't be written",
            "mount /dev/shm so that this user can write there: depth images travel through it",
        )
    if facts.shared_memory_bytes < _SHARED_MEMORY:
        return warning(
            name,
            f"{found}; {facts.shared_memory_bytes / 1e6:.0f} MB of shared memory are free",
            "give /dev/shm 512 MB (docker: --shm-size=512m), and remove /dev/shm/fastdds_* "
            "(fastrtps_* of Fast DDS 2) that dead nodes left",
        )
    return ok(name, f"{found}, profile {facts.profile}")


def exchange_messages(default_profile: Path | None = None) -> Exchange:
    """Start a process that publishes and receive what it sends.

    Parameters
    ----------
    default_profile : path, optional
        Fast DDS profile where none is set, as the launch files have it.
    """
    unset = PROFILE not in os.environ
    if unset and default_profile is not None:
        os.environ[PROFILE] = str(default_profile)
    try:
        return _exchange()
    finally:
        if unset:
            os.environ.pop(PROFILE, None)


def _exchange() -> Exchange:
    # Where not even its import ends well, it would take this process along.
    if found := fault_apart(IMPORT):
        return Exchange(fault=f"rclpy can't be used ({found})")
    try:
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node
        from std_msgs.msg import UInt8MultiArray

        from roller_ros import qos
        from roller_ros.refusals import init_ros
        from roller_ros.shared_memory import SharedMemoryError, check_shared_memory
    except Exception as error:  # a broken installation fails in many ways
        return Exchange(fault=f"rclpy can't be used ({error})")
    try:
        check_shared_memory()
    except SharedMemoryError as error:
        return Exchange(fault=str(error), remedy="remove what it names, and nothing else")
    if found := fault_apart(_START):
        return Exchange(
            fault=f"a node can't be started ({found})",
            remedy="see ROS 2, above; ROS_DOMAIN_ID is a number from 0 to 232",
        )
    topic = f"/roller/doctor_{os.getpid()}"
    context = Context()
    init_ros(context=context)
    node = Node(f"doctor_{os.getpid()}", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    arrivals: dict[int, list[float]] = {SMALL: [], LARGE: []}

    def take(message: UInt8MultiArray) -> None:
        sent = int(np.frombuffer(message.data, np.uint8)[:8].view(np.int64)[0])
        arrivals[len(message.data)].append((time.monotonic_ns() - sent) * 1e-6)

    node.create_subscription(UInt8MultiArray, f"{topic}_small", take, qos.DEPTH)
    # The depth images' size, with nothing sent again.
    node.create_subscription(UInt8MultiArray, f"{topic}_large", take, qos.EVENTS)
    peer = subprocess.Popen(
        [sys.executable, "-m", "roller_bringup.doctor.dds_peer", topic, str(_TIMEOUT_S)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        end = time.monotonic() + _TIMEOUT_S
        while time.monotonic() < end and min(map(len, arrivals.values())) < MESSAGES:
            executor.spin_once(timeout_sec=0.05)
            if peer.poll() is not None:
                end = min(end, time.monotonic() + 0.5)  # what is in transit may still come
    finally:
        peer.kill()
        peer.wait()
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
    late = float(np.median(arrivals[LARGE])) if arrivals[LARGE] else 0.0
    return Exchange(len(arrivals[SMALL]), len(arrivals[LARGE]), late)


def judge_exchange(found: Exchange) -> Result:
    """Whether the nodes will hear each other."""
    name = "DDS messages"
    if found.fault:
        return fault(name, found.fault, found.remedy)
    if not found.small and not found.large:
        return fault(
            name,
            "two processes on this machine don't hear each other",
            "look at ROS_DOMAIN_ID, ROS_AUTOMATIC_DISCOVERY_RANGE and the firewall (UDP on "
            "the loopback); remove /dev/shm/fastdds_* (fastrtps_* of Fast DDS 2) that dead nodes "
            "left",
        )
    text = (
        f"{found.small} of {MESSAGES} small messages came, {found.large} of {MESSAGES} of "
        f"{LARGE / 1e6:.1f} MB, these in {found.milliseconds:.1f} ms"
    )
    # The small ones are sent again until they come; behind lost large ones they don't.
    if found.small < MESSAGES or found.large < MESSAGES // 2:
        return fault(
            name,
            text,
            "depth images and poses will be lost: set "
            f"{PROFILE} to config/fastdds.xml and give /dev/shm room",
        )
    if found.large < MESSAGES:
        return warning(name, text, "the machine was busy, or its shared memory is short; try again")
    return ok(name, text)
