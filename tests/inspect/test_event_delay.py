"""A delay that is set is taken out of everything that puts events together with poses."""

import numpy as np
import pytest

from braille.synthetic import Plate, over, read, scan
from emvs.scenes import CAMERA, rolling, tilted_scan, track_of
from roller_core.events import EventArray
from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep
from roller_emvs.pipeline import DepthPipeline

DELAY_S, DELAY_NS = 0.0017, 1_700_000


@pytest.fixture(scope="module")
def events() -> EventArray:
    return tilted_scan(0.08)


@pytest.mark.parametrize("method", ["focus", "bma"])
def test_depth_maps_are_those_of_events_in_time(events: EventArray, method: str) -> None:
    def maps(given: EventArray, delay_s: float) -> list[DepthMap]:
        values = {"method": method, "event_delay_s": delay_s}
        pipeline = DepthPipeline(DepthSettings.create(values), CAMERA, track_of(rolling(0.3), 0.08))
        pipeline.add_events(given)
        return [m for m in pipeline.results(flush=True) if isinstance(m, DepthMap)]

    expected, found = maps(events, 0.0), maps(events.shifted(DELAY_NS), DELAY_S)
    assert expected
    for a, b in zip(expected, found, strict=True):
        assert a.stamp_ns == b.stamp_ns
        np.testing.assert_array_equal(a.depth, b.depth)


def test_the_surface_is_that_of_events_in_time(events: EventArray) -> None:
    def points(given: EventArray, delay_s: float) -> np.ndarray:
        values = {"event_delay_s": delay_s, "min_aperture_m": 0.004}
        sweep = SurfaceSweep(SurfaceSettings.create(values), CAMERA, track_of(rolling(0.3), 0.08))
        sweep.add_events(given)
        return np.concatenate(
            [p.points for p in sweep.results(flush=True) if isinstance(p, SurfacePatch)]
        )

    found = points(events.shifted(DELAY_NS), DELAY_S)
    assert len(found)
    np.testing.assert_array_equal(found, points(events, 0.0))


def test_cells_are_those_of_events_in_time() -> None:
    plate = Plate().text("abc")
    track = over(plate)
    events = scan(plate, track)
    expected = read(events, track)
    found = read(events.shifted(DELAY_NS), track, event_delay_s=DELAY_S)
    assert [c.mask for c in expected[0]] == [c.mask for c in found[0]]
    assert [c.stamp_ns for c in expected[0]] == [c.stamp_ns for c in found[0]]
