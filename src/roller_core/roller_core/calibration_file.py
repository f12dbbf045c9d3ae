"""Calibration files: parameters that the nodes load, and a record of how they were found.

The file is a ROS 2 parameter file. Its section `calibration` holds, by kind, what a machine may
want to know; no node has that name, so it changes nothing.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import yaml

from .camera import Camera, CameraError, OtherCameraError
from .errors import RollerError, SettingsError
from .marked_file import SEAL, write_marked_file
from .parameter_files import node_name, read_parameters, read_sections
from .settings import nested

#: Section of the record, and version of its form.
SECTION, VERSION = "calibration", 1
#: How every calibration file begins: no other file is ever replaced.
_MARK = "# roller calibrate"
#: Nodes that look at the camera their parameters were found with.
_CAREFUL = ("emvs", "surface", "braille")


class CalibrationError(RollerError):
    """A calibration that can't be made of what was given."""


def calibration_record(
    skin: str,
    inputs: Sequence[Path],
    camera: Camera | None,
    **results: Any,
) -> dict[str, Any]:
    """What a calibration file says of a calibration.

    Parameters
    ----------
    skin : str
        Name of the skin; empty where nobody said.
    inputs : sequence of path
        Recordings and files that were used.
    camera : Camera or None
        The camera they are from.
    results : dict
        What was found; numbers, texts, lists of one kind or dicts of them.
    """
    found: dict[str, Any] = {
        "version": VERSION,
        "date": f"{datetime.now(timezone.utc):%Y-%m-%dT%H:%M:%SZ}",
        "skin": skin,
        "data": [path.name for path in inputs],
        "sha256": [digest(path) for path in inputs],
    }
    if camera is not None:
        found["camera"] = {
            "width": camera.width,
            "height": camera.height,
            "model": camera.model,
            "intrinsics": [float(v) for v in (camera.fx, camera.fy, camera.cx, camera.cy)],
            "distortion": [float(v) for v in camera.distortion],
        }
    return found | results


def digest(path: Path) -> str:
    """SHA-256 of a file, or of all files of a folder with their names.

    Raises
    ------
    CalibrationError
        If it can't be read.
    """
    if not path.exists():
        raise CalibrationError(f"{path}: there is no such file or folder")
    total = hashlib.sha256()
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    try:
        for file in files:
            if path.is_dir():
                total.update(os.fsencode(file.relative_to(path)) + b"\n")
            with file.open("rb") as stream:
                while block := stream.read(1 << 20):
                    total.update(block)
    except OSError as error:
        raise CalibrationError(f"{path}: can't be read ({error.strerror})") from error
    return total.hexdigest()


def write_calibration(
    path: Path,
    kind: str,
    lines: Sequence[str],
    parameters: Mapping[str, Mapping[str, Any]],
    record: Mapping[str, Any],
    base: Path | None = None,
) -> None:
    """Write a calibration file.

    Nodes that take events get the camera that the values hold for, and refuse another.

    Parameters
    ----------
    path : path
        The file; its folder is made.
    kind : str
        What was calibrated, such as `sphere`.
    lines : sequence of str
        Lines for people.
    parameters : mapping
        Values by node.
    record : mapping
        See `calibration_record`.
    base : path, optional
        A parameter file whose entries are carried over where they aren't replaced.

    Raises
    ------
    UnwritableOutputError
        If it can't be written, or if a file stands there that no calibration wrote, that was
        changed since, or that holds what is neither found anew nor carried over.
    """
    sections: dict[str, Any] = _sections(base) if base else {}
    for node, values in {**parameters, SECTION: {kind: dict(record)}}.items():
        sections[node] = nested({**sections.get(node, {}), **values})
        if node in _CAREFUL and (camera := record.get("camera")):
            size = [float(camera["width"]), float(camera["height"])]
            sections[node]["calibrated_camera"] = size + camera["intrinsics"] + camera["distortion"]
    head = [
        f"{_MARK} {kind}, {record['date']}",
        *(f"# {line}" for line in lines),
        f"# from {', '.join(record['data'])}",
        *([f"# skin: {record['skin']}"] if record["skin"] else []),
        *([f"# all else is from {base.name}"] if base else []),
    ]
    content = {_key(node): {"ros__parameters": values} for node, values in sections.items()}
    body = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    known = base is not None and path.exists() and path.samefile(base)
    stays = "" if known else _lost(path, sections)
    text = "\n".join(head) + "\n" + body + f"# {SEAL}\n"
    write_marked_file(path, text, _MARK, known, stays)


def _lost(path: Path, sections: Mapping[str, Any]) -> str:
    """What a calibration file holds that new sections don't, in words; empty: nothing."""
    try:
        before = _sections(path) if path.is_file() else {}
    except SettingsError:
        return ""  # not one of ours
    lost = [
        f"the calibration '{name}'" if node == SECTION else f"'{name}' of {_key(node)}"
        for node in sorted(before, key=lambda node: node != SECTION)
        for name in before[node]
        if name not in sections.get(node, {})
    ]
    if not lost:
        return ""
    more = f" and {len(lost) - 1} more" if len(lost) > 1 else ""
    return f"holds {lost[0]}{more}, which --params {path} would carry over"


def read_record(path: Path, kind: str) -> dict[str, Any] | None:
    """What a parameter file records of a kind of calibration; None where there is nothing.

    Raises
    ------
    SettingsError
        If the file can't be read, or is no parameter file.
    """
    found = read_parameters(path, SECTION).get(kind)
    if found is not None and not isinstance(found, dict):
        raise SettingsError(f"parameters {path}: '{SECTION}' has no record of '{kind}'")
    return found


def check_same_camera(path: Path | None, camera: Camera) -> None:
    """Refuse a parameter file that was calibrated with another camera.

    Parameters
    ----------
    path : path or None
        The file; without a record of a calibration, and without a node's `calibrated_camera`, it
        fits any camera.
    camera : Camera
        The camera of the recording at hand.

    Raises
    ------
    OtherCameraError
        Naming both.
    SettingsError
        If the file can't be read, or what it says of the camera.
    """
    if path is None:
        return
    for kind, found in read_parameters(path, SECTION).items():
        if not isinstance(found, dict) or "camera" not in found:
            continue
        try:
            values = found["camera"]
            fx, fy, cx, cy = (float(v) for v in values["intrinsics"])
            made = Camera(
                int(values["width"]), int(values["height"]), fx, fy, cx, cy,
                tuple(values["distortion"]), values["model"],
            )  # fmt: skip
        except (KeyError, TypeError, ValueError, CameraError) as error:
            raise SettingsError(
                f"{path}: the camera of calibration '{kind}' can't be read ({error})"
            ) from error
        if not same_camera(made, camera):
            raise OtherCameraError(
                f"{path}: '{kind}' was calibrated with another camera ({made}) than this "
                f"recording's ({camera}); calibrate again"
            )
    # As the nodes look at it, where the record was left out.
    for node in _CAREFUL:
        wanted = read_parameters(path, node).get("calibrated_camera", [0.0])
        try:
            same = not any(wanted) or camera.same_intrinsics([float(v) for v in wanted])
        except (TypeError, ValueError) as error:
            raise SettingsError(
                f"{path}: calibrated_camera of '{node}' can't be read ({error})"
            ) from error
        if not same:
            raise OtherCameraError(
                f"{path}: the parameters of '{node}' were calibrated with another camera "
                f"(calibrated_camera) than this recording's ({camera}); calibrate again"
            )


def same_camera(one: Camera, other: Camera) -> bool:
    """Whether two calibrations are of the same camera and lens."""
    return one.model == other.model and one.same_intrinsics(other.intrinsics)


def _sections(path: Path) -> dict[str, Any]:
    """All nodes of a parameter file with their parameters."""
    return {node: read_parameters(path, node) for node in map(node_name, read_sections(path))}


def _key(node: str) -> str:
    """A node's name as parameter files write it: in any namespace."""
    return "/**" if node == "**" else f"/**/{node}"
