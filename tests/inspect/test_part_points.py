"""Clouds that are none of a part's: left out, whatever they hold, and the part goes on."""

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from rosbags.typesys import Stores, get_typestore

from roller_core.outputs import SURFACE_POINTS, Cloud, CloudError, Output, cloud_of
from roller_emvs.patch import SURFACE_FIELDS
from roller_inspect.inspect_stage import InspectStage
from roller_inspect.part_points import PartPoints, PointsError

MESSAGES = get_typestore(Stores.ROS2_HUMBLE).types


def strip(x_m: float) -> np.ndarray:
    """20 × 4 mm of a plane, shape (n, 6)."""
    x, y = np.meshgrid(x_m + np.arange(0, 0.02, 1.5e-4), np.arange(0, 0.004, 1.5e-4))
    zero = np.zeros(x.size)
    return np.column_stack([x.ravel(), y.ravel(), zero, zero, zero + 1, zero + 1e-5])


def cloud(rows: np.ndarray) -> Cloud:
    return Cloud(np.asarray(rows, np.float32), SURFACE_FIELDS)


@given(arrays.arrays(np.float32, (7, 6)))
def test_what_passes_is_near(rows: np.ndarray) -> None:
    part = PartPoints()
    part.take(cloud(strip(0.0)))
    try:
        passed = part.take(cloud(rows))
    except PointsError:
        assert part.left_out == 7
        return
    assert len(passed) == 7 - part.left_out
    assert (np.abs(passed.points) < 2.0).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e38, 1e30, 1e3])
def test_one_stray_point_or_a_cloud_of_them_costs_no_part(value: float) -> None:
    stage = InspectStage(InspectStage.model.create({}))
    one, all_of_it = strip(0.02), np.full((5, 6), value)
    one[3, 0] = value
    for k, rows in enumerate([strip(0.0), one, all_of_it, strip(0.04)]):
        try:
            stage.take_output(Output(SURFACE_POINTS, k * 10**9, "base", cloud(rows)))
        except PointsError:
            assert rows is all_of_it
        list(stage.results())
    assert stage.counts()["left_out_points"] == 6
    stage.finish()
    assert stage.health()[1].startswith("part 1: conform")


@given(some.binary(max_size=60), some.integers(0, 7), some.integers(0, 40))
def test_any_bytes_are_points_or_refused(data: bytes, fields: int, step: int) -> None:
    field, message = (MESSAGES[f"sensor_msgs/msg/{name}"] for name in ("PointField", "PointCloud2"))
    named = [field(name, 4 * k, 7, 1) for k, name in enumerate(SURFACE_FIELDS[:fields])]
    raw = np.frombuffer(data, np.uint8)
    try:
        found = cloud_of(message(None, 1, 0, named, False, step, 0, raw, True))
    except CloudError:
        return
    assert found.columns.nbytes == len(data)
    assert found.names == SURFACE_FIELDS[:fields]
