"""What the system must have before anything is built, and how to get it."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from steps import SetupError, Steps, warn

# Debian package of each shared library that open3d and pyusb load.
LIBRARIES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libgomp.so.1": "libgomp1",
}


def loads(library: str) -> bool:
    """Tell whether a shared library is found."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def missing_packages(build: bool = True) -> list[str]:
    """List the Debian packages that this machine lacks.

    Parameters
    ----------
    build
        Whether messages are compiled here.
    """
    missing = [package for library, package in LIBRARIES.items() if not loads(library)]
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    # A Python that isn't Debian's own brings these itself, or no Debian package would help.
    own = "python3" if sys.base_prefix == "/usr" and is_default(version) else f"python{version}"
    if importlib.util.find_spec("ensurepip") is None or importlib.util.find_spec("venv") is None:
        missing.append(f"{own}-venv")
    if build:
        if not (Path(sysconfig.get_paths()["include"]) / "Python.h").exists():
            missing.append(f"{own}-dev")
        if shutil.which("cc") is None or shutil.which("c++") is None:
            missing.append("build-essential")
    return missing


def is_default(version: str) -> bool:
    """Tell whether /usr/bin/python3 is this version."""
    target = Path("/usr/bin/python3")
    return target.exists() and target.resolve().name == f"python{version}"


def provide(steps: Steps, packages: list[str]) -> None:
    """Install Debian packages where we may.

    Raises
    ------
    SetupError
        We may not, or it didn't work; the message has the command to run.
    """
    command = f"sudo apt install {' '.join(packages)}"
    if shutil.which("apt-get") is None:
        raise SetupError(f"the system lacks {', '.join(packages)} (named as in Debian)")
    if os.geteuid() == 0:
        prefix: list[str] = []
    elif (
        shutil.which("sudo")
        and subprocess.run(["sudo", "-n", "true"], check=False, capture_output=True).returncode == 0
    ):
        prefix = ["sudo", "-n"]
    else:
        raise SetupError(f"the system lacks {', '.join(packages)}. Run:\n  {command}")
    print(f"setup: installing {' '.join(packages)} ...", end="", flush=True)
    apt = [*prefix, "env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "-q"]
    try:
        try:
            steps.run([*apt, "update"])
        except SetupError:
            warn("apt-get update failed; trying with the package lists there are")
        steps.run([*apt, "install", "-y", "--no-install-recommends", *packages])
    except SetupError as error:
        raise SetupError(f"{error}\nRun:\n  {command}") from None
    print(" done", flush=True)
