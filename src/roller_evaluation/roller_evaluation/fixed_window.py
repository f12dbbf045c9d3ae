"""Windows of one length with one number of events: our methods against dense volumes."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.pipeline import DepthPipeline
from roller_inspect.results.truth_tally import TruthTally

from .cases import Case, depth_settings
from .dense_reference import PLANES, dense_reference
from .figures import object_errors, time_columns
from .rows import Row
from .scans import Scan
from .windows import Piece, window_pieces

METHODS = ("focus", "bma")
REFERENCE = f"3 dense volumes of {PLANES} planes"
#: Windows of one length start at this many places.
_OFFSETS = 10

Maps = Mapping[int, DepthMap]


def measure_fixed_window(case: Case, scan: Scan) -> list[Row]:
    """Times and errors of `focus`, `bma` and the dense reference on the same windows.

    The case's settings: `window_s`, `events` a window, `windows`, and how many of them the
    `reference` works through. `faster` is the reference's time by the method's, and errors are
    taken, over the reference's windows. For `bma`: how far its depths are from the reference's.

    Returns
    -------
    list of dict
        A row a method and one of the reference; none if no window holds so many events.
    """
    s = case.settings
    pieces = window_pieces(scan, s["window_s"], s["window_s"] / _OFFSETS, s["events"])
    if not pieces:
        return []
    chosen = np.rint(np.linspace(0, len(pieces) - 1, min(s["windows"], len(pieces)))).astype(int)
    pieces = [pieces[k] for k in np.unique(chosen)]
    few = np.rint(np.linspace(0, len(pieces) - 1, min(s["reference"], len(pieces)))).astype(int)
    referred = [pieces[k] for k in np.unique(few)]
    settings = {m: depth_settings(m, **{"window.rule": "all"}) for m in METHODS}
    found: dict[str, dict[int, DepthMap]] = {}
    rows: dict[str, Row] = {}
    for method, chosen_settings in settings.items():
        _depth_map(chosen_settings, pieces[0])  # compile
        cpu = time.process_time()
        maps = [(p.start_ns, _depth_map(chosen_settings, p)) for p in pieces]
        cpu_ms = 1e3 * (time.process_time() - cpu) / len(pieces)
        found[method] = {start: m for start, m in maps if m is not None}
        rows[method] = _times(found[method]) | {"cpu_ms": round(cpu_ms, 3)}
    # Last, as its gigabytes of volumes push what the others use out of caches and memory.
    dense_reference(referred[0], settings["bma"])  # compile
    plain = {piece.start_ns: dense_reference(piece, settings["bma"]) for piece in referred}
    plain_ms = float(np.median([m.milliseconds["total"] for m in plain.values()]))
    for method in METHODS:
        same = {start: m for start, m in found[method].items() if start in plain}
        rows[method] |= _errors(same, scan)
        if same:
            own = np.median([m.milliseconds["total"] for m in same.values()])
            rows[method]["faster"] = round(plain_ms / float(own), 2)
    rows["bma"] |= distance(found["bma"], plain)
    rows[REFERENCE] = _times(plain) | _errors(plain, scan) | {"faster": 1.0}
    shared = {"object": scan.name, "events": s["events"], "window_s": s["window_s"]}
    return [{**shared, "method": method, **row} for method, row in rows.items()]


def distance(found: Maps, reference: Maps) -> dict[str, Any]:
    """How far depth maps are from the reference's, over all windows that both have.

    Returns
    -------
    dict
        Median and 95th percentile of the difference where both measured, µm, and the masks'
        intersection over union.
    """
    apart = []
    both = either = 0
    for start, plain in reference.items():
        if start in found:
            a, b = np.isfinite(found[start].depth), np.isfinite(plain.depth)
            both, either = both + int((a & b).sum()), either + int((a | b).sum())
            difference = found[start].depth.astype(np.float64) - plain.depth
            apart.append(np.abs(difference[a & b]) * 1e6)
    um = np.concatenate(apart) if apart else np.empty(0)
    return {
        "apart_median_um": round(float(np.median(um)), 3) if len(um) else None,
        "apart_p95_um": round(float(np.percentile(um, 95)), 3) if len(um) else None,
        "mask_iou": round(both / either, 4) if either else None,
    }


def _depth_map(settings: DepthSettings, piece: Piece) -> DepthMap | None:
    pipeline = DepthPipeline(settings, piece.scan.camera, piece.scan.track)
    pipeline.add_events(piece.events)
    found = (m for m in pipeline.results(flush=True) if isinstance(m, DepthMap))
    return next(found, None)


def _times(maps: Maps) -> Row:
    return {"windows": len(maps)} | time_columns([m.milliseconds["total"] for m in maps.values()])


def _errors(maps: Maps, scan: Scan) -> Row:
    tally = TruthTally(scan.truth)
    for depth_map in maps.values():
        tally.add(depth_map)
    return object_errors(tally.summary(), scan.name)
