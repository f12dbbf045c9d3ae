"""ROS 2: which one, its middleware and the messages; RViz."""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib import metadata

from .result import Result, fault, ok, warning

MESSAGES = (
    "diagnostic_msgs", "event_camera_msgs", "geometry_msgs", "roller_msgs", "sensor_msgs",
    "std_msgs", "tf2_msgs", "visualization_msgs",
)  # fmt: skip
KNOWN_DISTRIBUTIONS = ("jazzy", "kilted")
_FAST_DDS = "rmw_fastrtps_cpp"
_TIMEOUT_S = 60.0
#: Imports rclpy with its middleware.
IMPORT = "import rclpy; rclpy.get_rmw_implementation_identifier()"


@dataclass(frozen=True)
class RosFacts:
    """What was found of ROS 2."""

    #: Name of the distribution that is sourced; empty: none.
    distribution: str = ""
    #: Version of rclpy's wheel; empty: not from wheels.
    wheels: str = ""
    #: The middleware in use; empty: rclpy can't be imported.
    rmw: str = ""
    #: Why rclpy can't be imported.
    fault: str = ""
    #: Message packages that can't be imported.
    missing: tuple[str, ...] = ()


def fault_apart(code: str) -> str:
    """Why Python code fails in a process of its own; empty: it doesn't.

    A middleware that isn't there, or a domain that can't be, ends the process that asks for it.
    """
    try:
        found = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=_TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        return f"no answer within {_TIMEOUT_S:.0f} s"
    if not found.returncode:
        return ""
    said = [line for line in found.stderr.splitlines() if line.strip()]
    # The place in the source of ROS that may follow says nothing to its user.
    return said[-1].split(", at /")[0] if said else f"it ends with {found.returncode}"


def find_ros() -> RosFacts:
    """Look at rclpy, its middleware and the messages."""
    distribution = os.environ.get("ROS_DISTRO", "")
    try:
        wheels = metadata.version("ros-kilted-rclpy")
    except metadata.PackageNotFoundError:
        wheels = ""
    if found := fault_apart(IMPORT):
        return RosFacts(distribution, wheels, fault=found)
    try:
        import rclpy

        rmw = str(rclpy.get_rmw_implementation_identifier())
    except Exception as error:  # a broken installation fails in many ways
        return RosFacts(distribution, wheels, fault=f"{type(error).__name__}: {error}")
    missing = []
    for package in MESSAGES:
        try:
            importlib.import_module(f"{package}.msg")
        except ImportError:
            missing.append(package)
    return RosFacts(distribution, wheels, rmw, missing=tuple(missing))


def judge_ros(facts: RosFacts) -> Result:
    """Whether nodes can run."""
    name = "ROS 2"
    if not facts.rmw:
        return fault(
            name,
            f"rclpy can't be imported ({facts.fault})",
            "source a ROS 2 distribution or leave it, then run `make setup` again; where "
            f"RMW_IMPLEMENTATION is set, take {_FAST_DDS}",
        )
    source = f"wheels (Kilted, rclpy {facts.wheels})" if facts.wheels else facts.distribution
    found = f"{source or 'a distribution that is not named'}, {facts.rmw}"
    if facts.missing:
        return fault(
            name,
            f"{found}; no messages of {', '.join(facts.missing)}",
            "run `make setup`; on a distribution: apt install "
            + " ".join(f"ros-$ROS_DISTRO-{m.replace('_', '-')}" for m in facts.missing),
        )
    if facts.rmw != _FAST_DDS:
        return warning(
            name,
            found,
            f"set RMW_IMPLEMENTATION={_FAST_DDS}: no other is tried, and config/fastdds.xml "
            "holds for it alone",
        )
    if not facts.wheels and facts.distribution not in KNOWN_DISTRIBUTIONS:
        return warning(name, found, f"known to work: {', '.join(KNOWN_DISTRIBUTIONS)}")
    note = "; for development and demonstration, not for a cell" if facts.wheels else ""
    return ok(name, found + note)


def find_rviz() -> str:
    """Path of RViz 2; empty: not installed."""
    return shutil.which("rviz2") or ""


def judge_rviz(path: str) -> Result:
    """Whether the surface can be watched."""
    if path:
        return ok("RViz", path)
    return warning(
        "RViz",
        "rviz2 is not installed",
        "apt install ros-$ROS_DISTRO-rviz2 to watch a scan; replay and demo draw "
        "overview.png without it",
    )
