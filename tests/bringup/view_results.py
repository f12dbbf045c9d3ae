"""Small results and servers for the tests of the operator's page."""

import http.client
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from roller_bringup.view.grid import Grid
from roller_bringup.view.scene import Scene
from roller_bringup.view.server import PageServer
from roller_bringup.view.tiles import TILE

#: From the map's frame to base.
BASE_FROM_MAP = np.array([[0, -1, 0, 0.4], [1, 0, 0, -0.1], [0, 0, 1, 0.02], [0, 0, 0, 1.0]])
#: The dent of the result, in the map's frame, metres.
DENT = (0.012, 0.0064)


def finding(number: int, kind: str, verdict: str, depth_m: float, at: tuple[float, float]) -> dict:
    center = BASE_FROM_MAP @ [*at, 0, 1]
    return {
        "id": f"F{number}",
        "kind": kind,
        "center_m": center[:3].tolist(),
        "length_m": 0.003,
        "width_m": 0.002,
        "depth_m": depth_m,
        "area_m2": 5e-6,
        "volume_m3": -4e-10,
        "uncertainty": {"depth_m": 2.04e-5},
        "confidence": 0.9,
        "verdict": verdict,
    }


def write_result(folder: Path) -> Path:
    """A result with a height map of 30 × 10 mm, a dent, a gap and three findings.

    A tenth was continued from measured neighbours.
    """
    folder.mkdir(parents=True, exist_ok=True)
    x, y = np.arange(300) * 1e-4, np.arange(100) * 1e-4
    height = np.where(np.hypot(x - DENT[0], y[:, None] - DENT[1]) < 1.5e-3, -2.2e-4, 1e-5)
    state = np.full(height.shape, 3, np.uint8)
    state[:, 200:230] = 1
    state[:, 240:270] = 2
    state[:5] = 0
    height[state < 2] = np.nan
    np.savez(
        folder / "height_map.npz",
        x_m=x,
        y_m=y,
        height_m=height.astype(np.float32),
        sigma_m=np.full(height.shape, 2e-5, np.float32),
        state=state,
        base_from_map=BASE_FROM_MAP,
    )
    inspection = {
        "part": "<img src=x onerror=alert(1)>",
        "verdict": "nonconform",
        "coverage": {"measured": 0.85, "continued": 0.0, "unmeasured": 0.15},
        "findings": [
            finding(1, "scratch", "inconclusive", -3e-4, (0.005, 0.005)),
            finding(2, "dent", "nonconform", -2.2e-4, DENT),
            finding(3, "raised", "nonconform", 1e-4, (0.025, 0.005)),
        ],
    }
    (folder / "inspection.json").write_text(json.dumps(inspection))
    (folder / "findings.csv").write_text("id,kind\n")
    (folder / "braille.txt").write_text("plate seven\n")
    (folder / ".roller-output.json").write_text("{}")
    return folder


@contextmanager
def serving(scene: Scene, host: str = "127.0.0.1", port: int = 0) -> Iterator[PageServer]:
    """Serve a scene from a thread."""
    server = PageServer(scene, host, port)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join(20)


def cells_of(grid: Grid, layer: str = "height") -> dict:
    """State and value of each cell that is inside, by its place."""
    out = {}
    for (tx, ty), tile in grid.tiles.items():
        for j, i in zip(*np.nonzero(tile.state), strict=True):
            value = tile.layers[layer][j, i]
            out[tx * TILE + i, ty * TILE + j] = (tile.state[j, i], float(value))
    return out


def get(server: PageServer, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return found


def frames(server: PageServer) -> Iterator[dict]:
    """States as a browser gets them."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    connection.request("GET", "/api/events")
    for line in connection.getresponse():
        if line.startswith(b"data: "):
            yield json.loads(line[6:])
