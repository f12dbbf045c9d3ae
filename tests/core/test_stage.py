"""Whom a stage takes for a source that started anew, by its poses."""

from collections.abc import Iterator, Mapping

import pytest

from roller_core.camera import Camera
from roller_core.frame_settings import FollowedFrames
from roller_core.frame_transforms import Transform
from roller_core.outputs import Result
from roller_core.pose_track import PoseOrderError
from roller_core.stage import Stage

MS = 1_000_000


class Counting(Stage[FollowedFrames]):
    """Counts how often it begins anew."""

    begun = 0

    def take_camera(self, camera: Camera) -> None: ...

    def counts(self) -> Mapping[str, object]:
        return {}

    def rated(self) -> Mapping[str, float]:
        return {}

    def _begin(self) -> None:
        self.begun += 1

    def _results(self, flush: bool) -> Iterator[Result]:
        yield from ()


@pytest.fixture
def stage() -> Counting:
    """Has seen 0.6 s of poses, 2 ms apart."""
    stage = Counting(FollowedFrames.create({"pose_smoothing": 0}))
    stage.take_transform(pose(0, "tool0_controller", "event_camera_optical_frame", static=True))
    for k in range(301):
        stage.take_transform(pose(2 * k))
    return stage


def pose(
    ms: float, parent: str = "base", child: str = "tool0_controller", static: bool = False
) -> Transform:
    at = (1e-4 * ms, 0.0, 0.0)
    return Transform(parent, child, round(ms * MS), at, (0.0, 0.0, 0.0, 1.0), static)


def older(stage: Counting, ms: float) -> None:
    with pytest.raises(PoseOrderError):
        stage.take_transform(pose(ms))


def test_a_recording_of_less_than_a_second_is_followed_the_second_time(stage: Counting) -> None:
    older(stage, 0)
    for k in range(1, 10):  # which is said once
        stage.take_transform(pose(2 * k))
    assert stage.begun == 1
    # None of those that told it is lost.
    assert (stage.frames.track.start_ns, stage.frames.track.end_ns) == (0, 18 * MS)
    stage.take_transform(pose(20))
    assert (stage.begun, len(stage.frames.track)) == (1, 11)


def test_poses_that_come_late_now_and_then_are_left_out(stage: Counting) -> None:
    for k in range(100):
        older(stage, 2 * k)
        stage.take_transform(pose(602 + 2 * k))
    for k in range(100):  # in no order
        older(stage, 500 - k)
    assert stage.begun == 0
    assert stage.frames.track.start_ns == 0
    assert stage.frames.track.end_ns == 800 * MS


def test_one_pose_of_long_ago_is_enough(stage: Counting) -> None:
    stage.take_transform(pose(5000))
    older(stage, 3900)
    assert (stage.begun, len(stage.frames.track)) == (1, 0)
