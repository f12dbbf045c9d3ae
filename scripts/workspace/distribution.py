"""Setting up on a sourced ROS 2 distribution: its messages and rclpy, colcon for ours."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from steps import SetupError, Steps, digest
from venv_builder import Environment

# What we use of the distribution; each is apt's ros-<distribution>-<name with dashes>.
NEEDED = (
    "ament_cmake",
    "diagnostic_msgs",
    "event_camera_msgs",
    "geometry_msgs",
    "rclpy",
    "rosidl_default_generators",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "tf2_msgs",
    "tf_transformations",
    "visualization_msgs",
)
REQUIREMENTS = ("requirements.txt", "requirements-dev.txt")
COLCON = "requirements-colcon.txt"


class Distribution:
    """A sourced ROS 2 distribution."""

    def __init__(self, name: str, prefixes: list[Path]) -> None:
        self.name = name
        self.prefixes = prefixes

    @property
    def prefix(self) -> Path:
        """Where the distribution itself is installed, below any workspace sourced on top."""
        for prefix in reversed(self.prefixes):
            if has_package(prefix, "rclpy"):
                return prefix
        return self.prefixes[-1]

    def missing(self) -> list[str]:
        """List what we need and it doesn't have."""
        return [name for name in NEEDED if not any(has_package(p, name) for p in self.prefixes)]


def has_package(prefix: Path, name: str) -> bool:
    """Tell whether a package is registered in a prefix."""
    return (prefix / "share/ament_index/resource_index/packages" / name).exists()


def find() -> Distribution | None:
    """Find the sourced ROS 2 distribution, if any.

    It counts when this Python, which isn't ours, can import its rclpy.
    """
    if os.environ.get("ROLLER_ROS") == "wheels":
        return None
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    if not prefixes:
        return None
    probe = subprocess.run(
        [sys.executable, "-c", "import rclpy"], capture_output=True, text=True, check=False
    )
    if probe.returncode:
        reason = (probe.stderr.strip().splitlines() or ["?"])[-1]
        raise SetupError(
            f"a ROS 2 distribution is sourced, but {sys.executable} can't import its rclpy "
            f"({reason}). Set ROLLER_PYTHON to the distribution's Python, "
            "or ROLLER_ROS=wheels to set up without it"
        )
    return Distribution(os.environ.get("ROS_DISTRO", "unknown"), prefixes)


def build(root: Path, environment: Environment, steps: Steps, found: Distribution) -> bool:
    """Bring .venv and install/ up to date; tell whether anything was to do."""
    missing = found.missing()
    if missing:
        packages = " ".join(f"ros-{found.name}-{name.replace('_', '-')}" for name in missing)
        raise SetupError(
            f"ROS 2 {found.name} lacks {', '.join(missing)}. Run:\n  sudo apt install {packages}"
        )
    changed = environment.install(steps, [root / name for name in REQUIREMENTS])
    steps.mark("distribution", str(found.prefix))
    packaging = sorted(
        path
        for pattern in ("*/package.xml", "*/setup.py", "*/setup.cfg", "roller_msgs/*")
        for path in (root / "src").glob(pattern)
    )
    # Python files are linked, so changes to them count at once; a new file of these folders not.
    shared = [
        path.name for name in ("launch", "config") for path in sorted((root / name).glob("*"))
    ]
    key = digest(packaging, environment.key, str(found.prefixes), *shared)
    if not (root / "install" / "setup.bash").exists():
        steps.forget("colcon")
    changed |= steps.do(
        "colcon", "building with colcon", key, lambda: colcon(root, environment, steps)
    )
    return changed


def colcon(root: Path, environment: Environment, steps: Steps) -> None:
    """Build the workspace with the virtual environment's Python.

    The executables then run in it, also when `ros2 launch` starts them.
    """
    variables = environment.clean_environment()
    probe = subprocess.run(
        [str(environment.python), "-c", "import colcon_core, colcon_ros, colcon_cmake"],
        capture_output=True,
        check=False,
        env=variables,
    )
    if probe.returncode:
        environment.add(steps, root / COLCON)
    command = [str(environment.python), "-m", "colcon", "build", "--base-paths", "src"]
    command += ["--symlink-install", "--event-handlers", "console_direct+"]
    command += ["--cmake-args", f"-DPython3_EXECUTABLE={environment.python}", "-DBUILD_TESTING=OFF"]
    here = os.getcwd()
    os.chdir(root)
    try:
        steps.run(command, variables)
    finally:
        os.chdir(here)
