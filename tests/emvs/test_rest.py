"""What the depth stage does where a scan ends: the robot is at rest, noise goes on or not."""

from collections.abc import Iterator

import numpy as np
import pytest

from emvs.scenes import CAMERA, MS, tilted_scan
from roller_core import outputs
from roller_core.event_stream import EventStream
from roller_core.events import EventArray
from roller_core.frame_transforms import Transform
from roller_core.outputs import Result
from roller_emvs.depth_stage import DepthStage

SPEED_M_S, DURATION_S, REST_S = 0.3, 0.12, 0.6
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def stage_at(window_m: float = 0.012) -> DepthStage:
    settings = {"window": {"travel_m": window_m}, "focus.sigma_px": 3.0}
    stage = DepthStage(DepthStage.model.create(settings))
    sensor = stage.settings.sensor_frame
    stage.take_transform(Transform("tool0_controller", sensor, 0, (0, 0, 0), UPRIGHT, True))
    stage.take_camera(CAMERA)
    return stage


def rolled(stage: DepthStage, events: EventArray, duration_s: float) -> Iterator[Result]:
    """Results while a scan and what is after it come pose by pose, without a flush."""
    for t_ns in range(0, round(duration_s * 1e9), 8 * MS):
        x = SPEED_M_S * min(t_ns * 1e-9, DURATION_S)
        stage.take_transform(Transform("base", "tool0_controller", t_ns, (x, 0, 0), UPRIGHT))
        a, b = np.searchsorted(events.t_ns, [t_ns - 8 * MS, t_ns])
        stage.take_events(events[a:b])
        yield from stage.results()


def given(results: list[Result], topic: str) -> list[int]:
    return [o.t_ns for r in results for o in r.outputs if o.topic == topic]


@pytest.fixture(scope="module")
def scan() -> EventArray:
    return tilted_scan(DURATION_S)


def test_the_last_depth_map_and_word_of_it_come_though_noise_goes_on(scan: EventArray) -> None:
    hot = np.arange(round(DURATION_S * 1e3), round((DURATION_S + REST_S) * 1e3)) * MS
    noise = EventArray.from_arrays(hot * 0 + 160, hot * 0 + 60, hot, hot * 0)
    quiet, noisy = stage_at(), stage_at()
    some = EventArray.concatenate([scan, noise[:5]])
    wanted = [*rolled(quiet, some, DURATION_S + 0.02), *quiet.results(flush=True)]
    found = list(rolled(noisy, EventArray.concatenate([scan, noise]), DURATION_S + REST_S))
    maps = given(found, outputs.DEPTH_IMAGE)
    assert len(maps) == len(given(wanted, outputs.DEPTH_IMAGE)) > 2
    # The camera with each map, and with the last one's stamp again: the stitcher need not wait.
    assert given(found, outputs.DEPTH_INFO) == [*maps, maps[-1]]
    assert not any(r.notice for r in found)
    # What follows while the robot stands says no more.
    assert list(noisy.results(flush=True)) == []


def test_a_scan_is_settled_when_events_of_after_it_have_come(
    scan: EventArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage, newest = stage_at(), 0
    monkeypatch.setattr(EventStream, "newest_ns", property(lambda _: newest))
    assert not stage.settled
    for _ in rolled(stage, scan, DURATION_S + 0.1):
        pass
    rest_ns = round(DURATION_S * 1e9)
    newest = rest_ns
    assert not stage.settled
    newest = rest_ns + 60 * MS
    assert stage.settled
    for _ in rolled(moving := stage_at(), scan, DURATION_S):
        pass
    assert not moving.settled
