"""A result folder as a scene."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from roller_core.errors import RollerError
from roller_core.outputs import DEVIATION, bag_topic
from roller_core.transforms import inverse_pose
from roller_emvs.ply import ply_rows
from roller_inspect.height_map import HeightMap

from .grid import F32, OUTSIDE, Grid
from .scene import Scene

#: A map of a result may be larger than one that grows: 6 million cells.
_MOST_TILES = 1500
#: Points that are read at once.
_POINTS_AT_ONCE = 200_000
#: Files of a folder that are offered, by ending.
_OFFERED = frozenset(
    ".html .pdf .csv .json .png .ply .npz .x3p .sdf .txt .brf .mcap .yaml .qif .stl .svg".split()
)


class ResultError(RollerError):
    """A folder without results, or with results that can't be read."""


def is_result(path: Path) -> bool:
    """Whether a folder has what replay, inspection and demonstration write."""
    return any((path / name).is_file() for name in ("surface.ply", "height_map.npz"))


def read_result(folder: Path, title: str = "") -> Scene:
    """Read a result folder; what a replay without inspection doesn't have stays empty.

    Raises
    ------
    ResultError, HeightMapError
        If there is neither a height map nor a surface, or it can't be read.
    """
    scene = Scene(title or folder.resolve().name, folder, _MOST_TILES)
    try:
        if (folder / "height_map.npz").is_file():
            _read_height_map(folder / "height_map.npz", scene)
            _read_deviation(folder / "result", scene)
        elif (folder / "surface.ply").is_file():
            _read_surface(folder / "surface.ply", scene.grid)
        else:
            raise ResultError(
                f"{folder}: no result there (neither surface.ply nor height_map.npz); "
                "`roller replay INPUT --output DIR` makes one"
            )
    except (OSError, ValueError, KeyError) as error:
        raise ResultError(f"{folder}: the result can't be read ({error})") from error
    _read_report(_json(folder / "report.json", scene), scene)
    _read_inspection(_json(folder / "inspection.json", scene), scene)
    text = folder / "braille.txt"
    if text.is_file():
        scene.take_text(text.read_text(errors="replace"))
    return scene


def offered_files(folder: Path) -> Iterator[tuple[str, int]]:
    """Names, relative, and sizes of the files of a result that may be taken, in two levels.

    Pages to read come first.
    """
    found = [*folder.glob("*"), *folder.glob("*/*")]
    for path in sorted(found, key=lambda path: (path.suffix not in (".html", ".pdf"), path)):
        name = path.relative_to(folder).as_posix()
        if path.suffix not in _OFFERED or path.is_symlink() or not path.is_file():
            continue
        if not any(part.startswith(".") for part in name.split("/")):
            yield name, path.stat().st_size


def _read_height_map(path: Path, scene: Scene) -> None:
    found = HeightMap.load(path)
    x, y, shape = found.x_m, found.y_m, found.shape
    if min(shape) < 2 or not np.isfinite(found.base_from_map).all():
        raise ResultError(f"{path}: has fewer than 2 × 2 cells, or no place")
    state, layers = found.state, {"height": found.height_m, "sigma": found.sigma_m}
    cell_m = found.step_m
    times = 1
    while -(-shape[0] // 64) * -(-shape[1] // 64) > _MOST_TILES * times * times:
        times *= 2
    if times > 1:
        layers, state = _thinned(layers, state, times)
    grid = scene.grid = Grid(cell_m * times, _MOST_TILES)
    # The map's corner on a corner of the grid; what it is off is said by the transform.
    x0, y0 = (round((v[0] - cell_m / 2) / grid.cell_m) for v in (x, y))
    off = np.eye(4)
    off[:2, 3] = x[0] - cell_m / 2 - x0 * grid.cell_m, y[0] - cell_m / 2 - y0 * grid.cell_m
    scene.base_from_map = found.base_from_map @ off
    grid.put(x0, y0, layers, state)


def _read_deviation(bag: Path, scene: Scene) -> None:
    """Deviations from the reference, which the result's bag has cell by cell."""
    if not (bag / "metadata.yaml").is_file():
        return
    # Some 70 MB that a live page does without.
    from roller_core.bags import typestore
    from roller_recording.reading.bag_reader import BagReader
    from roller_recording.reading.base import RecordingError

    map_from_base, store = inverse_pose(scene.base_from_map), typestore()
    for item in BagReader(bag).messages({bag_topic(DEVIATION)}):
        if isinstance(item, RecordingError):
            scene.notes.append(str(item))
            continue
        cloud: Any = store.deserialize_cdr(item.data, "sensor_msgs/msg/PointCloud2")
        names = [field.name for field in cloud.fields]
        rows = np.frombuffer(cloud.data, np.float32).reshape(-1, len(names))
        xyz = rows[:, :3] @ map_from_base[:3, :3].T + map_from_base[:3, 3]
        deviation = {"deviation": rows[:, names.index("deviation")]}
        # The states are those of the height map.
        scene.grid.add(xyz[:, 0], xyz[:, 1], deviation, OUTSIDE, looked_at=False)
    scene.grid.drop_outside()  # of the run-in, which the height map leaves out


def _thinned(layers: dict[str, F32], state: Any, times: int) -> tuple[dict[str, F32], Any]:
    """Every cell of `times` × `times`: the best state, and the mean of the cells that have it."""
    height, width = -(-state.shape[0] // times), -(-state.shape[1] // times)

    def blocks(values: Any, fill: Any) -> Any:
        padded = np.full((height * times, width * times), fill, values.dtype)
        padded[: values.shape[0], : values.shape[1]] = values
        return padded.reshape(height, times, width, times).swapaxes(1, 2).reshape(height, width, -1)

    states = blocks(state, OUTSIDE)
    best = states.max(axis=2)
    out = {}
    for name, values in layers.items():
        several = blocks(values, np.nan)
        counts = np.isfinite(several) & (states == best[:, :, None])
        total = counts.sum(axis=2)
        sums = np.where(counts, several, 0.0).sum(axis=2, dtype=np.float64)
        mean = np.divide(sums, total, out=np.full(total.shape, np.nan), where=total > 0)
        out[name] = mean.astype(np.float32)
    return out, best


def _read_surface(path: Path, grid: Grid) -> None:
    rows = ply_rows(path)
    for begin in range(0, len(rows), _POINTS_AT_ONCE):
        part = rows[begin : begin + _POINTS_AT_ONCE]
        values: dict[str, F32] = {
            name: part[name].astype(np.float32)
            for name in ("height", "sigma")
            if name in (rows.dtype.names or ())
        }
        grid.add(part["x"], part["y"], values)


def _json(path: Path, scene: Scene) -> dict[str, Any]:
    """A JSON file of the folder; one that can't be read is noted on the page."""
    if not path.is_file():
        return {}
    try:
        data = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        scene.notes.append(f"{path.name} can't be read: {error}")
        return {}
    return data if isinstance(data, dict) else {}


def _read_report(report: dict[str, Any], scene: Scene) -> None:
    if report.get("title"):
        scene.title = str(report["title"])[:200]
    if report.get("method"):
        scene.facts["method"] = str(report["method"])
    totals = report.get("totals") or {}
    for key in ("events", "surface_points", "lost_packets"):
        if isinstance(totals.get(key), int):
            scene.facts[key.replace("_", " ")] = f"{totals[key]:,}"
    scene.notes += [str(fault)[:500] for fault in report.get("faults") or []][:20]


def _read_inspection(inspection: dict[str, Any], scene: Scene) -> None:
    if not inspection:
        return
    scene.verdict = str(inspection.get("verdict", ""))[:40]
    coverage = inspection.get("coverage")
    if isinstance(coverage, dict):
        scene.coverage = {
            str(k): float(v)
            for k, v in coverage.items()
            if isinstance(v, int | float) and np.isfinite(v)
        }
    for key in ("part", "reference"):
        if value := inspection.get(key):
            said = value.get("text", json.dumps(value)) if isinstance(value, dict) else value
            scene.facts[key] = str(said)[:200]
    scene.reason = str(inspection.get("reason", ""))[:300]
    findings = inspection.get("findings")
    if isinstance(findings, list):
        scene.take_findings([f for f in findings if isinstance(f, dict)])
