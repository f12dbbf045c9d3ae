"""A cloud's points without a copy of them."""

from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roller_core.bags import typestore
from roller_core.outputs import CloudError, cloud_of
from roller_core.serialized_cloud import SerializedCloud

STORE = typestore()
CLOUD = "sensor_msgs/msg/PointCloud2"


def message(frame: str, names: list[str], rows: np.ndarray, **changed: object) -> SimpleNamespace:
    types = STORE.types
    field = types["sensor_msgs/msg/PointField"]
    fields = [field(name, 4 * k, 7, 1) for k, name in enumerate(names)]
    stamp = types["builtin_interfaces/msg/Time"](1_700_000_000, 123_456_789)
    values = {
        "header": types["std_msgs/msg/Header"](stamp, frame),
        "height": 1,
        "width": len(rows),
        "fields": fields,
        "is_bigendian": False,
        "point_step": 4 * len(names),
        "row_step": rows.size * 4,
        "data": np.frombuffer(rows.astype("<f4").tobytes(), np.uint8),
        "is_dense": True,
    } | changed
    return types[CLOUD](**values)


def serialized(*args: object, **changed: object) -> bytes:
    return bytes(STORE.serialize_cdr(message(*args, **changed), CLOUD))


text = st.text(st.characters(codec="ascii", exclude_characters="\0"), max_size=9)


@settings(max_examples=50)
@given(frame=text, names=st.lists(text, min_size=1, max_size=8), count=st.integers(0, 5))
def test_points_are_those_of_the_message(frame: str, names: list[str], count: int) -> None:
    rows = np.arange(count * len(names), dtype=np.float32).reshape(count, len(names))
    found = SerializedCloud.parse(serialized(frame, names, rows))
    assert found.stamp_ns == 1_700_000_000_123_456_789
    assert found.frame_id == frame
    assert found.cloud.names == tuple(names)
    assert np.array_equal(found.cloud.columns, rows)


@pytest.mark.parametrize(
    "changed",
    [{"is_bigendian": True}, {"point_step": 12}, {"data": np.zeros(7, np.uint8)}, {"fields": []}],
)
def test_what_is_no_cloud_of_ours_is_refused_in_the_same_words(changed: dict[str, object]) -> None:
    rows = np.zeros((2, 2), np.float32)
    with pytest.raises(CloudError) as expected:
        cloud_of(message("base", ["x", "y"], rows, **changed))
    with pytest.raises(CloudError) as found:
        SerializedCloud.parse(serialized("base", ["x", "y"], rows, **changed))
    assert str(found.value) == str(expected.value)


@given(st.data())
def test_broken_messages_are_refused(data: st.DataObject) -> None:
    whole = serialized("base", ["x", "y", "z"], np.ones((3, 3), np.float32))
    cut = data.draw(st.integers(0, len(whole) - 2))  # the last byte says whether it is dense
    with pytest.raises(CloudError):
        SerializedCloud.parse(whole[:cut])
    place, byte = data.draw(st.integers(0, 60)), data.draw(st.integers(0, 255))
    with suppress(CloudError):
        SerializedCloud.parse(whole[:place] + bytes([byte]) + whole[place + 1 :])


def test_many_fields_are_not_counted_up_to() -> None:
    whole = serialized("", ["x"], np.ones((1, 1), np.float32))
    at = 4 + 12 + 4 + 8  # encapsulation, header with an empty name, height and width
    with pytest.raises(CloudError, match="fields"):
        SerializedCloud.parse(whole[:at] + b"\xff" * 4 + whole[at + 4 :])
