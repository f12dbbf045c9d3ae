"""Voxels, ICP, patches and the cloud's file."""

import errno
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emvs.scenes import CAMERA, MS, depth_map, rolling, track_of
from roller_core import outputs
from roller_core.camera import Camera
from roller_core.errors import UnwritableOutputError
from roller_core.outputs import Output
from roller_core.stage import WARN
from roller_core.transforms import pose_matrix, rotation_vector_to_quaternion
from roller_emvs import registration
from roller_emvs.depth_settings import StitcherSettings
from roller_emvs.ply import PlyWriter, read_ply
from roller_emvs.registration import refine
from roller_emvs.stitcher import Stitcher, radius_filter
from roller_emvs.stitcher_stage import StitcherParameters, StitcherStage
from roller_emvs.voxels import VoxelMap


def flat(z_m: float = 0.045) -> np.ndarray:
    return np.full((CAMERA.height, CAMERA.width), z_m)


def test_voxels_hold_weighted_means() -> None:
    voxels = VoxelMap(1e-3)
    points = np.array([[0.5e-3, 0.5e-3, 0.5e-3], [0.7e-3, 0.5e-3, 0.5e-3], [0.9, 0.0, 0.0]])
    one, two = np.full(1, 2e-5, np.float32), np.full(2, 1e-5, np.float32)
    voxels.add(points[:1], np.array([0.25], np.float32), one)
    voxels.add(points[1:], np.array([0.75, 1.0], np.float32), two)
    merged, confidence, sigma = voxels.points()
    assert len(merged) == 2
    near = merged[np.argmin(merged[:, 0])]
    # The surer one counts four times.
    np.testing.assert_allclose(near, [0.66e-3, 0.5e-3, 0.5e-3], atol=1e-12)
    np.testing.assert_allclose(np.sort(confidence), [0.65, 1.0], rtol=1e-6)
    np.testing.assert_allclose(np.sort(sigma), [1e-5, 1.2e-5], rtol=1e-6)


def test_voxels_far_from_the_base_keep_micrometres() -> None:
    base = np.array([5000.0, -3000.0, 200.0])
    rng = np.random.default_rng(0)
    points = base + rng.uniform(0, 0.02, (500, 3))
    voxels = VoxelMap(1e-6)
    voxels.add(points, *np.full((2, 500), 0.5, np.float32))
    merged, *_ = voxels.points()
    order = np.lexsort(merged.T), np.lexsort(points.T)
    np.testing.assert_allclose(merged[order[0]], points[order[1]], atol=1e-8)


def test_voxels_leave_out_what_is_not_finite_or_absurdly_far() -> None:
    voxels = VoxelMap(1e-6)
    points = np.array([[0.0, 0, 0], [np.nan, 0, 0], [1e300, 0, 0]])
    assert voxels.add(points, *np.ones((2, 3), np.float32)) == 2
    assert len(voxels) == 1


@pytest.mark.parametrize("rolled_m", [60.0, 1000.0, -5000.0])
def test_a_scan_goes_on_however_far_it_has_rolled(rolled_m: float) -> None:
    stitcher = Stitcher(StitcherSettings.create({"icp": False, "voxel_m": 2e-4}), CAMERA)
    first = stitcher.add(depth_map(flat(), 0.0)), stitcher.finish()
    far = stitcher.add(depth_map(flat(), rolled_m)), stitcher.finish()
    here, there = (np.concatenate([p.points for p in patches]) for patches in (first, far))
    assert len(there) == pytest.approx(len(here), rel=0.02)
    shift = there.mean(axis=0) - here.mean(axis=0)
    np.testing.assert_allclose(shift, [rolled_m, 0.0, 0.0], atol=1e-4)


def test_every_point_comes_out_once() -> None:
    """Rolling over a flat plate: patches are disjoint and cover what was seen."""
    stitcher = Stitcher(StitcherSettings.create({"icp": False, "voxel_m": 2e-4}), CAMERA)
    patches = [stitcher.add(depth_map(flat(), 0.003 * k)) for k in range(12)]
    patches.append(stitcher.finish())
    cells = np.concatenate([np.floor(p.points / 2e-4) for p in patches if len(p)])
    # The origin of the voxels is the first point, so cells may differ by one: compare extent.
    x = np.concatenate([p.points[:, 0] for p in patches if len(p)])
    assert np.ptp(x) == pytest.approx(0.033 + 319 / CAMERA.fx * 0.045, abs=1e-3)
    assert len(cells) < 1.3 * np.ptp(x) * (119 / CAMERA.fx * 0.045) / 2e-4**2
    assert len(patches[0]) == 0
    assert len(patches[6]) > 0


def test_memory_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("roller_emvs.stitcher._MOST_VOXELS", 1000)
    settings = StitcherSettings.create({"icp": False, "voxel_m": 1e-4})
    stitcher = Stitcher(settings, CAMERA)
    patch = stitcher.add(depth_map(flat()))
    assert len(stitcher.voxels) == 1000
    assert len(patch) > 1000


def test_what_two_views_say_of_a_place_counts_together() -> None:
    """One surface, not two, by what each is sure of; whichever way the roller looks."""
    stitcher = Stitcher(StitcherSettings.create({"icp": False, "voxel_m": 1e-3}), CAMERA)
    sure, unsure = depth_map(flat(0.045)), depth_map(flat(0.0453))
    for tilt in (0.0, 0.7):
        turn = pose_matrix(np.zeros(3), rotation_vector_to_quaternion([0.0, tilt, 0.0]))
        stitcher.add(replace(sure, sigma=np.full_like(sure.sigma, 5e-5), pose=turn @ sure.pose))
        alone = len(stitcher.voxels)
        stitcher.add(replace(unsure, sigma=np.full_like(sure.sigma, 1e-4), pose=turn @ sure.pose))
        assert len(stitcher.voxels) < 1.2 * alone
        patch = stitcher.finish()
        depth = patch.points @ (turn @ sure.pose)[:3, 2]
        depth -= (turn @ sure.pose)[:3, 2] @ (turn @ sure.pose)[:3, 3]
        # Beyond the border of the one, the other is alone.
        assert np.median(depth) == pytest.approx(0.04506, abs=5e-6)
        assert np.mean(np.abs(depth - 0.04506) < 2e-5) > 0.8


def test_a_view_that_turned_goes_on_with_what_it_sees() -> None:
    stitcher = Stitcher(StitcherSettings.create({"icp": False, "voxel_m": 2e-4}), CAMERA)
    first = depth_map(flat())
    assert not len(stitcher.add(first))
    seen = len(stitcher.voxels)
    turn = pose_matrix(np.zeros(3), rotation_vector_to_quaternion([0.0, 0.5, 0.0]))
    patch = stitcher.add(replace(first, pose=turn @ first.pose))
    assert len(patch) == seen
    assert len(stitcher.finish()) == pytest.approx(seen, rel=0.02)


def test_height_counts_from_the_nominal_surface() -> None:
    stitcher = Stitcher(StitcherSettings.create({"surface_z_m": 0.040}), CAMERA)
    stitcher.add(depth_map(flat()))
    patch = stitcher.finish()
    np.testing.assert_allclose(patch.height, 0.005, atol=1e-6)
    assert patch.columns().shape == (len(patch), 6)


def hills(n: int, seed: int) -> np.ndarray:
    """Points on relief that fixes all six degrees of freedom."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.01, 0.01, (2, n))
    z = 0.0008 * np.sin(x * 900) * np.cos(y * 700) + 0.0006 * np.cos(x * 400 + y * 1100)
    return np.stack([x, y, z], axis=-1)


def test_icp_takes_the_nearest_points_not_nearly_the_nearest() -> None:
    cloud = hills(3000, 3) - (0.5, 0.2, 0.3)
    cloud[40:80] = cloud[40]  # as often as there are voxels of one place
    asked = cloud[::7] + np.random.default_rng(4).normal(0.0, 2e-4, (len(cloud[::7]), 3))
    near, squares = registration._Target(cloud)._nearest(asked, 3)
    slow = ((asked[:, None] - cloud) ** 2).sum(axis=2)
    np.testing.assert_allclose(np.sqrt(squares), np.sqrt(np.sort(slow)[:, :3]), atol=1e-7)
    given = np.take_along_axis(slow, near, axis=1)
    np.testing.assert_allclose(np.sqrt(given), np.sqrt(squares), atol=1e-7)


def test_icp_corrects_a_small_offset_on_relief() -> None:
    offset = np.array([2e-5, -1.5e-5, 2.5e-5])
    found = refine(hills(20_000, 1) + offset, hills(60_000, 2))
    assert found.accepted, found.reason
    np.testing.assert_allclose(found.correction[:3, 3], -offset, atol=8e-6)


def test_icp_is_refused_on_a_flat_plate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing fixes a slide along the plate; the offset across it must not tempt ICP."""
    tried: list[object] = []
    monkeypatch.setattr(registration, "_icp", lambda *given: tried.append(given))
    rng = np.random.default_rng(0)
    plate = np.column_stack([rng.uniform(-0.01, 0.01, (40_000, 2)), rng.normal(0, 2e-6, 40_000)])
    found = refine(plate[:10_000] + [0, 0, 2e-5], plate[10_000:])
    assert not found.accepted
    assert "does not fix" in found.reason
    assert not tried  # that nothing fixes it is known beforehand
    np.testing.assert_array_equal(found.correction, np.eye(4))


def test_icp_is_refused_when_implausibly_large(monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[np.ndarray] = []
    monkeypatch.setattr(
        registration, "pose_matrix", lambda *a: steps.append(pose_matrix(*a)) or steps[-1]
    )
    found = refine(hills(20_000, 1) + [1.5e-4, 0, 0], hills(60_000, 2))
    assert not found.accepted
    assert "implausible" in found.reason
    assert len(steps) == 1  # what has gone that far is not sought any further


def test_icp_is_refused_when_no_better() -> None:
    found = refine(hills(20_000, 1), hills(60_000, 2))
    assert not found.accepted


def test_icp_needs_overlap() -> None:
    found = refine(hills(5000, 1), hills(5000, 2) + [1.0, 0, 0])
    assert not found.accepted
    assert "overlap" in found.reason


def test_radius_filter_keeps_company() -> None:
    points = np.array([[0.0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0.01, 0.01, 0], [1, 1, 1]])
    np.testing.assert_array_equal(radius_filter(points, 0.05, 3), [True] * 4 + [False])


def test_ply_opens_in_open3d_and_in_ours(tmp_path: Path) -> None:
    import open3d as o3d  # two seconds, for this test alone

    path = tmp_path / "surface.ply"
    rng = np.random.default_rng(0)
    points = rng.normal(size=(100, 3)) + 1000.0
    with PlyWriter(path, ("height", "confidence"), "frame base") as writer:
        for part in np.split(points, [30, 30, 80]):
            writer.write(part, part[:, 0].astype(np.float32), np.ones(len(part), np.float32))
            # What is there so far is a whole file.
            writer._file.flush()
            assert len(read_ply(path)["x"]) == writer.count
    cloud = o3d.t.io.read_point_cloud(str(path))
    np.testing.assert_array_equal(cloud.point.positions.numpy(), points)
    np.testing.assert_array_equal(cloud.point["confidence"].numpy(), 1)
    np.testing.assert_array_equal(read_ply(path)["z"], points[:, 2])


def test_ply_says_when_it_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(UnwritableOutputError, match="can't be written"):
        PlyWriter(tmp_path / "no" / "such" / "a.ply", ())
    with pytest.raises(UnwritableOutputError, match="No space left"):
        PlyWriter("/dev/full", ())


@pytest.mark.parametrize("fails", ["points", "count"])
def test_a_ply_on_a_full_disk_holds_the_patches_before(tmp_path: Path, fails: str) -> None:
    path, points = tmp_path / "surface.ply", np.ones((10, 3))

    class FullDisk(io.FileIO):
        full = True

        def write(self, data: Any) -> int:
            if self.full and (len(data) > 100) == (fails == "points"):
                self.full = False  # what stands in the file may be written again
                super().write(bytes(data)[: len(data) // 2])
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(data)

    with PlyWriter(path, ()) as writer:
        writer.write(points)
        size = path.stat().st_size
        good, writer._file = writer._file, FullDisk(path, "r+")
        with pytest.raises(UnwritableOutputError, match="No space left"):
            writer.write(points)
        assert read_ply(path)["z"].tolist() == [1.0] * 10
        assert path.stat().st_size == size
        writer._file.close()
        writer._file = good
        writer.write(2 * points[:5])
    assert read_ply(path)["z"].tolist() == [1.0] * 10 + [2.0] * 5


def test_a_depth_map_that_lacks_a_part_holds_up_nobody_for_long() -> None:
    stage = StitcherStage(StitcherParameters.create({}))
    stage.take_camera(CAMERA)
    stage.take_poses(track_of(rolling(0.1), 1.0))
    image = flat().astype(np.float32)
    names = (outputs.DEPTH_CONFIDENCE, outputs.DEPTH_SIGMA, outputs.DEPTH_IMAGE)
    for k in range(6):
        for name in names[: 1 if k == 0 else 3]:
            stage.take_output(Output(name, k * 100 * MS, "", image))
        list(stage.results())
    assert (stage.counts()["depth_maps"], stage.left_out) == (5, 1)
    assert stage.counts()["waiting_maps"] == 0


def test_depth_maps_that_wait_are_given_up_by_count_alone() -> None:
    stage = StitcherStage(StitcherParameters.create({}))
    image = flat().astype(np.float32)
    names = (outputs.DEPTH_CONFIDENCE, outputs.DEPTH_SIGMA, outputs.DEPTH_IMAGE)
    for k, name in enumerate(names):  # of the first, some parts come before the camera
        stage.take_output(Output(name, 0, "", image))
        if k == 1:
            stage.take_camera(CAMERA)
    stage.take_poses(track_of(rolling(0.1), 0.2))
    list(stage.results())
    assert (stage.counts()["depth_maps"], stage.left_out) == (1, 0)
    for name in names:
        stage.take_output(Output(name, 900 * MS, "", image))  # its pose hasn't come
    list(stage.results())
    stage.clear()
    assert (stage.counts()["depth_maps"], stage.left_out) == (1, 1)


@pytest.mark.parametrize("camera", [None, CAMERA])
def test_depth_maps_without_poses_are_bounded_and_said(
    camera: Camera | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("roller_emvs.stitcher_stage._MOST_PENDING", 5)
    stage = StitcherStage(StitcherParameters.create({}))
    if camera is not None:
        stage.take_camera(camera)
    for k in range(9):
        stage.take_output(Output(outputs.DEPTH_IMAGE, k * MS, "", flat().astype(np.float32)))
        list(stage.results())
    assert (stage.counts()["waiting_maps"], stage.left_out) == (5, 4)
    level, said = stage.health()
    assert level == WARN
    assert said == stage.frames.missing()


def test_warming_up_takes_all_of_a_correction(monkeypatch: pytest.MonkeyPatch) -> None:
    reasons: list[str] = []

    def watched(*clouds: np.ndarray) -> registration.Refinement:
        reasons.append((found := refine(*clouds)).reason)
        return found

    monkeypatch.setattr("roller_emvs.stitcher.refine", watched)
    StitcherStage(StitcherParameters.create({})).warm_up()
    assert reasons == ["the geometry does not fix the pose"]
