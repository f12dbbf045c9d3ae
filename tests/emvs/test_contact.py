"""Contact by events and poses: rolling, slipping, lost; what slipped gives no depth."""

import numpy as np
import pytest

from emvs.scenes import CAMERA, MS, events_of, rolling
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.outputs import CONTACT, DEPTH_ACCOUNT, Output
from roller_core.pose_track import PoseTrack
from roller_emvs.contact import ContactState, ContactWatch
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.image_speed import _SHARES, _keep_quiet, _sharpness
from roller_emvs.methods.surface import SurfaceSettings, SurfaceSweep
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.windows import RefusedWindow
from simulated_scans import Scans

SPEED, SECONDS, DEPTH = 0.3, 0.3, 0.045


@pytest.fixture(scope="module")
def texture() -> EventArray:
    """Specks of a flat surface, rolled over."""
    random = np.random.default_rng(2)
    n = 8000
    low, high = (-0.01, -0.0035, DEPTH), (SPEED * SECONDS + 0.01, 0.0035, DEPTH)
    return events_of(random.uniform(low, high, (n, 3)), rolling(SPEED), SECONDS)


def poses(share: float, from_s: float = 0.0, until_s: float = SECONDS) -> PoseTrack:
    """Of a robot of whose travel the surface's image shows but a share, for a while."""
    track, x = PoseTrack(), 0.0
    for k in range(int(SECONDS / 0.008) + 3):
        track.append(k * 8 * MS, [x, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
        x += 0.008 * SPEED / (share if from_s <= k * 0.008 < until_s else 1.0)
    return track


def watched(
    events: EventArray, track: PoseTrack, camera: Camera = CAMERA, reach_m: float = 2e-3
) -> ContactWatch:
    watch = ContactWatch(camera, track, DEPTH - reach_m, DEPTH + reach_m)
    for begin in range(0, len(events), 5000):
        watch.add(events[begin : begin + 5000])
    return watch


@pytest.mark.parametrize("share", [1.0, 0.9, 0.82, 0.5, 1.1, 1.4])
def test_the_images_share_of_the_speed_is_found(texture: EventArray, share: float) -> None:
    watch = watched(texture, poses(share))
    fault = watch.fault(0, 200 * MS)
    assert watch.state.image_speed == pytest.approx(share, abs=0.021)
    assert fault == ("" if share == 1.0 else watch.state.fault)
    assert watch.state.area_m2 == pytest.approx(320 * 120 * (DEPTH / 800) ** 2, rel=0.2)
    assert watch.state.fill > 0.9


@pytest.mark.parametrize(("share", "said"), [
    (2.5, "or the surface lies at 18 mm, out of depth_min_m"),
    (3.3, "or the surface lies at 14 mm, out of depth_min_m"),
    (-1.0, "the image moves against the robot: are the poses, or the hand-eye, inverted"),
])  # fmt: skip
def test_a_surface_far_before_the_range_and_poses_the_other_way(
    texture: EventArray, share: float, said: str
) -> None:
    watch = watched(texture, poses(share))
    assert said in watch.fault(0, 200 * MS)
    assert said in watch.fault(200 * MS, 290 * MS)  # and for good


def test_a_piece_that_has_begun_is_looked_at_once(
    texture: EventArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch, look, spans = watched(texture, poses(1.4)), ContactWatch._look, []

    def counted(self: ContactWatch, events: EventArray, start: int, end: int) -> ContactState:
        spans.append((start, end))
        return look(self, events, start, end)

    monkeypatch.setattr(ContactWatch, "_look", counted)
    first = watch.fault(0, 30 * MS)
    assert first.startswith("slipping")
    assert len(spans) == 1
    assert watch.fault(1, 30 * MS) == first
    assert len(spans) == 1
    assert watch.fault(2, 36 * MS) == first
    assert len(spans) == 2


def test_a_slip_that_looks_like_a_depth_in_the_range_is_none(texture: EventArray) -> None:
    assert watched(texture, poses(0.9)).fault(0, 200 * MS).startswith("slipping")
    assert watched(texture, poses(0.9), reach_m=5e-3).fault(0, 200 * MS) == ""


def test_a_standing_image_and_a_texture_that_is_gone_are_contact_lost(texture: EventArray) -> None:
    shaken = events_of(
        np.random.default_rng(0).uniform([-0.01, -0.0035, DEPTH], [0.01, 0.0035, DEPTH], (2500, 3)),
        lambda t: (np.array([1e-4 * np.sin(1000 * t), 0, 0]), np.array([0.0, 0.0, 0.0, 1.0])),
        0.2,
    )
    assert "contact lost: the image stands" in watched(shaken, poses(1.0)).fault(0, 200 * MS)
    gone = watched(texture[: len(texture) // 2], poses(1.0))
    gone.add(EventArray.from_arrays([5], [5], [299 * MS], [1]))
    assert gone.fault(0, 120 * MS) == ""
    assert "the skin is still" in gone.fault(120 * MS, 290 * MS)


def test_flat_plate_behind_relief_that_fills_the_view_is_no_contact_lost(scans: Scans) -> None:
    """Under a plain skin it leaves no events; what was seen before is none of the skin."""
    scan = scans.scan(
        "stairs", 0.3, camera={"width": 480, "height": 160}, scene={"length_mm": 110.0},
        light={"speckle": 0.03},
    )  # fmt: skip
    watch = ContactWatch(scan.camera, scan.track, 43e-3, 47e-3)
    shares, look = [], ContactWatch._look
    watch._look = lambda *a: shares.append(look(watch, *a)) or shares[-1]  # type: ignore[method-assign]
    watch.add(scan.events)
    assert watch.fault(scan.track.start_ns, int(scan.events.t_ns[-1])) == ""
    assert max(state.cells for state in shares) > 0.5
    assert min(state.cells for state in shares) < 0.05


def test_events_that_could_not_wait_are_no_contact_lost(
    texture: EventArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("roller_emvs.contact._MOST_WAITING", len(texture) // 8 // 3)
    watch = ContactWatch(CAMERA, poses(1.0), DEPTH - 2e-3, DEPTH + 2e-3)
    half = np.searchsorted(texture.t_ns, 100 * MS)
    for begin in range(0, half, 5000):
        watch.add(texture[begin : min(begin + 5000, half)])
    assert watch.fault(0, 90 * MS) == ""
    for begin in range(half, len(texture), 5000):
        watch.add(texture[begin : begin + 5000])
    assert watch.fault(90 * MS, 290 * MS) == ""


@pytest.mark.parametrize("on_purpose", [True, False])
def test_events_that_are_missing_are_no_contact_lost(texture: EventArray, on_purpose: bool) -> None:
    """Packets are left out to keep up, or never came; the window after them is whole."""
    settings = DepthSettings.create({"window.travel_m": 0.015985, "window.overlap": 0.0})
    engine = DepthPipeline(settings, CAMERA, poses(1.0))
    begin, end = np.searchsorted(texture.t_ns, [120 * MS, 159.8 * MS])
    engine.add_events(texture[:begin])
    if on_purpose:
        engine.leave_gap()
    else:
        engine.miss()
    engine.add_events(texture[end:])
    found = list(engine.results(flush=True))
    assert engine.counts.bad_contact_windows == 0
    assert engine.contact.image_speed == pytest.approx(1.0, abs=0.051)
    assert engine.counts.left_out_windows == on_purpose
    starts = [one.start_ns for one in found if not isinstance(one, RefusedWindow)]
    assert any(159 * MS < start < 160 * MS for start in starts)


def test_little_to_see_says_nothing() -> None:
    random = np.random.default_rng(0)
    noise = EventArray.from_arrays(
        random.integers(0, 320, 60_000), random.integers(0, 120, 60_000),
        np.sort(random.integers(0, 300 * MS, 60_000)), random.integers(0, 2, 60_000),
    )  # fmt: skip
    for events in (noise, noise[::100]):
        watch = watched(events, poses(1.0))
        assert watch.fault(0, 290 * MS) == ""
        assert watch.state.image_speed is None


def test_what_slips_gives_no_depth_and_says_so(texture: EventArray) -> None:
    """The surface moves as the poses say but for 60 ms in the middle."""
    track = poses(0.6, 0.1, 0.16)
    rows = SurfaceSettings.create({"min_aperture_m": 0.002, "block_m": 0.002})
    for engine in (
        DepthPipeline(DepthSettings.create({"window.travel_m": 0.01}), CAMERA, track),
        SurfaceSweep(rows, CAMERA, track),
    ):
        engine.add_events(texture)
        found = list(engine.results(flush=True))
        refused = [r for r in found if isinstance(r, RefusedWindow) and r.contact]
        assert refused
        assert engine.counts.bad_contact_windows == len(refused)
        for one in refused:
            assert one.reason.startswith("slipping: the image moves at ")
            assert one.end_ns > 100 * MS
            assert one.start_ns < 180 * MS
            own = Output(DEPTH_ACCOUNT, one.stamp_ns, "", one.account)
            account, output = one.result("window", "depth", own).outputs
            assert account is own
            assert account.data.lost == (one.reason,)
            assert (output.topic, output.data.text) == (CONTACT, one.reason)
        good = [r for r in found if not isinstance(r, RefusedWindow)]
        assert good
        for one in good:  # what slipped for less than the piece that shows it
            assert min(one.end_ns, 160 * MS) - max(one.start_ns, 100 * MS) < 22 * MS


def test_a_scan_of_the_virtual_cell(scans: Scans) -> None:
    scan = scans.scan("stairs", speed=0.3, camera={"height": 120}, scene={"step_mm": 0.04})
    end_ns = int(scan.events.t_ns[-1])
    for share in (1.0, 0.88):
        track = PoseTrack()
        first = scan.track.positions[0]
        for t, p, q in zip(
            scan.track.times_ns, scan.track.positions, scan.track.quaternions, strict=True
        ):
            track.append(int(t), first + (p - first) / share, q)
        watch = watched(scan.events, track, scan.camera)
        fault = watch.fault(0, end_ns)
        assert bool(fault) == (share != 1.0)
        assert fault.startswith("slipping") or not fault


def test_the_kernels_are_their_plain_twins() -> None:
    random = np.random.default_rng(1)
    n, rows, columns = 300, 6, 40
    bins = random.uniform(-15, 45, (4, n)).astype(np.float32)
    bins[:, 7] = np.nan
    signs, shares = random.choice([-1, 1], n).astype(np.int16), _SHARES.astype(np.float32)
    found, image = np.empty(len(shares)), np.empty((rows + 1, columns), np.int16)
    _sharpness(bins, signs, shares, np.empty(n, np.int32), image, found)
    for share, sharp in zip(shares, found, strict=True):
        place = bins[:2] + share * bins[2:]
        inside = ((place >= 0) & (place < [[columns], [rows]])).all(axis=0)
        column, row = place[:, inside].astype(int)
        plain = np.zeros((rows, columns))
        np.add.at(plain, (row, column), signs[inside])
        assert sharp == (np.diff(plain, axis=1) ** 2).sum() - 2 * inside.sum()

    x, y = random.integers(0, 30, n).astype(np.uint16), random.integers(0, 20, n).astype(np.uint16)
    x[:40], y[:40] = 3, 5
    counts, kept = np.zeros((20, 30), np.uint16), np.empty(n, np.bool_)
    _keep_quiet(x, y, counts, kept)
    assert not counts.any()
    np.add.at(counts, (y, x), 1)
    np.testing.assert_array_equal(kept, counts[y, x] <= 2 + 3 * n / (counts > 0).sum())
    assert not kept[0]
    assert kept.any()
