"""Nodes and the command start without the libraries that only some of their work needs."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import entry_points

#: Each takes a second or more to load.
HEAVY = ("open3d", "matplotlib", "dash")
#: Aligns the passes with open3d, so it has it ready when the first comes.
STITCHER = "roller_emvs.stitcher_node"


def test_nodes_and_the_command_load_no_heavy_library() -> None:
    scripts = {entry.module for entry in entry_points(group="console_scripts")}
    nodes = {m for m in scripts if m.startswith("roller_") and m.endswith("_node")} - {STITCHER}
    assert len(nodes) >= 7
    code = (
        "import importlib, sys\n"
        "for name in sys.argv[1:]:\n"
        "    importlib.import_module(name)\n"
        f"    found = [m for m in {HEAVY} if m in sys.modules]\n"
        "    assert not found, f'{name} loads {found}'\n"
    )
    words = [sys.executable, "-c", code, "roller_bringup.cli", *sorted(nodes)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-1000:]
