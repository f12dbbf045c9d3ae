"""Setting up without a ROS installation: ROS 2 from wheels, messages built into .venv."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from pathlib import Path

from steps import SetupError, Steps, digest
from venv_builder import Environment

# In the order of what they need of each other.
MESSAGES = ("underlay/event_camera_msgs", "underlay/tf2_msgs", "src/roller_msgs")
PACKAGES = (
    "underlay/tf_transformations",
    "src/roller_core",
    "src/roller_ros",
    "src/roller_driver",
    "src/roller_sim",
    "src/roller_recording",
    "src/roller_emvs",
    "src/roller_braille",
    "src/roller_inspect",
    "src/roller_calibration",
    "src/roller_evaluation",
    "src/roller_bringup",
)
REQUIREMENTS = ("requirements.txt", "requirements-dev.txt", "requirements-ros.txt")


def build(root: Path, environment: Environment, steps: Steps) -> bool:
    """Bring .venv up to date; tell whether anything was to do."""
    if (sys.platform, platform.machine()) != ("linux", "x86_64") or sys.version_info >= (3, 15):
        raise SetupError(
            "ROS 2 comes as wheels only for x86-64 Linux and Python 3.10 to 3.14; "
            "elsewhere install a ROS 2 distribution and source it first"
        )
    changed = environment.install(steps, [root / name for name in REQUIREMENTS])
    for name in MESSAGES:
        changed |= build_messages(root, root / name, environment, steps)
    changed |= environment.install_editable(steps, [root / name for name in PACKAGES])
    for name in PACKAGES:
        link_share(root / name, environment.path / "share")
    return changed


def build_messages(root: Path, source: Path, environment: Environment, steps: Steps) -> bool:
    """Generate, compile and install one message package with plain CMake."""
    fix = root / "scripts" / "drop_wheel_paths.cmake"
    ros = root / "requirements-ros.txt"

    def compile_and_install() -> None:
        target = environment.path / "build" / source.name
        shutil.rmtree(target, ignore_errors=True)
        cmake = str(environment.path / "bin" / "cmake")
        variables = environment.clean_environment()
        for name in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH"):
            variables.pop(name, None)
        options = {
            "CMAKE_PREFIX_PATH": environment.path,
            "CMAKE_INSTALL_PREFIX": environment.path,
            "CMAKE_PROJECT_TOP_LEVEL_INCLUDES": fix,
            "Python3_EXECUTABLE": environment.python,
            "BUILD_TESTING": "OFF",
        }
        defines = [f"-D{key}={value}" for key, value in options.items()]
        steps.run([cmake, "-S", str(source), "-B", str(target), *defines], variables)
        jobs = str(os.cpu_count() or 1)
        steps.run([cmake, "--build", str(target), "--parallel", jobs], variables)
        steps.run([cmake, "--install", str(target)], variables)
        shutil.rmtree(target, ignore_errors=True)

    key = digest([source, fix, ros], environment.key)
    return steps.do(source.name, f"building {source.name}", key, compile_and_install)


def link_share(source: Path, share: Path) -> None:
    """Put a package where ROS 2 looks for it: the ament index and share/<package>.

    Links, so that a changed launch file or parameter counts at once.

    Raises
    ------
    SetupError
        If something of someone else's is where a link belongs; it stays.
    """
    name = source.name
    links = {
        share / "ament_index" / "resource_index" / "packages" / name: source / "resource" / name,
        share / name / "package.xml": source / "package.xml",
    }
    for folder in ("launch", "config"):
        if (source / folder).is_dir():
            links[share / name / folder] = (source / folder).resolve()
    for link, target in links.items():
        if link.is_symlink() and os.readlink(link) == str(target):
            continue
        link.parent.mkdir(parents=True, exist_ok=True)
        clear(link, target)
        link.symlink_to(target)


def clear(link: Path, target: Path) -> None:
    """Make room for a link: an older link or an empty folder goes, and a copy of the target.

    Raises
    ------
    SetupError
        If something else is there, which isn't ours to remove.
    """
    if link.is_symlink():
        link.unlink()
        return
    if not link.exists():
        return
    if link.is_dir() and not any(link.iterdir()):
        link.rmdir()
    elif (
        link.is_file()
        and target.is_file()
        and not link.samefile(target)
        and link.read_bytes() == target.read_bytes()
    ):
        link.unlink()
    else:
        raise SetupError(
            f"{link} is not of our making, and a link to {target} belongs there: move it away, "
            "then run `make setup` again"
        )
