"""The fixed case: windows of one length with one number of events, fast against plain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_inspect.results.truth_tally import TruthTally

from .cases import depth_settings
from .measure import depth_maps, mean_error, of_object, time_figures
from .options import BenchOptions
from .reference import PLANES, dense_reference
from .resampling import Piece, window_pieces
from .scans import Scan

METHODS = ("focus", "bma")
#: Windows of one length start at this many places.
_OFFSETS = 10


def fixed_pieces(scans: Sequence[Scan], options: BenchOptions) -> list[list[Piece]]:
    """Windows that follow each other, chain by chain; the chains overlap.

    As many windows as `fixed_windows` asks for, spread over the scans, each with exactly
    `fixed_events` events.
    """
    chains: list[list[Piece]] = []
    length = options.fixed_window_s
    for scan in scans:
        pieces = window_pieces(scan, length, length / _OFFSETS, options.fixed_events)
        by_offset: dict[int, list[Piece]] = {}
        for piece in pieces:
            phase = (piece.start_ns - pieces[0].start_ns) % round(length * 1e9)
            by_offset.setdefault(phase, []).append(piece)
        chains += [chain for _, chain in sorted(by_offset.items())]
    return _spread(chains, options.fixed_windows)


def _spread(chains: list[list[Piece]], count: int) -> list[list[Piece]]:
    """Some chains, evenly spread, that hold so many windows."""
    order = np.random.default_rng(0).permutation(len(chains))
    kept, windows = [], 0
    for k in order:
        if windows >= count:
            break
        kept.append(chains[int(k)])
        windows += len(chains[int(k)])
    return kept


def run_fixed(chains: Sequence[Sequence[Piece]], options: BenchOptions) -> dict[str, Any]:
    """Time `focus` and `bma` and the plain reference on the same windows.

    Parameters
    ----------
    chains : sequence of sequences of Piece
        See `fixed_pieces`.
    options : BenchOptions
        Number of events, and of windows for the reference.

    Returns
    -------
    dict
        Times, ratios, distance of `bma` from the reference, errors against truth.
    """
    if not chains:
        return {"windows": 0}
    settings = {m: _settings(m, options) for m in METHODS}
    pieces = [piece for chain in chains for piece in chain]
    # The reference's windows are spread over all of them.
    steps = np.linspace(0, len(pieces) - 1, min(options.reference_windows, len(pieces)))
    chosen = {int(k) for k in np.rint(steps)}
    dense_reference(chains[0][0], settings["bma"])
    for method in METHODS:  # compile
        depth_maps(settings[method], chains[0])
    spent: dict[str, list[list[float]]] = {method: [] for method in METHODS}
    plain_spent: list[float] = []
    same: dict[str, list[float]] = {name: [] for name in METHODS}
    maps: dict[str, list[tuple[Piece, DepthMap]]] = {name: [] for name in (*METHODS, "reference")}
    found: dict[str, dict[int, DepthMap]] = {method: {} for method in METHODS}
    for _ in range(max(options.repeats, 1)):
        for method in METHODS:
            run, first = [], 0
            for chain in chains:
                numbers = {piece.start_ns: first + k for k, piece in enumerate(chain)}
                first += len(chain)
                for depth_map in depth_maps(settings[method], chain):
                    run.append(depth_map.milliseconds["total"])
                    found[method][numbers[depth_map.start_ns]] = depth_map
            spent[method].append(run)
    # Last, as its gigabytes of volumes push what the others use out of caches and memory.
    for number in sorted(chosen):
        piece = pieces[number]
        plain = dense_reference(piece, settings["bma"])
        plain_spent.append(plain.milliseconds["total"])
        maps["reference"].append((piece, plain))
        for method in METHODS:
            if number in found[method]:
                maps[method].append((piece, found[method][number]))
                same[method].append(found[method][number].milliseconds["total"])
    plain_ms = float(np.median(plain_spent))
    out: dict[str, Any] = {
        "events": options.fixed_events,
        "window_ms": options.fixed_window_s * 1e3,
        "windows": len(pieces),
        "reference_windows": len(plain_spent),
        "objects": sorted({piece.scan.name for piece in pieces}),
        "speed": pieces[0].scan.speed,
        "methods": {},
        "reference": {
            "what": f"3 dense volumes of {PLANES} planes",
            **time_figures([plain_spent]),
            "error": _error(maps["reference"]),
        },
    }
    for method in METHODS:
        times = time_figures(spent[method])
        ratio = plain_ms / float(np.median(same[method])) if same[method] else None
        out["methods"][method] = {
            **times,
            "ratio": round(ratio, 2) if ratio else None,
            "error": _error(maps[method]),
        }
    out["bma_from_reference"] = distance([m for _, m in maps["bma"]], maps["reference"])
    return out


def distance(
    found: Sequence[DepthMap], reference: Sequence[tuple[Piece, DepthMap]]
) -> dict[str, Any]:
    """How far depth maps are from the reference's, over all windows that both have.

    Returns
    -------
    dict
        Median and 95th percentile of the difference where both measured, µm, and the masks'
        intersection over union.
    """
    plain = {piece.start_ns: depth_map for piece, depth_map in reference}
    apart: list[npt.NDArray[np.float64]] = []
    both = either = 0
    for depth_map in found:
        if depth_map.start_ns not in plain:
            continue
        a, b = np.isfinite(depth_map.depth), np.isfinite(plain[depth_map.start_ns].depth)
        both += int((a & b).sum())
        either += int((a | b).sum())
        difference = depth_map.depth.astype(np.float64) - plain[depth_map.start_ns].depth
        apart.append(np.abs(difference[a & b]) * 1e6)
    values = np.concatenate(apart) if apart else np.empty(0)
    return {
        "median_um": round(float(np.median(values)), 3) if len(values) else None,
        "p95_um": round(float(np.percentile(values, 95)), 3) if len(values) else None,
        "mask_iou": round(both / either, 4) if either else None,
        "pixels": both,
    }


def _settings(method: str, options: BenchOptions) -> DepthSettings:
    return depth_settings(
        method, **{"window.rule": "time", "window.time_s": options.fixed_window_s}
    )


def _error(maps: Sequence[tuple[Piece, DepthMap]]) -> dict[str, Any]:
    tallies: dict[str, TruthTally] = {}
    for piece, depth_map in maps:
        tallies.setdefault(piece.scan.name, TruthTally(piece.scan.truth)).add(depth_map)
    return mean_error([of_object(t.summary(), name) for name, t in tallies.items()])
