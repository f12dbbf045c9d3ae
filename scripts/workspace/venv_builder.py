"""The virtual environment, and installing into it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from steps import SetupError, Steps, digest

UV = Path(__file__).resolve().parents[2] / "requirements-uv.txt"


class Environment:
    """The workspace's virtual environment.

    Parameters
    ----------
    path
        Its folder.
    mode
        "wheels" (ROS 2 comes from wheels) or "distribution" (from a sourced ROS 2 distribution,
        whose Python packages stay visible).
    """

    def __init__(self, path: Path, mode: str) -> None:
        self.path = path
        self.mode = mode
        self.python = path / "bin" / "python"
        self.version = f"{sys.version_info.major}.{sys.version_info.minor}"

    @property
    def key(self) -> str:
        """What the environment stands for: the place, the Python and the mode."""
        return f"{self.path} python{self.version} {self.mode}"

    def ensure(self, steps: Steps) -> bool:
        """Create the environment, or keep the one there is if it fits."""
        if steps.is_done("venv", self.key) and self._works():
            return False
        if not (steps.folder / "venv").exists() and self._works():
            # Made by hand; everything else is checked against the stamps it doesn't have.
            if not steps.folder.is_dir():
                steps.mark("adopted", "made by hand: not ours to remove")
            steps.mark("venv", self.key)
            return False
        if self.path.is_symlink():  # its steps are another place's, too
            raise SetupError(f"{self.path} is a link to an environment of another place: remove it")

        def create() -> None:
            if self.path.exists():
                if not steps.folder.is_dir() or (steps.folder / "adopted").exists():
                    raise SetupError(f"{self.path} is not of our making: move it away")
                shutil.rmtree(self.path)
            # What tells later that it is ours, however far this gets.
            steps.folder.mkdir(parents=True)
            command = [sys.executable, "-m", "venv", str(self.path)]
            if self.mode == "distribution":
                command.append("--system-site-packages")
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise SetupError(f"can't make {self.path}: {(done.stderr or done.stdout).strip()}")

        return steps.do("venv", f"making .venv with Python {self.version}", self.key, create)

    def _works(self) -> bool:
        """Tell whether the environment runs, is of our Python and shows the system's packages."""
        if not self.python.exists() or not (self.path / "pyvenv.cfg").exists():
            return False
        code = "import pip, sys; print(sys.prefix, '%d.%d' % sys.version_info[:2])"
        done = subprocess.run(
            [str(self.python), "-I", "-c", code], capture_output=True, text=True, check=False
        )
        wants = "true" if self.mode == "distribution" else "false"
        config = (self.path / "pyvenv.cfg").read_text().lower().replace(" ", "")
        return (
            done.returncode == 0
            and done.stdout.split() == [str(self.path), self.version]
            and f"include-system-site-packages={wants}" in config
        )

    def clean_environment(self) -> dict[str, str]:
        """Give the environment variables for programs that run in the virtual environment."""
        variables = dict(os.environ)
        variables.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
        variables.pop("PYTHONHOME", None)
        variables["VIRTUAL_ENV"] = str(self.path)
        variables["PATH"] = f"{self.path / 'bin'}{os.pathsep}{variables.get('PATH', '')}"
        if self.mode == "wheels":
            # Another environment's packages must not get in.
            variables.pop("PYTHONPATH", None)
        return variables

    def install(self, steps: Steps, files: Iterable[Path]) -> bool:
        """Install pinned requirements; what is downloaded must have the hashes given there."""
        files = list(files)
        arguments = _pinned(*files)
        return steps.do(
            "requirements",
            "installing requirements",
            digest(files, self.key),
            lambda: self._pip(steps, arguments),
        )

    def install_editable(self, steps: Steps, folders: Iterable[Path]) -> bool:
        """Install packages of this workspace so that changes to them count at once."""
        folders = list(folders)
        packaging = [folder / name for folder in folders for name in ("setup.py", "setup.cfg")]
        arguments = ["--no-deps", "--no-build-isolation"]
        for folder in folders:
            arguments += ["-e", str(folder)]
        return steps.do(
            "packages",
            f"installing {len(folders)} packages of the workspace",
            digest(packaging, self.key, *map(str, folders)),
            lambda: self._pip(steps, arguments, ["--use-pep517"]),
        )

    def add(self, steps: Steps, file: Path) -> None:
        """Install one more file of requirements, as part of another step."""
        self._pip(steps, _pinned(file))

    def _pip(self, steps: Steps, arguments: list[str], pip_only: list[str] | None = None) -> None:
        """Install with uv, which is quicker, or with pip where uv doesn't work."""
        variables = self.clean_environment()
        uv = self.path / "bin" / "uv"
        pip = [str(self.python), "-m", "pip", "--disable-pip-version-check", "install"]
        try:
            if not uv.exists():
                steps.run([*pip, *_pinned(UV)], variables)
            index = self._pip_index(variables)
            if index and not variables.keys() & {"UV_DEFAULT_INDEX", "UV_INDEX_URL"}:
                variables["UV_DEFAULT_INDEX"] = index
            steps.run(
                [str(uv), "pip", "install", "--python", str(self.python), *arguments], variables
            )
        except SetupError:
            steps.run([*pip, *(pip_only or []), *arguments], variables)

    def _pip_index(self, variables: dict[str, str]) -> str:
        """Tell the index that pip is set to, which uv doesn't read; empty if none is."""
        command = [str(self.python), "-m", "pip", "config", "list"]
        said = subprocess.run(command, capture_output=True, text=True, check=False, env=variables)
        found = dict(re.findall(r"^(\S+)\.index-url='(.*)'$", said.stdout, re.MULTILINE))
        return next((found[k] for k in (":env:", "install", "global") if k in found), "")


def _pinned(*files: Path) -> list[str]:
    """Arguments that have pinned requirements installed."""
    return ["--require-hashes", *(word for file in files for word in ("-r", str(file)))]
