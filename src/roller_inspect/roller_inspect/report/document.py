"""What `inspection.json` says of a part."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

from roller_core.calibration_file import SECTION, digest
from roller_core.camera import Camera
from roller_core.digests import data_digest, source_digest
from roller_core.parameter_files import read_parameters
from roller_core.plain_json import plain
from roller_inspect.inspect_stage import Inspected, inspect_parameters
from roller_inspect.judgement import Judged
from roller_inspect.measures import Figure
from roller_inspect.recipe import Recipe

from .texture import texture

SCHEMA = "roller-inspection/1"


@dataclass(frozen=True)
class Scan:
    """Where the points come from, as far as it is known."""

    #: The recording.
    source: Path | None = None
    #: The parameter file, with node `inspect` and the record of calibrations.
    params: Path | None = None
    #: The camera's calibration.
    camera: Camera | None = None
    #: Depth method.
    method: str = ""
    #: Of all stages.
    settings: Mapping[str, Any] = field(default_factory=dict)
    #: Events of the scan, packets that never came.
    events: int | None = None
    lost_packets: int | None = None
    #: What was wrong with the input.
    faults: Sequence[str] = ()


def inspection_document(inspected: Inspected, recipe: Recipe, scan: Scan) -> dict[str, Any]:
    """All of an inspection as JSON takes it; see docs/inspection.md."""
    found, judgement = inspected.found, inspected.judgement
    cover = judgement.coverage
    document: dict[str, Any] = plain(
        {
            "schema": SCHEMA,
            "part": inspected.part,
            "verdict": judgement.verdict,
            "reason": judgement.reason,
            "coverage": {k: v for k, v in asdict(cover).items() if k != "seen"}
            | {"unmeasured": cover.unmeasured if cover.area_m2 else 1.0}
            | {"least": recipe.least_coverage},
            "reference": recipe.reference.model_dump() | {"text": str(recipe.reference)},
            "alignment": found.alignment,
            "findings": [_finding(judged) for judged in judgement.findings],
            "measures": [_measure(figure) for figure in judgement.figures],
            "contact": judgement.contact,
            "uncertainty": inspect_parameters(scan.params).uncertainty.sources(),
            "texture": texture(
                cover, recipe.grid_m, scan.events, found.coverage.area_m2, bool(scan.faults)
            ),
            "recipe": recipe.in_force(),
            "faults": scan.faults,
            "traceability": traceability(inspected.part, recipe, scan),
        }
    )
    return document


def _measure(figure: Figure) -> dict[str, Any]:
    """A figure; one without limits is reported alone."""
    limited = figure.low is not None or figure.high is not None
    return vars(figure) | {"verdict": figure.verdict if limited else None}


def _finding(judged: Judged) -> dict[str, Any]:
    found = dict(vars(judged.finding))
    del found["final"]
    budget = found.pop("budget")
    own = {
        "region": judged.region, "verdict": judged.verdict, "limit": judged.limit,
        "depth_limit_m": judged.depth_limit_m,
    }  # fmt: skip
    return found | own | {"budget_m": budget}


def traceability(part: str, recipe: Recipe, scan: Scan) -> dict[str, Any]:
    """By what a result can be traced to what made it."""
    now = datetime.now(timezone.utc)
    return {
        "part": part,
        "time": now.isoformat(timespec="seconds"),
        "software": {
            "roller": _version("roller_inspect"),
            "source_sha256": software()[:16],
            "python": platform.python_version(),
        }
        | {name: _version(name) for name in ("numpy", "scipy")},
        "method": scan.method,
        "settings_sha256": data_digest(scan.settings),
        "recipe_sha256": recipe.sha256(),
        "camera": "" if scan.camera is None else str(scan.camera),
        **_calibrations(scan.params, now),
        "recording": "" if scan.source is None else scan.source.name,
        "recording_sha256": "" if scan.source is None else digest(scan.source),
        "events": scan.events,
        "packets_lost": scan.lost_packets,
    }


def _calibrations(params: Path | None, now: datetime) -> dict[str, Any]:
    """Skin and calibrations that a parameter file records, with their age."""
    records = read_parameters(params, SECTION)
    out: dict[str, Any] = {"skin": "", "skin_use": "", "calibrations": {}}
    for kind, record in records.items():
        if not isinstance(record, Mapping):
            continue
        out["skin"] = record.get("skin") or out["skin"]
        out["skin_use"] = record.get("skin_use") or out["skin_use"]
        date = str(record.get("date", ""))
        try:
            made = datetime.strptime(date, "%Y-%m-%dT%H:%M:%SZ").replace(tzinfo=timezone.utc)
            date += f" ({(now - made).days} days old)"
        except ValueError:
            pass
        out["calibrations"][kind] = date
    return out


def software() -> str:
    """Tells versions of this package apart, by its source: for results that are kept."""
    return source_digest("roller_core", "roller_emvs", "roller_inspect")


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""
