"""Where windows end while poses jump."""

import numpy as np
import pytest

from emvs.scenes import MS
from emvs.window_cutting import cut_all, setting, ticking
from roller_core.pose_track import PoseTrack
from roller_emvs.windows import RefusedWindow, Window, WindowCutter


def jumping(wrong: list[int], away_m: float = 1e3, poses: int = 100) -> PoseTrack:
    """0.3 m/s along x, some of its poses far off across."""
    track = PoseTrack()
    for k in range(poses):
        y = away_m if k in wrong else 0.0
        track.append(k * 8 * MS, [0.0024 * k, y, 0.0], [0, 0, 0, 1])
    return track


@pytest.mark.parametrize(
    ("wrong", "jumps"),
    [([0], 1), ([1], 1), ([50], 1), ([99], 1), ([98, 99], 1), ([30, 50, 70], 3),
     (list(range(50, 100)), 1), (list(range(0, 100, 2)), 1)],
    ids=["first", "second", "one", "last", "two last", "some", "from one on", "every other"],
)  # fmt: skip
@pytest.mark.parametrize("away_m", [1.0, 1e6, 9.9e9])
def test_poses_that_jump_cost_what_lies_there_and_nothing_else(
    wrong: list[int], jumps: int, away_m: float
) -> None:
    """Windows of nanoseconds were cut, millions of them, on the way to a place 1000 km away."""
    track, events = jumping(wrong, away_m), ticking(792)
    cutter, windows = WindowCutter(setting(window={"overlap": 0.0}), track), []
    cutter.add(events)
    while len(windows) < 50 and (window := cutter.cut(True)) is not None:
        windows.append(window)
    refused = [w for w in windows if isinstance(w, RefusedWindow)]
    told = [w for w in refused if w.fault is not None]
    assert len(told) == jumps
    assert all("poses jump: by" in w.reason and "do two nodes publish" in w.reason for w in told)
    assert len(refused) <= jumps + 1  # the last one may be too short
    good = [w for w in windows if isinstance(w, Window)]
    for w in good:
        way = track.positions[slice(*np.searchsorted(track.times_ns, [w.start_ns, w.end_ns + 1]))]
        assert np.ptp(way[:, 1]) == 0.0
    # What is lost is less than a window on either side of each.
    kept_s = sum(w.end_ns - w.start_ns for w in good) * 1e-9
    if len(wrong) < 50 or wrong[0] == 50:
        assert kept_s > 0.79 - (2 * jumps + 1) * 0.4 * 0.028 / 0.3 - jumps * 0.024


def test_windows_before_a_jump_are_those_without_it() -> None:
    def spans(track: PoseTrack) -> list[tuple[int, int]]:
        cutter = WindowCutter(setting(), track)
        cutter.add(ticking(792))
        return [(w.start_ns, w.end_ns) for w in cut_all(cutter) if isinstance(w, Window)]

    jumped_ns = 50 * 8 * MS
    before = [s for s in spans(jumping([])) if s[1] < jumped_ns - 8 * MS]
    found = spans(jumping([50]))
    assert len(before) > 4
    assert found[: len(before)] == before


@pytest.mark.parametrize("wrong", [[20], [20, 21, 23], list(range(20, 40)), list(range(5, 40, 2))])
def test_where_poses_jump_arrival_does_not_matter_either(wrong: list[int]) -> None:
    poses, events, s = jumping(wrong, poses=60), ticking(440), setting(max_still_s=0.3)
    whole = WindowCutter(s, poses)
    whole.add(events)
    expected = [(w.start_ns, w.end_ns, isinstance(w, Window)) for w in cut_all(whole)]
    track, found = PoseTrack(), []
    live = WindowCutter(s, track)
    for k in range(len(poses)):
        a, b = np.searchsorted(events.t_ns, [(k - 1) * 8 * MS, k * 8 * MS])
        live.add(events[a:b])
        track.append(int(poses.times_ns[k]), poses.positions[k], poses.quaternions[k])
        found += cut_all(live, flush=False)
        if live.needed_from_ns is not None:
            track.discard_before(live.needed_from_ns)
    found += cut_all(live)
    assert [(w.start_ns, w.end_ns, isinstance(w, Window)) for w in found] == expected
