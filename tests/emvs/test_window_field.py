"""Which windows go by images of aperture parts, and that these give the depth that rays give."""

from dataclasses import replace

import numpy as np
import pytest

from emvs.hard.world import CAMERA, DEPTH, flat, poses, scan
from emvs.scenes import Motion, rolling
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_emvs.evidence import find_depths, part_images
from roller_emvs.methods import window_field
from roller_emvs.methods.focus import focus_depth
from roller_emvs.methods.window_field import WindowView
from roller_emvs.rays import Packets, make_packets
from roller_emvs.stopwatch import Stopwatch

RANGE_M = (0.043, 0.047)


def view_of(
    motion: Motion, camera: Camera = CAMERA, events: EventArray | None = None
) -> WindowView:
    """A window of a plate with lines."""
    return WindowView.of(*packets_of(motion, camera, events), RANGE_M)


def packets_of(
    motion: Motion, camera: Camera = CAMERA, events: EventArray | None = None
) -> tuple[Packets, Camera, np.ndarray]:
    events = scan(motion, flat(0.0446), 0.07, camera, share=1.0) if events is None else events
    track = poses(motion)
    packets = make_packets(events, camera.undistortion_table(), track, 64)
    return packets, camera, track.at(int(events.t_ns.mean())).matrix


def any_events() -> EventArray:
    rng = np.random.default_rng(8)
    n = 30_000
    times = np.sort(rng.integers(0, 70_000_000, n))
    return EventArray.from_arrays(
        rng.integers(0, CAMERA.width, n), rng.integers(0, CAMERA.height, n), times, np.ones(n)
    )


def slanted(across: float, forward: float = 0.0, yaw: float = 0.0) -> Motion:
    """Rolling along x, and across and along the axis by shares of that, turning about the axis."""
    plain = rolling(0.3)

    def motion(t: float) -> tuple[np.ndarray, np.ndarray]:
        position, _ = plain(t)
        x = float(position[0])
        angle = 0.5 * yaw * x
        return np.array([x, across * x, forward * x]), np.array(
            [0.0, 0.0, np.sin(angle), np.cos(angle)]
        )

    return motion


def test_motion_fits_up_to_the_bounds() -> None:
    events = any_events()
    half = 0.5 * (1 / RANGE_M[0] - 1 / RANGE_M[1])
    # Half the travel of the window, at an end of the range, px.
    reach = 0.5 * 0.3 * 0.07 * CAMERA.fx * half
    for across, fits in ((0.0, True), (0.45 / reach, True), (0.6 / reach, False)):
        assert (view_of(slanted(across), events=events).parts() is not None) == fits
    # A camera that looks aside comes nearer: its image grows.
    grows = 160.0 / CAMERA.fx
    for forward, fits in ((0.2 / reach / grows, True), (0.8 / reach / grows, False)):
        motion = slanted(0.0, forward)
        assert (view_of(motion, events=events).parts() is not None) == fits
    # Turning about its axis it does not: events are placed one by one.
    assert view_of(slanted(0.0, yaw=2.0), events=events).parts() is not None
    assert view_of(slanted(0.0), events=events[::3]).parts() is None


def test_little_parallax_much_and_wide_images_go_by_rays(monkeypatch: pytest.MonkeyPatch) -> None:
    view = view_of(slanted(0.0), events=any_events())
    count = len(view.parts().slopes)  # type: ignore[union-attr]
    monkeypatch.setattr(window_field, "_FEWEST_PARTS", count + 1)
    assert view.parts() is None
    monkeypatch.setattr(window_field, "_FEWEST_PARTS", 1)
    monkeypatch.setattr(window_field, "_MOST_PARTS", count - 1)
    assert view.parts() is None
    monkeypatch.setattr(window_field, "_MOST_PARTS", count)
    assert view.parts() is not None
    monkeypatch.setattr(window_field, "_MOST_PX", CAMERA.width - 1)
    assert view.parts() is None


@pytest.mark.parametrize("lit", [1.0, 0.6, 0.1])
def test_parts_are_for_events_from_most_of_the_way(lit: float) -> None:
    """A light that flashes shows the surface from a few places."""
    events = any_events()
    phase = (events.t_ns - events.t_ns[0]) / np.ptp(events.t_ns) * 3 % 1
    some = events.t_ns[phase <= lit]
    at = np.sort(np.resize(some, len(events)))
    seen = view_of(slanted(0.0), events=replace(events, t_ns=at)).parts() is not None
    assert seen == (lit > 0.5)


UPRIGHT = Camera(40, 320, 800.0, 800.0, 19.5, 159.5)


def along_columns(t: float) -> tuple[np.ndarray, np.ndarray]:
    """Rolling along y."""
    position, turn = rolling(0.3)(t)
    return np.array([position[1], position[0], position[2]]), np.asarray(turn)


@pytest.mark.parametrize("kind", ["along rows", "turning", "nearing", "along columns"])
def test_depth_is_that_of_rays(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    motion = {"turning": slanted(0.0, yaw=1.5), "nearing": slanted(0.0, forward=0.004)}.get(
        kind, slanted(0.0)
    )
    packets, camera, view = packets_of(motion)
    if kind == "along columns":
        e, table = packets.events, UPRIGHT.undistortion_table()
        events = EventArray.from_arrays(e.y, e.x, e.t_ns, e.p)
        track = poses(along_columns)
        camera, packets = UPRIGHT, make_packets(events, table, track, 64)
        view = track.at(int(events.t_ns.mean())).matrix
    seen = WindowView.of(packets, camera, view, RANGE_M)
    assert seen.turned == (kind == "along columns")
    found = {}
    for least in (0.0, np.inf):
        monkeypatch.setattr(window_field, "_LEAST_EVENTS", least)
        assert (seen.parts() is None) == (least > 0)
        found[least] = focus_depth(packets, camera, view, DEPTH, Stopwatch())[0]
    parts, rays = found.values()
    both = np.isfinite(parts) & np.isfinite(rays)
    assert both.sum() > 0.9 * np.isfinite(rays).sum() > 500
    pixel = 0.045**2 / (800.0 * 0.3 * 0.07)
    assert np.median(np.abs(parts - rays)[both]) < 0.2 * pixel
    assert abs(np.median(parts[both]) - np.median(rays[both])) < 0.1 * pixel


def test_threads_change_no_depth() -> None:
    seen = view_of(slanted(0.0))
    parts = seen.parts()
    assert parts is not None
    every = []
    for threads in (1, 2, 4):
        field, ends = seen.part_images(parts, threads), (-seen.half, seen.half)
        every.append(part_images.find_depths_of_parts(field, *ends, DEPTH.focus, threads))
    for other in every[1:]:
        for a, b in zip(every[0], other, strict=True):
            np.testing.assert_array_equal(a.offset, b.offset)
            np.testing.assert_array_equal(a.confidence, b.confidence)
    assert find_depths(seen.ray_field(), *ends, DEPTH.focus)
