"""Packages of small shell scripts as nodes, for launch tests; what sets up a workspace."""

import os
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


class World:
    """An install prefix with packages, and launch files beside it."""

    def __init__(self, folder: Path) -> None:
        self.prefix = folder / "prefix"
        self.files = folder / "files"
        self.files.mkdir(parents=True)

    def script(self, name: str, body: str, package: str = "demo") -> Path:
        """Install an executable."""
        index = self.prefix / "share/ament_index/resource_index/packages"
        index.mkdir(parents=True, exist_ok=True)
        (index / package).touch()
        path = self.prefix / "lib" / package / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("#!/bin/bash\n" + textwrap.dedent(body))
        path.chmod(0o755)
        return path

    def launch(self, body: str, name: str = "test.launch.xml") -> Path:
        """Write a launch file; `<launch>` is put around."""
        path = self.files / name
        path.write_text(f"<launch>\n{textwrap.dedent(body).strip()}\n</launch>\n")
        return path


@pytest.fixture
def world(tmp_path, monkeypatch):
    """An install prefix of its own, found through AMENT_PREFIX_PATH."""
    made = World(tmp_path)
    made.script("talker", "echo hello")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(made.prefix), prepend=os.pathsep)
    return made


@pytest.fixture
def modules(monkeypatch):
    """The modules of scripts/workspace, which stand alone."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts" / "workspace"))
    names = ("steps", "system", "venv_builder", "wheels", "distribution")
    for name in names:
        sys.modules.pop(name, None)
    import distribution
    import steps
    import system
    import venv_builder
    import wheels

    found = (steps, system, venv_builder, wheels, distribution)
    yield {module.__name__: module for module in found}
    for name in names:
        sys.modules.pop(name, None)
