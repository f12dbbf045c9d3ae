"""Pose track: interpolation against analytic motion, refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roller_core.pose_track import (
    NoPosesError,
    PoseExtrapolationError,
    PoseGapError,
    PoseOrderError,
    PoseTrack,
    PoseValueError,
)
from roller_core.transforms import (
    inverse_pose,
    matrix_to_quaternion,
    multiply_quaternions,
    pose_matrix,
    quaternion_to_matrix,
    rotation_vector_to_quaternion,
)

IDENTITY = [0.0, 0.0, 0.0, 1.0]
EPOCH_NS = 1_790_000_000_000_000_000

vectors = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)


def straight(n: int = 10, step_ns: int = 8_000_000, start_ns: int = EPOCH_NS) -> PoseTrack:
    track = PoseTrack()
    for k in range(n):
        track.append(start_ns + k * step_ns, [0.004 * k, 1.0, 2.0], IDENTITY)
    return track


@given(vector=vectors)
def test_matrix_and_quaternion_are_inverse(vector: np.ndarray) -> None:
    q = rotation_vector_to_quaternion(vector)
    back = matrix_to_quaternion(quaternion_to_matrix(q))
    assert abs(abs(q @ back) - 1) < 1e-12


@given(a=vectors, b=vectors)
def test_quaternion_product_is_matrix_product(a: np.ndarray, b: np.ndarray) -> None:
    qa, qb = rotation_vector_to_quaternion(a), rotation_vector_to_quaternion(b)
    np.testing.assert_allclose(
        quaternion_to_matrix(multiply_quaternions(qa, qb)),
        quaternion_to_matrix(qa) @ quaternion_to_matrix(qb),
        atol=1e-12,
    )


@given(v=vectors, p=vectors)
def test_inverse_pose(v: np.ndarray, p: np.ndarray) -> None:
    m = pose_matrix(p, rotation_vector_to_quaternion(v))
    np.testing.assert_allclose(m @ inverse_pose(m), np.eye(4), atol=1e-12)


@given(angle=st.floats(-3.0, 3.0), fraction=st.floats(0, 1), flip=st.booleans())
def test_rotation_is_spherical_and_ignores_the_sign(
    angle: float, fraction: float, flip: bool
) -> None:
    track = PoseTrack()
    q1 = rotation_vector_to_quaternion([0, 0, angle])
    track.append(0, [0, 0, 0], IDENTITY)
    track.append(8_000_000, [0, 0, 0], -q1 if flip else q1)
    t = round(8_000_000 * fraction)
    expected = rotation_vector_to_quaternion([0, 0, angle * t / 8_000_000])
    assert abs(abs(track.at(t).quaternion @ expected) - 1) < 1e-9


def test_epoch_times_lose_nothing() -> None:
    """A step of 1 ns at epoch times moves the pose by what the speed says: 0.5 m/s."""
    track = straight()
    t = EPOCH_NS + np.array([1_000_000, 1_000_001, 1_001_000])
    x = track.sample(t)[0][:, 0]
    np.testing.assert_allclose(x - x[0], [0, 0.5e-9, 0.5e-6], atol=1e-15)


def test_unnormalised_quaternions_are_normalised() -> None:
    track = PoseTrack()
    track.append(0, [0, 0, 0], [0, 0, 0, 2.0])
    np.testing.assert_allclose(track.at(0).quaternion, IDENTITY)


def test_refusals_name_the_reason() -> None:
    with pytest.raises(NoPosesError):
        PoseTrack().at(0)
    track = straight()
    with pytest.raises(PoseExtrapolationError, match="poses reach from"):
        track.at(EPOCH_NS - 1)
    with pytest.raises(PoseExtrapolationError):
        track.at(track.end_ns + 1)
    with pytest.raises(PoseOrderError, match="backwards"):
        track.append(EPOCH_NS, [0, 0, 0], IDENTITY)
    with pytest.raises(PoseValueError):
        track.append(track.end_ns + 1, [np.nan, 0, 0], IDENTITY)
    for far_m in (1e10, -1e200):
        with pytest.raises(PoseValueError, match="m away, farther than any robot; is it in metres"):
            track.append(track.end_ns + 1, [0, far_m, 0], IDENTITY)
    with pytest.raises(PoseValueError):
        track.append(track.end_ns + 1, [0, 0, 0], [0, 0, 0, 0])
    end = track.end_ns
    track.append(end + 300_000_000, [1, 1, 1], IDENTITY)
    with pytest.raises(PoseGapError, match=r"gap of 0\.300 s"):
        track.at(end + 1_000_000)
    assert track.covers(EPOCH_NS, end)
    assert not track.covers(EPOCH_NS, end + 1)


def test_discarding_keeps_what_is_needed() -> None:
    track = straight(300)
    t = EPOCH_NS + 250 * 8_000_000 + 1
    before = track.at(t).position
    track.discard_before(t)
    assert len(track) == 50
    np.testing.assert_array_equal(track.at(t).position, before)


def test_bends_are_what_a_straight_line_errs_by() -> None:
    # 10 m/s² between 40 and 80 ms; poses every 8 ms: 80 µm off in the middle of a step.
    t = np.arange(0, 160_000_001, 8_000_000) + EPOCH_NS

    def travel(t_ns: np.ndarray) -> np.ndarray:
        s = np.clip((t_ns - EPOCH_NS) * 1e-9 - 0.04, 0, None)
        return 5.0 * np.minimum(s, 0.04) ** 2 + 0.4 * np.clip(s - 0.04, 0, None)

    def place(t_ns: np.ndarray) -> np.ndarray:
        return np.stack([travel(t_ns), np.zeros(len(t_ns)), np.zeros(len(t_ns))], 1)

    track = PoseTrack()
    track.extend(t, place(t), np.tile([0.0, 0, 0, 1], (len(t), 1)))
    middle = (t[:-1] + t[1:]) // 2
    error = np.abs(track.sample(middle)[0] - place(middle))[:, 0]
    found = {begin for begin, _ in track.bent(int(t[0]), int(t[-1]), 20e-6)}
    assert found >= set(t[:-1][error > 20e-6].tolist())
    assert all(EPOCH_NS + 40_000_000 <= begin < EPOCH_NS + 80_000_000 for begin in found)
    assert not track.bent(int(t[0]), int(t[-1]), 85e-6)
    two = PoseTrack()
    two.extend(t[:2], place(t)[:2] + [[0.0, 0, 0], [1.0, 0, 0]], np.tile([0.0, 0, 0, 1], (2, 1)))
    assert not two.bent(int(t[0]), int(t[1]), 1e-6), "what is not known is no ramp"
    assert track.bent(EPOCH_NS + 57_000_000, EPOCH_NS + 58_000_000, 20e-6) == [
        (EPOCH_NS + 56_000_000, EPOCH_NS + 64_000_000)
    ]


def test_half_way_is_of_the_way_not_of_the_time() -> None:
    track = PoseTrack()
    for k, x in enumerate([0.0, 0.0, 0.0, 0.0, 0.004, 0.008]):
        track.append(EPOCH_NS + k * 8_000_000, [x, 0, 0], [0, 0, 0, 1])
    assert track.half_way(EPOCH_NS, EPOCH_NS + 40_000_000) == EPOCH_NS + 32_000_000
    assert track.half_way(EPOCH_NS + 28_000_000, EPOCH_NS + 36_000_000) == EPOCH_NS + 32_000_000
    assert track.half_way(EPOCH_NS, EPOCH_NS + 20_000_000) == EPOCH_NS + 10_000_000, "stands"
