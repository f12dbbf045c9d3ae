"""What the page shows: one object that a graph or a folder fills and the server reads."""

from __future__ import annotations

import json
import struct
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from roller_core.transforms import inverse_pose

from . import health
from .findings import listed
from .grid import F32, F64, MOST_TILES, Grid
from .tiles import TILE, pack

#: Tiles in one answer: some 1.2 MB at most.
_TILES_AT_ONCE = 32


def _no_depth() -> F32:
    return np.full((2, 2), np.nan, np.float32)


@dataclass
class Scene:
    """All that is known; `lock` is held to read and to change it."""

    #: What is shown.
    title: str
    #: A result's folder; None: a live graph.
    folder: Path | None = None
    most_tiles: int = MOST_TILES
    #: The height map, in the map's frame.
    grid: Grid = field(init=False)
    #: Its place in base. Shape (4, 4).
    base_from_map: F64 = field(default_factory=lambda: np.eye(4))
    #: Where the newest points are, in the map.
    head: tuple[float, float] | None = None
    #: Of the robot, and from the surface to here.
    speed_m_s: float | None = None
    force_n: float | None = None
    lag_s: float | None = None
    coverage: Mapping[str, float] | None = None
    #: Of a result.
    verdict: str = ""
    reason: str = ""
    notes: list[str] = field(default_factory=list)
    facts: dict[str, str] = field(default_factory=dict)
    nodes: dict[str, health.Node] = field(default_factory=dict)
    text: str = ""
    text_revision: int = 0
    findings: list[dict[str, Any]] = field(default_factory=list)
    findings_revision: int = 0
    #: 0: there is no depth image.
    depth: Callable[[], F32] = _no_depth
    depth_revision: int = 0
    lock: threading.RLock = field(default_factory=threading.RLock)

    def __post_init__(self) -> None:
        self.grid = Grid(most_tiles=self.most_tiles)
        self._covered: tuple[float, float | None] = (0.0, None)

    def take_text(self, text: str) -> None:
        """Take the text so far, or its end."""
        with self.lock:
            if text != self.text:
                self.text, self.text_revision = text, self.text_revision + 1

    def take_findings(self, findings: list[Mapping[str, Any]]) -> None:
        """Take the whole list."""
        found = listed(findings, inverse_pose(self.base_from_map))
        with self.lock:
            self.findings, self.findings_revision = found, self.findings_revision + 1

    def take_depth(self, image: Callable[[], F32]) -> None:
        """Take the newest depth image, as what gives it, metres."""
        with self.lock:
            self.depth, self.depth_revision = image, self.depth_revision + 1

    def clear_map(self) -> None:
        """Forget the map and what is known of it as a whole."""
        self.grid.clear()
        self.coverage = self.head = None

    def restart(self) -> None:
        """Forget all that a graph said: what it left must not pass for another's."""
        with self.lock:
            self.clear_map()
            self.nodes.clear()
            self.facts = {}
            self.take_text("")
            self.take_findings([])
            self.depth, self.depth_revision = _no_depth, 0

    def stopped(self, now_s: float) -> bool:
        """Whether there were nodes, and none says anything any more."""
        with self.lock:
            return bool(self.nodes) and all(n.gone(now_s) for n in self.nodes.values())

    def state(self, now_s: float) -> dict[str, Any]:
        """What changes all the time, as JSON."""
        with self.lock:
            grid, nodes = self.grid, list(self.nodes.values())
            return {
                "live": self.folder is None,
                "title": self.title,
                "big": self._big(now_s),
                "speed_m_s": self.speed_m_s,
                "force_n": self.force_n,
                "lag_s": self.lag_s,
                "event_rate_per_s": self._event_rate(now_s),
                "coverage": self.coverage or self._map_coverage(now_s),
                "map": {
                    "epoch": grid.epoch,
                    "revision": grid.revision,
                    "cell_m": grid.cell_m,
                    "tile": TILE,
                    "layers": grid.layers,
                    "bounds": grid.bounds,
                    "points": grid.points,
                    "head": self.head,
                },
                "base_from_map": self.base_from_map.tolist(),
                "depth_revision": self.depth_revision,
                "text_revision": self.text_revision,
                "findings_revision": self.findings_revision,
                "nodes": [node.shown(now_s) for node in nodes],
                "notes": self.notes,
                "facts": self.facts,
            }

    def map_answer(self, epoch: str, since: int) -> bytes:
        """Tiles that changed since a revision of an epoch: a JSON header and arrays."""
        with self.lock:
            grid = self.grid
            since = since if epoch == grid.epoch else -1
            found, revision, more = grid.changed(since, _TILES_AT_ONCE)
            header = {
                "epoch": grid.epoch,
                "revision": revision,
                "more": more,
                "tile": TILE,
                "cell_m": grid.cell_m,
                "layers": grid.layers,
                "tiles": [key for key, _ in found],
            }
            return framed(header, *pack(found, grid.layers))

    def depth_answer(self) -> bytes:
        """The newest depth image at half its size: a JSON header and bytes, 0 where there is none.

        Value v is `low_m` + (v − 1) / 254 · (`high_m` − `low_m`).
        """
        with self.lock:
            image, revision = self.depth, self.depth_revision
        small = _halved(image())
        seen = np.isfinite(small)
        low, high = np.percentile(small[seen], (1, 99)).tolist() if seen.any() else (0.0, 1.0)
        scaled = np.clip((small - low) / max(high - low, 1e-9), 0.0, 1.0)
        values = np.where(seen, 1 + 254 * np.nan_to_num(scaled), 0).astype(np.uint8)
        header = {
            "revision": revision,
            "width": small.shape[1],
            "height": small.shape[0],
            "low_m": low,
            "high_m": high,
        }
        return framed(header, values.data)

    def _big(self, now_s: float) -> dict[str, str]:
        if self.folder is None:
            return health.overall(self.nodes, self.speed_m_s, now_s)
        levels = {"conform": "good", "nonconform": "bad", "inconclusive": "warn"}
        count = len(self.findings)
        detail = self.reason or (f"{count} finding{'s' * (count != 1)}" if count else "")
        return {
            "word": self.verdict.upper() or "RESULT",
            "level": levels.get(self.verdict, "idle"),
            "detail": detail or ("no findings" if self.verdict else "not inspected"),
        }

    def _event_rate(self, now_s: float) -> float | None:
        nodes = [node for node in self.nodes.values() if not node.gone(now_s)]
        rate = health.number(nodes, "event_rate_per_s")
        millions = health.number(nodes, "event_rate_mev_s") if rate is None else None
        return rate if millions is None else millions * 1e6

    def _map_coverage(self, now_s: float) -> dict[str, float] | None:
        """Of the map's cells; counted once a second."""
        if now_s - self._covered[0] > 1.0:
            self._covered = (now_s, self.grid.covered())
        share = self._covered[1]
        return None if share is None else {"measured": share, "cell_m": self.grid.cell_m}


def framed(header: Mapping[str, Any], *blocks: memoryview) -> bytes:
    """Length of the header (uint32, little-endian), the header as JSON padded to four, blocks."""
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    return b"".join([struct.pack("<I", len(text)), text, *blocks])


def _halved(image: F32) -> F32:
    """Half the size, the nearest of each four pixels that were measured."""
    height, width = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    above, below = image[:height:2, :width], image[1:height:2, :width]
    nearest = np.fmin(above, below)
    return np.fmin(nearest[:, ::2], nearest[:, 1::2])
