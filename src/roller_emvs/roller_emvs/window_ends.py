"""Where a window by travel ends, by the poses alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_core.errors import RollerError
from roller_core.passes import rest_begin
from roller_core.pose_track import FASTEST_M_S, I64, PoseError, PoseJumpError, PoseTrack
from roller_core.transforms import F64

#: Share of a window from which on the last one gives a depth still.
LEAST_TRAVEL = 0.4
#: Share of a window from which it ends where the sensor turns back: what windows under a printed
#: texture repeat. One that comes back by so much, m, has turned.
_TURN_SHARE, _TURNED_M = 0.25, 1e-3


@dataclass(frozen=True)
class WindowEnd:
    """Where a window ends, as far as poses tell."""

    #: Its end; None while it isn't known.
    end_ns: int | None
    #: Start of the one after.
    following_ns: int
    #: Share of the window that poses reach so far.
    share: float
    #: Why it gives no depth; empty: it gives one.
    reason: str = ""
    #: The error, where poses are to blame.
    fault: RollerError | None = None
    #: Whether the sensor came to rest there.
    at_rest: bool = False


def end_by_travel(
    track: PoseTrack, start: int, last: int, travel_m: float, step_m: float, max_still_s: float
) -> WindowEnd:
    """Where a window ends that begins at a time, by the distance from there.

    It also ends where the sensor comes to rest, turns back, or leaves for where no arm could.

    Parameters
    ----------
    track : PoseTrack
        Camera in base; reaches beyond the start.
    start, last : int
        Its begin; the last time that has both events and poses, ns.
    travel_m, step_m : float
        Its length, and the way from its begin to that of the next.
    max_still_s : float
        Longest time that it may take.
    """
    limit = start + round(max_still_s * 1e9)
    try:
        origin = track.at(start).position
    except PoseError as error:
        # A gap: restart at the first pose after it.
        times = track.times_ns
        later = times[np.searchsorted(times, start, side="right") :]
        return WindowEnd(int(later[0]), int(later[0]), 0.0, str(error))
    first = int(np.searchsorted(track.times_ns, start, side="right"))
    jumps = _jumps(track, first, travel_m)
    # What lies beyond a jump tells nothing of the window.
    until = int(np.argmax(jumps)) if jumps.any() else len(jumps)
    times = track.times_ns[first : first + until]
    places = track.positions[first : first + until]
    away = np.linalg.norm(places - origin, axis=1)
    end = _reach(start, times, away, travel_m)
    # A scan may end here. Noise goes on, so that no lack of events tells that it did.
    rest = _rest_after(times, places, away, LEAST_TRAVEL * travel_m)
    if rest is not None and rest <= limit and (end is None or rest < end):
        return WindowEnd(rest, rest, 1.0, at_rest=True)
    # What both ways show of a wall isn't in one place: pixels are late on either side of it.
    turn = _turn_after(times, away, _TURN_SHARE * travel_m)
    if turn is not None and turn <= limit and (end is None or turn < end):
        return WindowEnd(turn, turn, 1.0)
    if end is not None and end <= limit:
        following = _reach(start, times, away, step_m) if step_m < travel_m else end
        return WindowEnd(end, following or end, 1.0)
    within = away[times <= last]
    share = float(within.max() / travel_m) if len(within) else 0.0
    if until < len(jumps) and (not until or times[-1] < limit):
        if until and away.max() >= LEAST_TRAVEL * travel_m:
            return WindowEnd(int(times[-1]), int(times[-1]), share)
        return _beyond_jump(track, first, jumps, limit)
    if track.end_ns >= limit:
        reason = (
            f"the sensor moved less than {travel_m * 1e3:g} mm "
            f"in {max_still_s:g} s: no parallax, no depth"
        )
        return WindowEnd(limit, limit, 0.0, reason)
    return WindowEnd(None, limit, share)


def _jumps(track: PoseTrack, first: int, slack_m: float) -> np.ndarray:
    """Whether each pose from one on lies further from that before it than any arm gets.

    Over a gap nothing is known. What a window's travel holds can't make up many windows.
    """
    seconds = np.diff(track.times_ns[first - 1 :]) * 1e-9
    steps = np.linalg.norm(np.diff(track.positions[first - 1 :], axis=0), axis=1)
    return np.asarray((steps > slack_m + FASTEST_M_S * seconds) & (seconds <= track.max_gap_s))


def _beyond_jump(track: PoseTrack, first: int, jumps: np.ndarray, limit: int) -> WindowEnd:
    """A window that gives no depth up to where poses go on evenly."""
    times, places = track.times_ns[first - 1 :], track.positions[first - 1 :]
    at = int(np.argmax(jumps))
    away_m = float(np.linalg.norm(places[at + 1] - places[at]))
    fault = PoseJumpError(
        f"poses jump: by {away_m:.3g} m in {(times[at + 1] - times[at]) * 1e-6:.1f} ms at "
        f"{times[at + 1] * 1e-9:.3f} s, faster than any arm; do two nodes publish them, or are "
        "they in millimetres?"
    )
    after = at + 1
    while after < len(jumps) and jumps[after] and times[after] < limit:
        after += 1
    end = int(times[after])
    # The next pose tells whether it goes on evenly.
    known = after < len(jumps) or end >= limit
    return WindowEnd(end if known else None, end, 0.0, str(fault), fault)


def _rest_after(times: I64, places: F64, away: F64, travel: float) -> int | None:
    """Time at which the sensor came to rest after it was a distance from the start."""
    far = np.flatnonzero(away >= travel)
    if not len(far):
        return None
    k = rest_begin(times[far[0] :], places[far[0] :])
    return int(times[far[0] + k]) if k is not None else None


def _turn_after(times: I64, away: F64, travel: float) -> int | None:
    """Time at which the sensor turned back after it was a distance from the start."""
    farthest = np.maximum.accumulate(away)
    back = np.flatnonzero((farthest >= travel) & (away < farthest - _TURNED_M))
    return int(times[np.argmax(away[: back[0]])]) if len(back) else None


def _reach(start: int, times: I64, away: F64, travel: float) -> int | None:
    """Time at which the distance from the start first reaches `travel`."""
    reached = np.flatnonzero(away >= travel)
    if not len(reached):
        return None
    k = int(reached[0])
    t0, d0 = (start, 0.0) if k == 0 else (int(times[k - 1]), float(away[k - 1]))
    share = (travel - d0) / (float(away[k]) - d0)
    return t0 + max(round(share * (int(times[k]) - t0)), 1)
