"""Hands a result or a running graph to rerun, where that is installed."""

from __future__ import annotations

import importlib.util
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from roller_core.errors import RollerError

_INSTALL = (
    "rerun isn't installed (660 MB): .venv/bin/uv pip install --python .venv/bin/python rerun-sdk; "
    "the page of `roller view` needs nothing"
)
#: Where the viewer listens: unless told so, rerun does on every interface.
_HOST, _PORT = "127.0.0.1", 9876
#: How long it may take to start, s.
_START_S = 30.0


class RerunError(RollerError):
    """Rerun isn't there, or gives up."""


def hand_over(source: Path | None, namespace: str = "") -> int:
    """Show a result, a recording or the running graph in rerun; its exit code.

    Raises
    ------
    RerunError
        If rerun isn't installed, or there is no bag to show.
    """
    program = shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
    if program is None:
        raise RerunError(_INSTALL)
    if source is None:
        if importlib.util.find_spec("rerun") is None:
            raise RerunError(_INSTALL)
        _start_viewer(program)
        return _live(namespace)
    with tempfile.TemporaryDirectory(prefix="roller-view-") as folder:
        out = Path(folder) / "result.rrd"
        bag = _bag_of(source)
        done = subprocess.run(
            [program, "mcap", "convert", str(bag), "--output", str(out)], check=False
        )
        if done.returncode:
            raise RerunError(f"{bag}: `rerun mcap convert` doesn't take it")
        return subprocess.run([program, "--bind", _HOST, str(out)], check=False).returncode


def _bag_of(source: Path) -> Path:
    """The MCAP file of a result or a recording."""
    if source.is_file() and source.suffix == ".mcap":
        return source
    for folder in (source / "result", source / "bag", source):
        if found := sorted(folder.glob("*.mcap")):
            return found[0]
    raise RerunError(f"{source}: no MCAP file in it, nor in result/ or bag/")


def _start_viewer(program: str) -> None:
    """Start the viewer in a process of its own, unless one runs.

    Raises
    ------
    RerunError
        If it doesn't start.
    """
    if _viewer_runs():
        return
    command = [program, "--bind", _HOST, "--port", str(_PORT), "--expect-data-soon"]
    viewer = subprocess.Popen(command, start_new_session=True)
    end = time.monotonic() + _START_S
    while not _viewer_runs():
        if viewer.poll() is not None or time.monotonic() > end:
            viewer.terminate()
            raise RerunError("rerun's viewer doesn't start: try `rerun` alone; it says why")
        time.sleep(0.1)


def _viewer_runs() -> bool:
    with socket.socket() as connection:
        connection.settimeout(1.0)
        return connection.connect_ex((_HOST, _PORT)) == 0


def _live(namespace: str) -> int:
    """Log what a graph gives until Ctrl-C; a viewer that is slow holds up this process alone."""
    import rerun

    from .graph import Graph
    from .scene import Scene

    rerun.init("roller")
    rerun.connect_grpc(f"rerun+http://{_HOST}:{_PORT}/proxy")
    scene = Scene("live")
    revision = depth_revision = -1
    text = ""
    with Graph(scene, namespace):
        while True:
            time.sleep(0.5)
            with scene.lock:
                grid = scene.grid
                points = grid.cells("height") if grid.revision != revision else None
                revision = grid.revision
                depth = scene.depth() if scene.depth_revision != depth_revision else None
                depth_revision = scene.depth_revision
                said, speed = scene.text, scene.speed_m_s
            if points is not None and len(points):
                rerun.log("surface", rerun.Points3D(points, colors=_colours(points[:, 2])))
            if depth is not None:
                rerun.log("depth", rerun.DepthImage(np.nan_to_num(depth), meter=1.0))
            if speed is not None:
                rerun.log("speed_m_s", rerun.Scalars(speed))
            if said != text:
                text = said
                rerun.log("text", rerun.TextDocument(text))


def _colours(height_m: Any) -> Any:
    """Colours of heights, dark blue to yellow."""
    import cv2

    from roller_inspect.results.drawing import colours

    low, high = np.percentile(height_m, (2, 98))
    return colours(height_m, low, max(high, low + 1e-9), cv2.COLORMAP_VIRIDIS)
