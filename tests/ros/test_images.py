"""Images of strangers: any bytes are an image, or are refused by name."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import Image

from roller_core import outputs
from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.frame_transforms import Transform
from roller_core.outputs import Output
from roller_emvs.stitcher_stage import StitcherParameters, StitcherStage
from roller_ros import messages
from roller_ros.feeding import feed
from roller_ros.images import image_to_array

SIZES = st.sampled_from([0, 1, 3, 4, 8, 2**31, 2**32 - 1])
UNIT = (0.0, 0.0, 0.0, 1.0)


@given(
    encoding=st.sampled_from(["32FC1", "mono8", "rgb8", ""]),
    width=SIZES, height=SIZES, step=SIZES, data=st.binary(max_size=64),
)  # fmt: skip
def test_any_image_is_read_or_refused(
    encoding: str, width: int, height: int, step: int, data: bytes
) -> None:
    stage = StitcherStage(StitcherParameters.create({}))
    faults: list[RollerError] = []
    image = Image(encoding=encoding, width=width, height=height, step=step, data=data)
    feed(stage, outputs.DEPTH_IMAGE, image, faults.append)
    if not faults:
        assert image_to_array(image).shape == (height, width)


def test_stamps_of_another_time_do_not_stand_in_the_way() -> None:
    """A hundred depth maps from the year 2038 wait for poses that never come."""
    stage = StitcherStage(StitcherParameters.create({}))
    stage.take_camera(Camera(8, 6, 10.0, 10.0, 4.0, 3.0))
    mounted = Transform("tool0_controller", stage.settings.sensor_frame, 0, (0, 0, 0), UNIT, True)
    stage.take_transform(mounted)
    image = Image(encoding="32FC1", width=8, height=6, step=32, data=bytes(192))

    def give(t_ns: int) -> None:
        image.header.stamp = messages.to_time(t_ns)
        for topic in (outputs.DEPTH_IMAGE, outputs.DEPTH_CONFIDENCE, outputs.DEPTH_SIGMA):
            feed(stage, topic, image, print)

    for k in range(150):
        give(2_147_000_000 * 10**9 + k)
    for k in range(40):
        now = 10**12 + k * 10**7
        stage.take_transform(Transform("base", "tool0_controller", now, (k * 1e-4, 0, 0), UNIT))
        if k < 20:
            give(now + 10**7)  # its pose comes later
        list(stage.results())
    assert stage.counts()["depth_maps"] == 20


@pytest.mark.parametrize("image_comes_last", [False, True])
def test_what_is_in_view_comes_when_the_camera_comes_once_more(image_comes_last: bool) -> None:
    stage = StitcherStage(StitcherParameters.create({}))
    camera, t_ns = Camera(8, 6, 10.0, 10.0, 4.0, 3.0), 10**12
    stage.take_transform(
        Transform("tool0_controller", stage.settings.sensor_frame, 0, (0, 0, 0), UNIT, True)
    )
    for k in range(12):
        then = t_ns + (k - 3) * 8_000_000
        stage.take_transform(Transform("base", "tool0_controller", then, (0, 0, 0), UNIT))
    depth = np.full((6, 8), 0.045, np.float32)
    topics = [outputs.DEPTH_CONFIDENCE, outputs.DEPTH_SIGMA, outputs.DEPTH_IMAGE]
    topics.insert(3 - image_comes_last, "the end")

    def give(topic: str) -> int:
        """Give one message; how many points come of it."""
        name = outputs.DEPTH_INFO if topic == "the end" else topic
        output = Output(name, t_ns, "camera", camera if name == outputs.DEPTH_INFO else depth)
        feed(stage, name, messages.to_message(output), pytest.fail)
        found = [output for result in stage.results() for output in result.outputs]
        return sum(len(o.data.columns) for o in found if o.topic == outputs.SURFACE_POINTS)

    points = [give(topic) for topic in (outputs.DEPTH_INFO, *topics)]
    assert points[:4] == [0, 0, 0, 0]
    assert points[4] == 48
