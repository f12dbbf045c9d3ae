"""A robot that pauses while it rolls over a gauge."""

from dataclasses import replace

import numpy as np
import pytest

from roller_bringup.cli import main
from roller_calibration import recordings
from roller_calibration.commands import sphere as command
from roller_calibration.contact import contact_windows, pass_points
from roller_calibration.pauses import without_pauses
from roller_calibration.recordings import Scan
from roller_calibration.sphere import find_sphere
from roller_calibration.step_gauges import steps_gauges
from roller_core.calibration_file import CalibrationError
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods.surface import SurfaceSettings
from simulated_scans import Scans

PAUSE_NS = 1_500_000_000


def paused(scan: Scan, share: float, noise: int = 0) -> Scan:
    """The scan with a pause after some of its poses."""
    track, events = scan.track, scan.events
    k = int(share * len(track))
    at, rest = int(track.times_ns[k]), np.arange(10_000_000, PAUSE_NS, 10_000_000)
    times = np.concatenate([track.times_ns[: k + 1], at + rest, track.times_ns[k + 1 :] + PAUSE_NS])
    order = np.concatenate([np.arange(k + 1), np.full(len(rest), k), np.arange(k + 1, len(track))])
    out = PoseTrack(track.max_gap_s)
    out.extend(times, track.positions[order], track.quaternions[order])
    later = events.t_ns >= at
    t_ns = events.t_ns + np.where(later, PAUSE_NS, 0)
    drawn = np.random.default_rng(4).integers(0, len(events), noise)
    stray = np.sort(np.random.default_rng(5).integers(at, at + PAUSE_NS, noise))
    columns = [np.concatenate([c, c[drawn]]) for c in (events.x, events.y, events.p)]
    t_ns = np.concatenate([t_ns, stray])
    by_time = np.argsort(t_ns, kind="stable")
    x, y, p = (c[by_time] for c in columns)
    return replace(scan, events=EventArray(x, y, t_ns[by_time], p), track=out)


def gauge_scan(scans: Scans) -> Scan:
    small = {"camera": {"height": 180}, "scene": {"step_mm": 0.05, "width_mm": 9.0}}
    made = scans.scan("gauge_steps", speed=0.5, **small)
    return Scan("steps", made.events, made.camera, made.track)


def test_a_pause_within_a_pass_makes_no_more_walls(scans: Scans) -> None:
    scan, settings = gauge_scan(scans), SurfaceSettings.create({})
    (whole,) = steps_gauges(scan, settings, 2.5e-4)
    (gauge,) = steps_gauges(paused(scan, 0.5), settings, 2.5e-4)
    assert gauge.text.startswith("8 walls of 0.2")
    assert "lines on them" in gauge.text  # not depths in place of too few of them
    assert len(gauge.error_m) > 0.8 * len(whole.error_m)


def test_a_pause_over_a_sphere_costs_no_window(
    scans: Scans, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command's own passes: `focus` has two windows on the sphere, the pause left one."""
    made = scans.scan("gauge_sphere", speed=0.3, camera={"height": 220})
    scan = Scan("sphere", made.events, made.camera, made.track)
    seen: list[int] = []
    monkeypatch.setattr(recordings, "read_scans", lambda *_: [paused(scan, 0.5)])

    def stop(passes: list[Scan], settings: DepthSettings, _args: object) -> None:
        sphere = find_sphere(*pass_points(passes[0], settings), 5e-3)
        seen.append(len(contact_windows(passes[0], settings, sphere)))
        raise CalibrationError("enough")

    monkeypatch.setattr(command, "_find", stop)
    assert main(["calibrate", "sphere", "ball", "--radius-mm", "5", "--method", "focus"]) == 1
    assert seen == [2]


def test_what_comes_while_the_robot_stands_is_left_out(scans: Scans) -> None:
    scan = gauge_scan(scans)
    bridged = without_pauses(paused(scan, 0.5, noise=3000))
    # What stays of the pause, a twentieth of a second at each end, holds its share of the noise.
    more = len(bridged.events) - len(scan.events)
    assert 0 < more < 3000 * 0.2e9 / PAUSE_NS
    assert (np.diff(bridged.events.t_ns) >= 0).all()
    assert (np.diff(bridged.track.times_ns) > 0).all()
    longer_ns = bridged.track.end_ns - scan.track.end_ns
    assert 0 < longer_ns <= 0.2e9


def test_a_robot_that_stands_before_and_after_is_no_pause(scans: Scans) -> None:
    scan = gauge_scan(scans)
    for share in (0.0, 1.0 - 1e-9):
        standing = paused(scan, share)
        assert without_pauses(standing) is standing
    assert without_pauses(scan) is scan
