"""The truth of a simulated scan beside its recording: heights in one file, the rest in another."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from roller_core.text_file import TextFileError, read_yaml

from .cell_settings import VirtualCellSettings
from .errors import TruthError
from .relief import BrailleMark, DefectMark, HeightMap, Region
from .truth import Truth

MAPS_FILE = "truth.npz"
TEXT_FILE = "truth.yaml"
_VERSION = 1


def save_truth(truth: Truth, folder: Path | str) -> None:
    """Write `truth.npz` and `truth.yaml` into a folder."""
    save_maps(truth, folder)
    save_text(truth, folder)


def save_maps(truth: Truth, folder: Path | str) -> None:
    """Write `truth.npz`, which takes a moment."""
    file = Path(folder) / MAPS_FILE
    np.savez_compressed(file, skin=truth.skin.height, relief=truth.relief.height)


def save_text(truth: Truth, folder: Path | str) -> None:
    """Write `truth.yaml`."""
    data = {
        "version": _VERSION,
        "scene": truth.settings.scene.name,
        "text": truth.text,
        "press_mm": truth.press_mm,
        "grid": {
            "file": MAPS_FILE,
            "unit": "m",
            "frame": "plate",
            "rows": "y",
            "x0": truth.skin.x0,
            "y0": truth.skin.y0,
            "step": truth.skin.step,
        },
        "plate_origin_in_base": truth.origin_m.tolist(),
        "objects": [asdict(r) for r in truth.regions],
        "cells": [asdict(m) for m in truth.marks],
        "defects": [asdict(m) for m in truth.defects],
        "hand_eye": truth.hand_eye.tolist(),
        "start_ros_ns": truth.start_ros_ns,
        "duration_ns": truth.duration_ns,
        "event_delay_ns": truth.event_delay_ns,
        "settings": truth.settings.model_dump(),
    }
    plain = json.loads(json.dumps(data))  # NumPy's floats become Python's
    file = Path(folder) / TEXT_FILE
    file.write_text(yaml.safe_dump(plain, sort_keys=False, allow_unicode=True))


def truth_beside(source: Path) -> Truth | None:
    """The truth of a bag that has one beside it; None for other recordings.

    Whoever asks again gets the same, which is not to be changed.
    """
    files = (source / TEXT_FILE, source / MAPS_FILE)
    if not files[0].is_file():
        return None
    stats = [file.stat() for file in files if file.is_file()]
    return _load_once(source, *((s.st_mtime_ns, s.st_size) for s in stats))


def load_truth(folder: Path | str) -> Truth:
    """Read the truth beside a recording.

    Raises
    ------
    TruthError
        If it isn't there or can't be read.
    """
    folder = Path(folder)
    if not (folder / TEXT_FILE).is_file():
        raise TruthError(f"{folder}: no {TEXT_FILE}; only simulated recordings have a truth")
    try:
        data: dict[str, Any] = read_yaml(folder / TEXT_FILE)
        grid = data["grid"]
        where = (grid["x0"], grid["y0"], grid["step"])
        if not (folder / grid["file"]).is_file():  # np.load waits for a pipe's end
            raise TruthError(f"{folder / grid['file']}: there is no such file")
        with np.load(folder / grid["file"]) as maps:
            skin = HeightMap(maps["skin"], *where)
            if "relief" not in maps:
                raise KeyError("relief")
        truth = Truth(
            VirtualCellSettings.create(_known(data["settings"]), f"{folder / TEXT_FILE}"),
            data["press_mm"],
            skin,
            partial(_load_relief, folder / grid["file"], where),
            tuple(Region(**r) for r in data["objects"]),
            data["text"],
            tuple(BrailleMark(**m) for m in data["cells"]),
            tuple(_defect(m) for m in data.get("defects", ())),
        )
        truth.start_ros_ns = int(data["start_ros_ns"])
    except TextFileError as error:
        raise TruthError(str(error)) from error
    except (OSError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise TruthError(f"{folder}: the truth can't be read ({error})") from error
    return truth


def _load_relief(file: Path, where: tuple[float, float, float]) -> HeightMap:
    try:
        with np.load(file) as maps:
            return HeightMap(maps["relief"], *where)
    except (OSError, KeyError, ValueError) as error:
        raise TruthError(f"{file}: the relief can't be read ({error})") from error


@lru_cache(maxsize=1)
def _load_once(folder: Path, *_: tuple[int, int]) -> Truth:
    """Load a truth, with what says that its files are the same as before."""
    return load_truth(folder)


def _known(settings: dict[str, Any]) -> dict[str, Any]:
    """Settings of a file, maybe an older one, without what is a constant by now."""
    found = {k: v for k, v in settings.items() if k in VirtualCellSettings.model_fields}
    for name, group in found.items():
        if isinstance(group, dict):
            known = type(VirtualCellSettings.default_of(name)).model_fields
            found[name] = {k: v for k, v in group.items() if k in known}
    return found


def _defect(entry: dict[str, Any]) -> DefectMark:
    return DefectMark(**{**entry, "outline": tuple((x, y) for x, y in entry["outline"])})
