"""Rays and votes against analytic geometry and slow numpy twins."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emvs.scenes import CAMERA, MS, rolling, track_of
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseError, PoseTrack
from roller_core.transforms import inverse_pose, rotation_vector_to_quaternion
from roller_emvs import _pose_kernels
from roller_emvs import rays as r
from roller_emvs.methods.paper.votes import dense_volume, sweep_maximum, sweep_views

PLANES = np.linspace(0.043, 0.047, 7)


def random_track(rng: np.random.Generator, base: np.ndarray | None = None) -> PoseTrack:
    track = PoseTrack()
    for k in range(6):
        position = (base if base is not None else 0.0) + rng.normal(0, 0.002, 3)
        track.append(k * 8 * MS, position, rotation_vector_to_quaternion(rng.normal(0, 0.02, 3)))
    return track


def random_events(rng: np.random.Generator, n: int = 500) -> EventArray:
    t = np.sort(rng.integers(0, 40 * MS, n))
    return EventArray.from_arrays(rng.integers(0, 160, n), rng.integers(0, 120, n), t, np.ones(n))


def twin_volume(
    packets: r.Packets, view: np.ndarray, camera: Camera, planes: np.ndarray
) -> np.ndarray:
    """Bilinear votes, event by event, by intersecting each ray with each plane."""
    volume = np.zeros((len(planes), camera.height, camera.width))
    k_inverse = np.linalg.inv(camera.K)
    for packet in range(len(packets.starts) - 1):
        relative = inverse_pose(view) @ packets.poses[packet]
        centre = relative[:3, 3]
        for i in range(packets.starts[packet], packets.starts[packet + 1]):
            direction = (
                relative[:3, :3]
                @ k_inverse
                @ [*packets.table[packets.events.y[i], packets.events.x[i]], 1.0]
            )
            for n, z in enumerate(planes):
                point = centre + direction * (z - centre[2]) / direction[2]
                u, v, _ = camera.K @ (point / z)
                x, y = int(np.floor(u)), int(np.floor(v))
                if 0 <= u < camera.width - 1 and 0 <= v < camera.height - 1:
                    fx, fy = u - x, v - y
                    volume[n, y, x] += (1 - fx) * (1 - fy)
                    volume[n, y, x + 1] += fx * (1 - fy)
                    volume[n, y + 1, x] += (1 - fx) * fy
                    volume[n, y + 1, x + 1] += fx * fy
    return volume


VIEW_NS = 20 * MS


@pytest.fixture
def track() -> PoseTrack:
    return random_track(np.random.default_rng(3))


@pytest.fixture
def packets(track: PoseTrack) -> r.Packets:
    events = random_events(np.random.default_rng(4))
    return r.make_packets(events, CAMERA.undistortion_table(), track, 64)


@pytest.fixture
def bundle(track: PoseTrack, packets: r.Packets) -> r.RayBundle:
    return r.rays_in_view(packets, CAMERA, track.at(VIEW_NS).matrix)


def test_packets_take_all_events_and_the_median_pose() -> None:
    rng = np.random.default_rng(0)
    track, events = random_track(rng), random_events(rng, 300)
    packets = r.make_packets(events, CAMERA.undistortion_table(), track, 256)
    np.testing.assert_array_equal(packets.starts, [0, 256, 300])
    expected = track.matrices([events.t_ns[127], events.t_ns[256 + 21]])
    np.testing.assert_allclose(packets.poses, expected, rtol=0, atol=1e-14)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**16), st.integers(1, 400), st.integers(1, 100), st.floats(1e-5, 1e-2))
def test_events_of_a_packet_lie_no_further_apart_than_allowed(
    seed: int, n: int, size: int, most_m: float
) -> None:
    rng = np.random.default_rng(seed)
    track, events = track_of(rolling(0.3), 0.05), random_events(rng, n)
    packets = r.make_packets(events, CAMERA.undistortion_table(), track, size, most_m)
    counts, n = np.diff(packets.starts), len(events)
    assert counts.min() >= 1
    assert packets.starts[-1] == n
    assert set(range(0, n, size)) <= set(packets.starts)
    at = track.matrices(events.t_ns)[:, :3, 3]
    ends = np.linalg.norm(at[packets.starts[1:] - 1] - at[packets.starts[:-1]], axis=1)
    assert (ends <= most_m + 1e-9).all()
    medians = (packets.starts[:-1] + packets.starts[1:] - 1) // 2
    np.testing.assert_allclose(packets.poses[:, :3, 3], at[medians], rtol=0, atol=1e-12)


def test_a_pose_a_million_kilometres_off_takes_no_more_memory() -> None:
    track = PoseTrack()
    for k in range(6):
        track.append(
            k * 8 * MS, [1e9 * (k == 3), 0.0, 0.0], rotation_vector_to_quaternion(np.zeros(3))
        )
    events = random_events(np.random.default_rng(2), 300)
    packets = r.make_packets(events, CAMERA.undistortion_table(), track, 64, 1e-5)
    assert len(packets.starts) <= 301


def test_a_packet_of_two_readout_frames_is_cut_between_them() -> None:
    """Frames of 100 events, 0.2 ms apart: 60 µm, more than a pixel."""
    track = track_of(rolling(0.3), 0.05)
    t_ns = np.repeat(np.arange(5) * MS // 5, 100)
    events = EventArray.from_arrays(np.tile(np.arange(100), 5), t_ns * 0, t_ns, t_ns * 0 + 1)
    packets = r.make_packets(events, CAMERA.undistortion_table(), track, 64, 1e-5)
    expected = sorted({*range(0, 500, 64), *range(0, 501, 100)})
    np.testing.assert_array_equal(packets.starts, expected)


@pytest.mark.parametrize("poses", [1, 2, 6])
def test_poses_of_packets_are_those_of_the_track(poses: int) -> None:
    rng = np.random.default_rng(poses)
    track = PoseTrack()
    for k in range(poses):
        if k != 2:
            quaternion = rotation_vector_to_quaternion(rng.normal(0, 0.5, 3))
        else:  # turns no further, and the sign says nothing
            quaternion = -track.quaternions[-1]
        track.append(10**18 + k * 8 * MS, rng.normal(0, 1, 3), quaternion)
    times = np.r_[track.times_ns, rng.integers(track.start_ns, track.end_ns + 1, 50)]
    found, expected = r.matrices_at(track, times), track.matrices(times)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)
    with pytest.raises(PoseError):
        r.matrices_at(track, [track.end_ns + 1])


def test_packets_are_seen_from_a_view_by_their_relative_poses() -> None:
    rng = np.random.default_rng(8)
    track = random_track(rng)
    poses, view = track.matrices(rng.integers(0, 40 * MS, 20)), track.at(VIEW_NS).matrix
    relative, k = inverse_pose(view) @ poses, CAMERA.K
    h, centres = np.empty((20, 3, 3), np.float32), np.empty((20, 3), np.float32)
    _pose_kernels._seen(inverse_pose(view), poses, k, np.linalg.inv(k), h, centres)
    expected = k @ relative[:, :3, :3] @ np.linalg.inv(k)
    np.testing.assert_allclose(h, expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(centres, relative[:, :3, 3], rtol=1e-6, atol=1e-12)


def test_a_point_meets_itself_on_its_plane() -> None:
    """From wherever it is seen, a point's rays cross its own depth at one pixel."""
    camera = Camera(640, 480, 1066, 1066, 319.5, 239.5, (-0.1, 0.05, 1e-3, -1e-3, 0.0))
    rng = np.random.default_rng(1)
    track = random_track(rng)
    reference = track.at(20 * MS).matrix
    point = reference @ [0.001, -0.002, 0.0446, 1.0]
    for t in (0, 7 * MS, 33 * MS):
        local = inverse_pose(track.at(t).matrix) @ point
        ideal = camera.undistort(camera.project(local[None, :3]))[0].astype(np.float32)
        one = EventArray.from_arrays([0], [0], [t], [1])
        packets = r.Packets(one, ideal[None, None], np.array([0, 1]), track.matrices([t]))
        ray = r.rays_in_view(packets, camera, reference).rays[0]
        u, v = ray[:2] + ray[2:] / 0.0446
        expected = camera.K @ (np.array([0.001, -0.002, 0.0446]) / 0.0446)
        np.testing.assert_allclose([u, v], expected[:2], atol=2e-3)


def test_a_base_kilometres_away_costs_nothing() -> None:
    rng = np.random.default_rng(2)
    events = random_events(rng)
    far = np.array([5000.0, -3000.0, 800.0])
    bundles = []
    for base in (None, far):
        track = random_track(np.random.default_rng(5), base)
        packets = r.make_packets(events, CAMERA.undistortion_table(), track, 64)
        bundles.append(r.rays_in_view(packets, CAMERA, track.at(20 * MS).matrix))
    np.testing.assert_allclose(bundles[0].rays, bundles[1].rays, atol=1e-4)
    np.testing.assert_allclose(bundles[0].limits, bundles[1].limits, rtol=1e-6)


def test_dense_volume_equals_its_twin(packets: r.Packets, track: PoseTrack) -> None:
    view = track.at(VIEW_NS).matrix
    volume = dense_volume(r.rays_in_view(packets, CAMERA, view), CAMERA, PLANES)
    # A vote that falls on a pixel's edge may fall to either side in float32.
    np.testing.assert_allclose(volume, twin_volume(packets, view, CAMERA, PLANES), atol=5e-3)


@pytest.mark.parametrize("threads", [1, 2, 3, 16])
def test_sweep_equals_the_dense_maximum(bundle: r.RayBundle, threads: int) -> None:
    volume = dense_volume(bundle, CAMERA, PLANES)
    votes, index = sweep_maximum(bundle, CAMERA, PLANES, threads)
    np.testing.assert_array_equal(votes, volume.max(axis=0))
    np.testing.assert_array_equal(index, volume.argmax(axis=0))


@given(shifts=st.lists(st.integers(-40, 40), min_size=len(PLANES), max_size=len(PLANES)))
@settings(max_examples=30)
def test_shifted_views_see_bilinear_votes_exactly(shifts: list[int]) -> None:
    """Hats of half a pixel add up to hats of one, at whole and at half positions.

    But for what shares of a vote are rounded by, to 1/255.
    """
    rng = np.random.default_rng(5)
    events = random_events(rng, 300)
    track = random_track(np.random.default_rng(3))
    packets = r.make_packets(events, CAMERA.undistortion_table(), track, 64)
    rays = r.rays_in_view(packets, CAMERA, track.at(VIEW_NS).matrix)
    halves = np.stack([np.array(shifts), np.zeros(len(PLANES), int)])
    found = sweep_views(rays, CAMERA, PLANES, halves, 2)
    assert found is not None
    votes, index = found
    for view in range(2):
        volume = np.empty((len(PLANES), CAMERA.height, CAMERA.width))
        for k, z in enumerate(PLANES):
            moved = rays.rays.copy()
            moved[:, 0] -= halves[view, k] / 2
            # Events may come from beside the image here, by the views' shift.
            one = dense_volume(r.RayBundle(moved, rays.limits), CAMERA, np.array([z]))
            volume[k] = one[0]
        inner = np.s_[:, 1:-1]
        np.testing.assert_allclose(votes[view][inner], volume.max(axis=0)[inner], atol=0.01)
        picked = np.take_along_axis(volume, index[view][None].astype(int), 0)[0]
        np.testing.assert_allclose(picked[inner], volume.max(axis=0)[inner], atol=0.02)


def test_shifted_views_do_not_depend_on_threads(bundle: r.RayBundle) -> None:
    halves = np.arange(-20, -20 + len(PLANES))[None, :]
    expected = sweep_views(bundle, CAMERA, PLANES, halves, 1)
    found = sweep_views(bundle, CAMERA, PLANES, halves, 3)
    assert expected is not None
    assert found is not None
    for a, b in zip(expected, found, strict=True):
        np.testing.assert_array_equal(a, b)


def test_too_many_rays_in_one_place_are_left_to_each_view_s_own_sweep() -> None:
    halves = np.zeros((1, len(PLANES)), np.int64)
    votes, _ = sweep_views(still(80.25, 60.5, 100), CAMERA, PLANES, halves) or (None, None)
    assert votes is not None
    np.testing.assert_allclose(votes[0].max(), 37.5, atol=0.5)
    assert sweep_views(still(80.25, 60.5, 10_000), CAMERA, PLANES, halves) is None


def still(u: float, v: float, n: int = 1, limit: float = np.inf) -> r.RayBundle:
    """Rays of a camera that doesn't move."""
    rays = np.tile(np.array([[u, v, 0.0, 0.0]], np.float32), (n, 1))
    return r.RayBundle(rays, np.full(n, limit, np.float32))


def test_every_vote_counts_once() -> None:
    """Rays that stay inside spread one vote a plane over four pixels."""
    votes = dense_volume(still(80.2, 60.7, 10), CAMERA, PLANES).sum(axis=(1, 2))
    np.testing.assert_allclose(votes, 10, rtol=1e-5)


def test_planes_behind_a_packet_get_no_votes(track: PoseTrack) -> None:
    # A camera that stood 45.5 mm ahead of the reference sees no plane nearer than that.
    ahead = np.eye(4)
    ahead[2, 3] = 0.0455
    event = EventArray.from_arrays([80], [60], [0], [1])
    packets = r.Packets(event, CAMERA.undistortion_table(), np.array([0, 1]), ahead[None])
    rays = r.rays_in_view(packets, CAMERA, np.eye(4))
    planes = np.array([0.0454, 0.0456, 0.6])
    votes = dense_volume(rays, CAMERA, planes).sum(axis=(1, 2))
    assert votes[0] == 0
    assert votes[2] == pytest.approx(1)
    near = sweep_maximum(rays, CAMERA, planes[:1])[0]
    assert near.sum() == 0


def test_nan_rays_get_no_votes() -> None:
    for u in (np.nan, r.OUTSIDE):
        assert dense_volume(still(u, 60.0), CAMERA, PLANES).sum() == 0
        assert sweep_maximum(still(u, 60.0), CAMERA, PLANES)[0].sum() == 0
