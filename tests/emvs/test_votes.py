"""Rays and votes against analytic geometry and slow numpy twins."""

from __future__ import annotations

import numpy as np
import pytest

from emvs.scenes import CAMERA, MS
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import inverse_pose, rotation_vector_to_quaternion
from roller_emvs import rays as r
from roller_emvs.votes import dense_volume, sweep_maximum


def random_track(rng: np.random.Generator, base: np.ndarray | None = None) -> PoseTrack:
    track = PoseTrack()
    for k in range(6):
        position = (base if base is not None else 0.0) + rng.normal(0, 0.002, 3)
        track.append(k * 8 * MS, position, rotation_vector_to_quaternion(rng.normal(0, 0.02, 3)))
    return track


def random_events(rng: np.random.Generator, n: int = 500) -> EventArray:
    t = np.sort(rng.integers(0, 40 * MS, n))
    return EventArray.from_arrays(rng.integers(0, 160, n), rng.integers(0, 120, n), t, np.ones(n))


def twin_volume(rays: r.RayBundle, camera: Camera, planes: np.ndarray) -> np.ndarray:
    """Bilinear votes, event by event, by intersecting each ray with each plane."""
    volume = np.zeros((len(planes), camera.height, camera.width))
    k_inverse = np.linalg.inv(camera.K)
    for packet in range(len(rays.starts) - 1):
        for i in range(rays.starts[packet], rays.starts[packet + 1]):
            direction = k_inverse @ [rays.u[i], rays.v[i], 1.0]
            for n, z in enumerate(planes):
                centre = rays.centres[packet]
                point = centre + direction * (z - centre[2])
                u, v, _ = camera.K @ (point / z)
                x, y = int(np.floor(u)), int(np.floor(v))
                if 0 <= u < camera.width - 1 and 0 <= v < camera.height - 1:
                    fx, fy = u - x, v - y
                    volume[n, y, x] += (1 - fx) * (1 - fy)
                    volume[n, y, x + 1] += fx * (1 - fy)
                    volume[n, y + 1, x] += (1 - fx) * fy
                    volume[n, y + 1, x + 1] += fx * fy
    return volume


@pytest.fixture
def bundle() -> r.RayBundle:
    rng = np.random.default_rng(3)
    track, events = random_track(rng), random_events(rng)
    packets = r.make_packets(events, CAMERA.undistortion_table(), track, 64)
    return r.rays_in_view(packets, CAMERA, track.at(20 * MS).matrix)


PLANES = r.depth_planes(0.043, 0.047, 7, "depth")


def test_packets_take_all_events_and_the_median_pose() -> None:
    rng = np.random.default_rng(0)
    track, events = random_track(rng), random_events(rng, 300)
    packets = r.make_packets(events, CAMERA.undistortion_table(), track, 256)
    np.testing.assert_array_equal(packets.starts, [0, 256, 300])
    expected = track.matrices([events.t_ns[127], events.t_ns[256 + 21]])
    np.testing.assert_array_equal(packets.poses, expected)


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
        packets = r.Packets(ideal[:1], ideal[1:], np.array([0, 1]), track.matrices([t]))
        rays = r.rays_in_view(packets, camera, reference)
        scale, shift_u, shift_v = r.plane_coefficients(rays, camera, np.array([0.0446]))
        u = rays.u[0] * scale[0, 0] + shift_u[0, 0]
        v = rays.v[0] * scale[0, 0] + shift_v[0, 0]
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
    np.testing.assert_allclose(bundles[0].centres, bundles[1].centres, atol=2e-12)
    np.testing.assert_allclose(bundles[0].u, bundles[1].u, atol=1e-4)


def test_dense_volume_equals_its_twin(bundle: r.RayBundle) -> None:
    np.testing.assert_allclose(
        dense_volume(bundle, CAMERA, PLANES), twin_volume(bundle, CAMERA, PLANES), atol=5e-3
    )


@pytest.mark.parametrize("threads", [1, 2, 3, 16])
def test_sweep_equals_the_dense_maximum(bundle: r.RayBundle, threads: int) -> None:
    volume = dense_volume(bundle, CAMERA, PLANES)
    votes, index = sweep_maximum(bundle, CAMERA, PLANES, threads)
    np.testing.assert_array_equal(votes, volume.max(axis=0))
    np.testing.assert_array_equal(index, volume.argmax(axis=0))


def test_every_vote_counts_once(bundle: r.RayBundle) -> None:
    """Rays that stay inside spread one vote a plane over four pixels."""
    inside = r.RayBundle(
        np.full(10, 80.2, np.float32), np.full(10, 60.7, np.float32),
        np.array([0, 10]), np.zeros((1, 3)),
    )  # fmt: skip
    np.testing.assert_allclose(dense_volume(inside, CAMERA, PLANES).sum(axis=(1, 2)), 10, rtol=1e-5)


def test_planes_behind_a_packet_get_no_votes() -> None:
    rays = r.RayBundle(
        np.array([80], np.float32), np.array([60], np.float32), np.array([0, 1]),
        np.array([[0.0, 0.0, 0.05]]),
    )  # fmt: skip
    assert dense_volume(rays, CAMERA, PLANES).sum() == 0


def test_nan_rays_get_no_votes() -> None:
    rays = r.RayBundle(
        np.array([np.nan, r.OUTSIDE], np.float32), np.array([60, 60], np.float32),
        np.array([0, 2]), np.zeros((1, 3)),
    )  # fmt: skip
    assert dense_volume(rays, CAMERA, PLANES).sum() == 0


def test_planes_reach_both_ends() -> None:
    for spacing in ("depth", "inverse_depth"):
        planes = r.depth_planes(0.043, 0.047, 500, spacing)
        assert (planes[0], planes[-1]) == pytest.approx((0.043, 0.047))
        assert np.all(np.diff(planes) > 0)
    assert np.diff(r.depth_planes(0.043, 0.047, 501, "depth")) == pytest.approx(8e-6)
