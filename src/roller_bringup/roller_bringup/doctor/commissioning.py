"""How far a cell is set up: its calibration files, step by step as the page on commissioning."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from roller_core.calibration_file import SECTION, check_same_camera
from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.parameter_files import read_parameters

from .result import Result, fault, ok, warning

#: A calibration older than this is worth making again, days.
_OLD_DAYS = 180


@dataclass(frozen=True)
class CellFiles:
    """The files that a cell is started with; None, or not there yet, where there is none."""

    #: Parameter file of the processing nodes, from `roller calibrate`.
    params: Path | None = None
    #: Parameter file with the camera's place on the tool; without it `params` may hold it.
    hand_eye: Path | None = None
    #: ROS camera_info YAML.
    camera_info: Path | None = None
    #: Folders that `roller inspect teach` and `roller calibrate acceptance` wrote.
    golden: Path | None = None
    certificate: Path | None = None


@dataclass(frozen=True)
class _Step:
    """A calibration: its title, its kind in the file, how to make it, and what it found."""

    title: str
    kind: str
    make: str
    figures: Callable[[Mapping[str, Any]], str]
    needed: bool = True


#: In the order of docs/commissioning.md.
_STEPS = (
    _Step("time offset", "time_offset", "calibrate time-offset slow fast",
          lambda r: f"delay {r['event_delay_s'] * 1e3:.3f} ± {r['deviation_s'] * 1e3:.3f} ms"),
    _Step("flat plate", "flat", "calibrate flat plate",
          lambda r: f"plate at {r['plate_m'] * 1e3:.2f} mm"),
    _Step("edge drift", "edge_drift",
          "calibrate edge-drift --sphere SLOW --sphere FAST --radius-mm R --steps SLOW "
          "--steps FAST --step-mm H", lambda r: ""),
    _Step("sphere", "sphere", "calibrate sphere pass1 pass2 --radius-mm R",
          lambda r: f"method {r['method']}", needed=False),
)  # fmt: skip


#: Names of all steps.
STEPS = (
    "intrinsics", "hand-eye", "calibration", *(step.title for step in _STEPS), "skin",
    "golden scan", "acceptance",
)  # fmt: skip


def check_commissioning(files: CellFiles, now: datetime | None = None) -> Iterator[Result]:
    """Judge the cell's files in the order in which they are made.

    Parameters
    ----------
    files : CellFiles
        What the cell has.
    now : datetime, optional
        The time, for the age of calibrations.
    """
    now = now or datetime.now(timezone.utc)
    camera, result = _camera(files.camera_info)
    yield result
    yield _hand_eye(files)
    params = files.params if files.params and files.params.exists() else None
    try:
        records = read_parameters(params, SECTION)
    except RollerError as error:
        yield fault("calibration", str(error), "mend the file, or give another with --cell FILE")
        return
    if params and camera is not None:
        try:
            check_same_camera(params, camera)
        except RollerError as error:
            yield fault("calibration", str(error), "calibrate again with this camera")
    for step in _STEPS:
        yield _judge(step, records.get(step.kind), now, files.params)
    skins = {str(r["skin"]) for r in records.values() if isinstance(r, dict) and r.get("skin")}
    if len(skins) > 1:
        yield warning(
            "skin", f"calibrations are of different skins: {', '.join(sorted(skins))}",
            "calibrate edge drift, flat and sphere again on the skin that is on",
        )  # fmt: skip
    yield _golden(files.golden)
    yield _certificate(files.certificate, records, now)


def next_step(results: Iterable[Result]) -> str:
    """What a cell's set-up goes on with, in a line; empty: nothing is left."""
    for result in results:
        if result.name in STEPS and result.level != "OK":
            return f"next is {result.name}, see docs/commissioning.md: {result.advice}"
    return ""


def _missing(step: str, path: Path | None, option: str, make: str) -> Result:
    """A step whose file wasn't given, or isn't there yet."""
    if path is None:
        return warning(step, "no file given", f"{option}; {make}")
    return warning(step, f"{path} isn't there", make)


def _camera(path: Path | None) -> tuple[Camera | None, Result]:
    make = "roller calibrate intrinsics views --pitch-mm MM --output camera.yaml"
    if path is None or not path.exists():
        return None, _missing("intrinsics", path, "--camera-info FILE", make)
    try:
        camera = Camera.from_yaml(path)
    except RollerError as error:
        return None, fault("intrinsics", str(error), make)
    return camera, ok("intrinsics", str(camera))


def _hand_eye(files: CellFiles) -> Result:
    from roller_driver.ur10.robot_settings import HandEyeSettings

    make = "roller calibrate hand-eye --grid-recording poses --pitch-mm MM --output hand_eye.yaml"
    path = files.hand_eye or files.params
    if path is None or not path.exists():
        return _missing("hand-eye", path, "--hand-eye FILE", make)
    try:
        values = read_parameters(path, "ur10")
        known = {k: v for k, v in values.items() if k in HandEyeSettings.model_fields}
        settings = HandEyeSettings.create(known, str(path))
        records = read_parameters(path, SECTION)
    except RollerError as error:
        return fault("hand-eye", str(error), make)
    if not settings.hand_eye_known:
        return fault("hand-eye", f"{path}: the camera's place isn't set; there is no depth", make)
    record, turn = records.get("hand_eye"), records.get("hand_eye_turn")
    turned = ""
    if isinstance(turn, dict):
        before = record.get("date", "") if isinstance(record, dict) else ""
        if turn.get("date", "") >= before:  # else it was of the place before
            turned = f"; turned by a scan, {turn.get('date', '')[:10]}"
    if isinstance(record, dict) and "rms_m" in record:
        return ok(
            "hand-eye", f"{record['pairs']} pairs, {record['rms_m'] * 1e3:.2f} mm and "
            f"{record['rms_deg']:.2f}° rms, {record.get('date', '')[:10]}{turned}",
        )  # fmt: skip
    return warning("hand-eye", f"{path}: its position is set, by whom isn't recorded{turned}", make)


def _golden(folder: Path | None) -> Result:
    make = "roller inspect teach GOOD_SCAN... --output golden"
    if folder is None or not folder.exists():
        there = f"{folder} isn't there" if folder else "none given"
        return ok("golden scan", f"{there}; only parts judged by good ones need it")
    from roller_inspect.references.golden import GoldenReference

    try:
        golden = GoldenReference.load(folder)
    except RollerError as error:
        return fault("golden scan", str(error), make)
    return ok("golden scan", f"taught by {golden.scans} scans")


def _certificate(folder: Path | None, records: Mapping[str, Any], now: datetime) -> Result:
    """Whether the cell was accepted as it is calibrated now."""
    name = "acceptance"
    make = "roller calibrate acceptance --sphere BAG --radius-mm R --params cell.yaml --output DIR"
    if folder is None or not folder.exists():
        return _missing(name, folder, "--certificate DIR", make)
    path = folder / "certificate.json"
    try:
        found = json.loads(path.read_text())
        accepted, reasons = found["verdict"] == "accepted", ", ".join(found["reasons"])
        errs = ", ".join(
            f"{own['reached']['error_m'] * 1e6:.0f} µm on the {gauge}"
            for gauge, own in found["gauges"].items()
        )
        known = dict(found["calibrations"])
        days = (now - datetime.fromisoformat(found["date"].replace("Z", "+00:00"))).days
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        return fault(name, f"{path}: can't be read ({error})", make)
    if not accepted:
        return fault(name, f"not accepted: {reasons}", "mend that, then scan the gauges again")
    dates = {k: str(r.get("date", "")) for k, r in records.items() if isinstance(r, dict)}
    if dates != known:
        return warning(name, "the cell was calibrated again since", make)
    text = f"accepted, errors of {errs}"
    if days > _OLD_DAYS:
        return warning(name, f"{text}: {days} days old", f"skins wear: {make}")
    return ok(name, text)


def _judge(step: _Step, record: Any, now: datetime, params: Path | None) -> Result:
    # The first makes the file that the others go on with.
    there = params is not None and params.exists()
    params_given = " --params cell.yaml" if there or step is not _STEPS[0] else ""
    make = f"roller {step.make}{params_given} --output cell.yaml"
    if not isinstance(record, dict):
        if not step.needed:
            return ok(step.title, "not calibrated; only the paper's methods need it")
        if there:
            return warning(step.title, f"not in {params}", make)
        return _missing(step.title, params, "--cell FILE", make)
    try:
        found = step.figures(record)
        made = datetime.fromisoformat(str(record["date"]).replace("Z", "+00:00"))
        days = (now - made).days
    except (KeyError, ValueError, TypeError) as error:
        return fault(step.title, f"{params}: its record can't be read ({error})", make)
    text = ", ".join(filter(None, [found, f"{made:%Y-%m-%d}", str(record.get("skin") or "")]))
    if days > _OLD_DAYS:
        return warning(step.title, f"{text}: {days} days old", f"skins wear: {make}")
    return ok(step.title, text)
