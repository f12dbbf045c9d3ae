from __future__ import annotations

import os

import pytest

from bringup.launch_world import World


@pytest.fixture
def world(tmp_path, monkeypatch):
    """An install prefix of its own, found through AMENT_PREFIX_PATH."""
    made = World(tmp_path)
    made.script("talker", "echo hello")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(made.prefix), prepend=os.pathsep)
    return made
