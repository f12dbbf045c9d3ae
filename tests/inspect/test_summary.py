"""What a replay prints."""

from pathlib import Path

import pytest

from roller_inspect.results.run_report import Report
from roller_inspect.results.summary import summary

TOTALS = {
    "events": 100_000, "depth_windows": 3, "depth_refused_windows": 0, "surface_points": 4000,
    "times_faster_than_recorded": 2.0, "lost_packets": 0, "outside_events": 0, "late_events": 0,
    "depth_dropped_events": 0, "depth_events_without_pose": 0, "braille_text": [],
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
