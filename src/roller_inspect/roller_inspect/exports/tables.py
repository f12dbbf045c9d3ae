"""Findings as CSV; a height map as a 16-bit picture with its scale."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

#: Value of a pixel without a height, and the largest that stands for one.
_NONE, _MOST = 0, 65535
_SIZES = ("length_m", "width_m", "depth_m", "area_m2", "volume_m3")
_HEAD = (
    "id", "kind", "region", "x_m", "y_m", "z_m",
    *(name for size in _SIZES for name in (size, f"U_{size}")),
    "confidence", "verdict", "rim_m", "at_least",
)  # fmt: skip


def write_findings_csv(path: Path, findings: Iterable[Mapping[str, Any]]) -> None:
    """Write findings as `inspection.json` has them, one a row; U_ is the uncertainty, k = 2."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(_HEAD)
        for found in findings:
            sizes = [v for name in _SIZES for v in (found[name], found["uncertainty"].get(name))]
            writer.writerow(
                [found["id"], found["kind"], found["region"], *found["center_m"], *sizes]
                + [
                    found["confidence"],
                    found["verdict"],
                    found["rim_m"],
                    " ".join(found["at_least"]),
                ]
            )


def write_png(path: Path, pixels: npt.NDArray[Any]) -> None:
    """Write a picture, blue first; OpenCV itself dies of a path that isn't UTF-8."""
    path.write_bytes(cv2.imencode(".png", pixels)[1].tobytes())


def write_height_png(
    path: Path,
    x_m: npt.NDArray[np.float64],
    y_m: npt.NDArray[np.float64],
    height_m: npt.NDArray[np.float32],
) -> None:
    """Write a 16-bit grey picture, and beside it `<name>.json` with what its values mean.

    The first row is the farthest y, so that the picture looks as from above. Parameters as of
    `write_x3p`.
    """
    seen = np.isfinite(height_m)
    low = float(np.nanmin(height_m)) if seen.any() else 0.0
    high = float(np.nanmax(height_m)) if seen.any() else 0.0
    # A nanometre at least; so fine that no noise is lost.
    step = max((high - low) / (_MOST - 1), 1e-9)
    pixels = np.full(height_m.shape, _NONE, np.uint16)
    pixels[seen] = 1 + np.rint((height_m[seen] - low) / step).clip(0, _MOST - 1).astype(np.uint16)
    write_png(path, pixels[::-1])
    scale = {
        "formula": "height_m = low_m + (value - 1) * step_m; value 0: no height",
        "low_m": low,
        "step_m": step,
        "x_m": [float(x_m[0]), float(x_m[-1])],
        "y_m": [float(y_m[-1]), float(y_m[0])],
        "axes": "columns: x from the first to the second; rows: y from the first to the second",
    }
    path.with_name(path.name + ".json").write_text(json.dumps(scale, indent=1) + "\n")
