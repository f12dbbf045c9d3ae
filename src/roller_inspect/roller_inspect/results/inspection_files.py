"""The files of an inspection."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from roller_core.plain_json import to_text
from roller_inspect.exports.height_files import write_sdf, write_x3p
from roller_inspect.exports.pdf import write_pdf
from roller_inspect.exports.tables import write_findings_csv, write_height_png, write_png
from roller_inspect.height_map import CONTINUED, OUTSIDE, HeightMap
from roller_inspect.pieces import Found
from roller_inspect.report.map_section import Pictured
from roller_inspect.report.page import page
from roller_inspect.report.pictures import map_picture

from .summary import inspection_summary

#: Width of `deviation.png`.
_PICTURE_PX = 800


def write_inspection(
    folder: Path,
    document: Mapping[str, Any],
    found: Found,
    tolerance_m: float,
    exports: Collection[str] = (),
) -> None:
    """Write `inspection.json`, `inspection.html`, `findings.csv`, the map and its exports.

    Parameters
    ----------
    folder : path
        Where they go.
    document : mapping
        See `inspection_document`.
    found : Found
        Map and deviation.
    tolerance_m : float
        Depth that most of the part may have, for the colours of the page.
    exports : collection of str
        Of `roller_inspect.exports.EXPORTS`.
    """
    (folder / "inspection.json").write_text(to_text(document), encoding="utf-8")
    write_findings_csv(folder / "findings.csv", document["findings"])
    grid = found.height_map if found.height_map is not None else _empty()
    grid.save(folder / "height_map.npz")
    # Guesses are in the archive alone, where each cell says that it is one.
    known = np.where(grid.state >= CONTINUED, grid.height_m, np.nan).astype(np.float32)
    write_height_png(folder / "height_map.png", grid.x_m, grid.y_m, known)
    if "x3p" in exports:
        version = document["traceability"]["software"]["roller"]
        write_x3p(
            folder / "height_map.x3p", grid.x_m, grid.y_m, known, version, document["part"],
            _calibrated(document["traceability"]["calibrations"]),
        )  # fmt: skip
    if "sdf" in exports:
        write_sdf(folder / "height_map.sdf", grid.x_m, grid.y_m, known)
    pictured = picture = None
    if found.height_map is not None and found.deviation_m is not None:
        pictured = Pictured(found.height_map, found.deviation_m, tolerance_m)
        box = tuple(_span((grid.state != OUTSIDE).any(axis=a)) for a in (1, 0))
        picture = map_picture(found.deviation_m[box], grid.state[box], 2 * tolerance_m, _PICTURE_PX)
        write_png(folder / "deviation.png", picture[..., ::-1])
    # Names may hold bytes that are no text.
    html = page(document, pictured).encode(errors="backslashreplace").decode()
    (folder / "inspection.html").write_text(html, encoding="utf-8")
    if "pdf" in exports:
        write_pdf(folder / "inspection.pdf", html, _text(document), picture)


def _calibrated(calibrations: Mapping[str, str]) -> str:
    """The oldest date of some calibrations; empty if one isn't known, or there is none."""
    dates = [text.split(" ")[0] for text in calibrations.values()]
    try:
        return min(dates, key=lambda date: datetime.strptime(date, "%Y-%m-%dT%H:%M:%SZ"))
    except ValueError:
        return ""


def _text(document: Mapping[str, Any]) -> list[str]:
    """What the page says, line by line."""
    lines = ["Inspection", *inspection_summary(document).splitlines()]
    lines += [*document["contact"], *(f"fault: {fault}" for fault in document["faults"])]
    for name in ("texture", "uncertainty", "alignment", "traceability", "recipe"):
        lines += ["", name, *to_text(document[name]).splitlines()]
    return lines


def _span(seen: npt.NDArray[np.bool_]) -> slice:
    """From the first to the last that was seen; all if none was."""
    at = np.flatnonzero(seen)
    return slice(at[0], at[-1] + 1) if len(at) else slice(None)


def _empty() -> HeightMap:
    """One cell outside the scan: the map of a scan without points."""
    nothing = np.full((1, 1), np.nan, np.float32)
    return HeightMap(
        np.zeros(1),
        np.zeros(1),
        nothing,
        nothing,
        np.full((1, 1), OUTSIDE, np.uint8),
        np.zeros((1, 1), np.uint16),
        np.eye(4),
    )
