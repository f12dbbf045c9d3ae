"""A run in a few lines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from roller_emvs.lines.edge_drift import NOT_CALIBRATED, NOT_CORRECTED
from roller_inspect.report.html import measure_words

from .run_report import Report

#: Findings that are printed.
_MOST_FINDINGS = 20
#: What of a scan may be lost, by its name in the report.
_LOST = {
    "lost_packets": "packets",
    "outside_events": "events outside the image",
    "late_events": "events that came too late",
    "depth_dropped_events": "events given up, as too many waited",
}
#: Why there may be no window at all, by what most events were left out as.
_NOTHING = {
    "depth_ramp_events": "by its poses the robot accelerates too hard nearly everywhere; are their "
    "times and units right?",
    "depth_events_without_pose": "there are no poses for most events",
    "depth_still_events": "by its poses the robot stands",
}
#: Share of the events that may lie before the first pose or after the last one: no recording begins
#: and ends with both at once.
_ENDS = 0.01


def summary(report: Report, output: Path) -> str:
    """Table of points, errors by object where the truth is known, text, time and files."""
    t = report.totals
    ms = report.window_milliseconds()
    lines = [
        f"{t['depth_windows']} {_pieces(report)} ({report.method}), "
        f"{t['depth_refused_windows']} windows refused, {t['events']} events, "
        f"{t['surface_points']} surface points",
    ]
    if t["events"] and not t["depth_points"]:
        lines.append(_why_nothing(report))
    if ms:
        lines.append(
            f"{ms['median']:.1f} ms a window (95 %: {ms['p95']:.1f} ms), "
            f"{t['times_faster_than_recorded'] or 0:.2f} × as fast as recorded"
        )
    lost = {name: t[key] for key, name in _LOST.items() if t[key]}
    if t["depth_events_without_pose"] > _ENDS * t["events"]:
        lost["events without pose"] = t["depth_events_without_pose"]
    if lost:
        lines.append("lost: " + ", ".join(f"{count} {name}" for name, count in lost.items()))
    if report.truth:
        lines += error_table(report.truth)
    if report.edge_drift == NOT_CALIBRATED:
        lines.append(f"edge drift: {NOT_CALIBRATED}, so not corrected")
    elif report.edge_drift == NOT_CORRECTED:
        lines.append(f"edge drift: {NOT_CORRECTED}")
    if t["braille_text"]:
        lines += ["text read: " + " / ".join(t["braille_text"])]
        if report.truth and report.truth["text"]:
            given = str(report.truth["text"]).replace("\n", " / ")
            lines.append("text given: " + given)
    lines.append(f"results in {output}/")
    return "\n".join(lines)


def _why_nothing(report: Report) -> str:
    """Why a scan gave no depth, as far as its windows say."""
    t = report.totals
    reasons = Counter(reason for window in report.windows for reason in window["lost"])
    if reasons:
        reason, count = reasons.most_common(1)[0]
        return f"no depth: {reason} ({count} of {len(report.windows)} windows)"
    for key, why in _NOTHING.items():
        if t[key] > 0.5 * t["events"]:
            return f"no depth: {why}"
    return "no depth: no window was complete"


def inspection_summary(document: Mapping[str, Any]) -> str:
    """The verdict of a part, its findings and the recipe's measures."""
    cover = document["coverage"]
    lines = [
        f"{document['part']}: {document['verdict'].upper()}: {document['reason']}",
        f"measured {cover['measured']:.1%}, continued {cover['continued']:.1%}, "
        f"unmeasured {cover['unmeasured']:.1%}; {document['texture']['text']}",
    ]
    if document["findings"]:
        head = (
            f"{'no.':>4s} {'kind':8s} {'x, y mm':>15s} {'L × W mm':>12s} {'depth µm':>12s}  verdict"
        )
        lines += [head, "-" * len(head)]
    for f in document["findings"][:_MOST_FINDINGS]:
        u, (x, y, _) = f["uncertainty"]["depth_m"], f["center_m"]
        depth = f"{f['depth_m'] * 1e6:+.0f}" + (f" ± {u * 1e6:.0f}" if u is not None else "")
        lines.append(
            f"{f['id']:4d} {f['kind']:8s} {x * 1e3:7.2f},{y * 1e3:7.2f} "
            f"{f['length_m'] * 1e3:5.2f} × {f['width_m'] * 1e3:4.2f} {depth:>12s}  {f['verdict']}"
        )
    if len(document["findings"]) > _MOST_FINDINGS:
        lines.append(f"and {len(document['findings']) - _MOST_FINDINGS} more: findings.csv")
    for m in document["measures"]:
        value, limits, verdict = measure_words(m)
        judged = "" if limits == "–" else f", limits {limits}: {verdict}"
        lines.append(f"{m['name']} ({m['tool']} of {m['of']}): {m['reason'] or value}{judged}")
    return "\n".join(lines)


def demo_table(report: Report, written: Path, folder: Path) -> str:
    """What the demonstration prints: points, errors, text, milliseconds, files.

    They are written to one folder, and will lie in another.
    """
    t = report.totals
    surface = report.method == "surface"
    status, piece = ("surface: points", "block") if surface else ("emvs: depth", "window")
    figures = t["live"].get(status, {})
    pieces = _pieces(report)
    lines = ["", f"{t['surface_points']} surface points from {t['depth_windows']} {pieces}"]
    if report.truth:
        lines += error_table(report.truth)
        lines.append("text given: " + str(report.truth["text"]).replace("\n", " / "))
    lines.append("text read:  " + (" / ".join(t["braille_text"]) or "-"))
    if figures:
        median, p95 = figures[f"{piece}_ms_median"], figures[f"{piece}_ms_p95"]
        lines.append(
            f"{median} ms a {piece} (95 %: {p95} ms), "
            f"{figures['lost_packets']} packets lost, {figures['dropped_events']} events dropped; "
            f"last result {t.get('lag_s', 0.0):.1f} s after the last events"
        )
    names = ["overview.png", "surface.ply", "braille.txt", "report.json", "bag/", "truth/"]
    if (written / "inspection.html").exists():
        names.insert(1, "inspection.html")
    lines.append("files: " + ", ".join(f"{folder}/{name}" for name in names))
    return "\n".join(lines)


def _pieces(report: Report) -> str:
    return "blocks of the surface" if report.method == "surface" else "depth maps"


def error_table(truth: dict[str, Any]) -> list[str]:
    """Errors by object, with the share of relief edges that were measured."""
    head = f"{'object':16s} {'points':>9s} {'MAE µm':>8s} {'median µm':>10s} {'edges seen':>11s}"
    rows = [head, "-" * len(head)]
    for name, f in [*truth["objects"].items(), ("all", truth["all"])]:
        if not f["points"]:
            rows.append(f"{name:16s} {0:9d} {'-':>8s} {'-':>10s} {'-':>11s}")
            continue
        seen = f"{f['edges_measured']:.0%}" if f["edges_measured"] == f["edges_measured"] else "-"
        rows.append(
            f"{name:16s} {f['points']:9d} {f['mae_um']:8.1f} {f['median_um']:10.1f} {seen:>11s}"
        )
    return rows
