"""Errors of surface points against the truth of a scan."""

import numpy as np
import pytest

from roller_emvs.depth_map import DepthMap
from roller_inspect.results.truth_tally import SurfaceTally, TruthTally
from roller_sim.cell import VirtualCell
from roller_sim.cell_settings import VirtualCellSettings
from roller_sim.relief import Region


def test_of_a_plate_without_objects_what_the_camera_passed_counts() -> None:
    truth = VirtualCell(VirtualCellSettings.create({"scene": {"name": "flat"}}, "test")).truth
    assert not truth.objects
    end_ns = truth.start_ros_ns + truth.duration_ns
    first, last = truth.camera_positions([truth.start_ros_ns, end_ns])[:, 0]
    x, y = np.meshgrid(np.linspace(first + 1e-3, last - 1e-3, 20), np.linspace(-5e-3, 5e-3, 5))
    beyond = np.array([[last + 5e-3, 0.0, 1.0]])
    good = np.stack([x, y, truth.height_at(x, y) + 1e-5], axis=-1).reshape(-1, 3)
    tally = SurfaceTally(truth, delay_s=truth.event_delay_ns * 1e-9)
    tally.add_points(np.concatenate([good, beyond]), truth.start_ros_ns)
    found = tally.summary()
    assert found["objects"] == {}
    assert found["all"]["points"] == len(good)
    assert found["all"]["mae_um"] == pytest.approx(10.0, abs=0.1)


def test_an_object_smaller_than_a_pixel_has_no_edges_and_stops_nothing() -> None:
    truth = VirtualCell(VirtualCellSettings.create({"scene": {"name": "flat"}}, "test")).truth
    speck = Region("speck", 0.01, 0.01001, 0.0, 1e-5)
    tally = SurfaceTally(truth, regions={"speck": speck})
    tally.add_points(np.array([[0.010005, 5e-6, 1e-5]]), truth.start_ros_ns)
    found = tally.summary()["objects"]["speck"]
    assert found["points"] == 1
    assert np.isnan(found["edges_measured"])


def test_what_is_too_high_is_above_0_for_depth_maps_and_points_alike() -> None:
    truth = VirtualCell(VirtualCellSettings.create({"scene": {"name": "flat"}}, "test")).truth
    stamp_ns = truth.start_ros_ns + truth.duration_ns // 2
    depth = truth.seen_images(stamp_ns)[0]
    high = np.asarray(depth - 2e-5, np.float32)  # nearer to the camera
    maps, points = TruthTally(truth), SurfaceTally(truth)
    maps.add(DepthMap(stamp_ns, high, high, high, np.eye(4), stamp_ns, stamp_ns, 0))
    x, y = np.meshgrid(np.linspace(0.01, 0.02, 20), np.linspace(-3e-3, 3e-3, 5))
    above = np.stack([x, y, truth.height_at(x, y) + 2e-5], axis=-1).reshape(-1, 3)
    points.add_points(above, stamp_ns)
    for tally in (maps, points):
        assert tally.summary()["all"]["bias_um"] == pytest.approx(20.0, abs=1.0)
