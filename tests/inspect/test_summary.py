"""What a replay prints."""

from pathlib import Path

import pytest

from roller_inspect.results.run_report import Report
from roller_inspect.results.summary import summary

TOTALS = {
    "events": 100_000, "depth_windows": 3, "depth_refused_windows": 0, "surface_points": 4000,
    "times_faster_than_recorded": 2.0, "lost_packets": 0, "outside_events": 0, "late_events": 0,
    "depth_dropped_events": 0, "depth_events_without_pose": 0, "braille_text": [],
    "depth_points": 5000, "depth_ramp_events": 0, "depth_still_events": 0,
}  # fmt: skip


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        ({}, None),
        ({"depth_events_without_pose": 200}, None),  # the ends of any recording
        ({"depth_events_without_pose": 2000}, "lost: 2000 events without pose"),
        ({"lost_packets": 1, "depth_dropped_events": 7}, "lost: 1 packets, 7 events given up"),
    ],
)
def test_what_is_lost_is_said(counts: dict[str, int], said: str | None) -> None:
    report = Report("scan", "focus", {}, totals={**TOTALS, **counts})
    lines = summary(report, Path("result")).splitlines()
    lost = [line for line in lines if line.startswith("lost")]
    assert [line[: len(said or "")] for line in lost] == ([said] if said else [])


@pytest.mark.parametrize(
    ("counts", "lost", "said"),
    [
        ({}, [["few events"], ["no parallax"], ["no parallax"]], "no parallax (2 of 3 windows)"),
        ({"depth_ramp_events": 90_000}, [], "by its poses the robot accelerates too hard"),
        ({"depth_events_without_pose": 90_000}, [], "there are no poses for most events"),
        ({"depth_still_events": 90_000}, [], "by its poses the robot stands"),
        ({}, [[]], "no window was complete"),
    ],
)
def test_why_a_scan_gives_no_depth_is_said(
    counts: dict[str, int], lost: list[list[str]], said: str
) -> None:
    windows = [{"points": 0, "milliseconds": {}, "lost": why} for why in lost]
    totals = {**TOTALS, "depth_points": 0, "surface_points": 0, **counts}
    report = Report("scan", "focus", {}, windows=windows, totals=totals)
    lines = summary(report, Path("result")).splitlines()
    assert [line for line in lines if line.startswith(f"no depth: {said}")] == [lines[1]]
