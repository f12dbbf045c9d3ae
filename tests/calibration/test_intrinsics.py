"""Intrinsics and hand-eye from a blinking grid of dots."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration import blinking_grid
from calibration.blinking_grid import GRID, dots_image, target_poses, write_grid_bag
from roller_bringup.cli import main
from roller_calibration.dot_grid import GridView, edge_width_px, find_grid, moved_px
from roller_calibration.intrinsics import (
    IntrinsicsError,
    check_one_lens,
    find_intrinsics,
    grid_in_camera,
)
from roller_core.camera import Camera
from roller_core.parameter_files import read_parameters
from roller_core.transforms import pose_matrix, rotation_vector_to_quaternion

CAMERA = Camera(640, 480, 1066.0, 1069.0, 322.5, 236.0, (-0.08, 0.11, 0.001, -0.0005))
HAND_EYE = pose_matrix([0.02, -0.013, 0.11], rotation_vector_to_quaternion([0.1, -0.2, 1.3]))


def exact_views(
    poses: list[np.ndarray],
    noise_px: float = 0.05,
    camera: Camera = CAMERA,
    stretch: tuple[float, float] = (1.0, 1.0),
) -> list[GridView]:
    rng = np.random.default_rng(2)
    points = GRID.points_m.astype(float) * (*stretch, 1.0)
    seen = [camera.project(points @ p[:3, :3].T + p[:3, 3]) for p in poses]
    return [
        GridView(k, k + 1, (p + rng.normal(0, noise_px, p.shape)).astype(np.float32), 1.0)
        for k, p in enumerate(seen)
    ]


def test_the_grid_is_found_where_it_is_with_hot_pixels_about() -> None:
    pose = target_poses(1, 30.0)[0]
    counts = np.random.default_rng(1).binomial(16, dots_image(CAMERA, pose))
    counts[50, 60] = 100_000
    dots = find_grid(counts, GRID)
    assert dots is not None
    true = CAMERA.project(GRID.points_m.astype(float) @ pose[:3, :3].T + pose[:3, 3])
    # A disc's middle isn't quite the middle of its image where the target is tilted.
    assert np.abs(dots - true).max() < 0.35
    assert find_grid(np.zeros((480, 640), int), GRID) is None
    assert find_grid(np.random.default_rng(2).poisson(2.0, (480, 640)), GRID) is None


def test_the_dot_next_to_a_place_is_the_nearest_one() -> None:
    places = np.random.default_rng(3).uniform(-1, 7, (4000, 2))
    dots = GRID.points_m[:, :2] / GRID.pitch_m
    nearest = np.linalg.norm(places[:, None] - dots[None], axis=2).min(axis=1)
    found = GRID.to_dots(places)
    # Half of the way between two dots next to each other.
    near = nearest < 0.5 * np.sqrt(0.5)
    assert 0.1 < near.mean() < 0.5
    np.testing.assert_allclose(found[near], nearest[near], atol=1e-6)
    assert (found[~near] >= nearest[~near] - 1e-6).all()


def test_edges_are_as_wide_as_the_lens_makes_them() -> None:
    pose = target_poses(1, 20.0)[0]
    widths = []
    for blur in (1.0, 2.0, 3.0):
        counts = np.random.default_rng(1).binomial(200, dots_image(CAMERA, pose, blur))
        dots = find_grid(counts, GRID)
        assert dots is not None
        widths.append(edge_width_px(counts, dots, GRID))
    # From 20 to 80 % of a Gaussian edge it is 1.68 of its deviation; sharper means narrower.
    assert widths == pytest.approx([1.68, 3.37, 5.05], rel=0.25)


def test_intrinsics_are_found_within_their_deviations() -> None:
    found = find_intrinsics(exact_views(target_poses(15, 35.0)), GRID, (640, 480))
    c = found.camera
    off = np.array([c.fx, c.fy, c.cx, c.cy]) - [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]
    assert (np.abs(off) < 4 * found.deviation).all()
    assert found.deviation.max() < 3.0
    pose = target_poses(1, 20.0, seed=9)[0]
    view = exact_views([pose], 0.0)[0]
    np.testing.assert_allclose(grid_in_camera(view, GRID, CAMERA), pose, atol=1e-5)


@pytest.mark.parametrize(
    ("views", "says"),
    [
        (exact_views(target_poses(4, 35.0)), "4 different views"),
        (exact_views(target_poses(1, 35.0)) * 30, "1 different views"),
        (exact_views(target_poses(12, 0.3)), "focal length stays open"),
        (exact_views(target_poses(12, 35.0), 3.0), "don't fit one camera"),
    ],
)
def test_views_that_say_too_little_are_refused(views: list[GridView], says: str) -> None:
    with pytest.raises(IntrinsicsError, match=says):
        find_intrinsics(views, GRID, (640, 480))


def test_views_of_two_lenses_are_told_from_those_of_one() -> None:
    """Together they fit one camera in between to 0.2 px."""
    turned = replace(CAMERA, fx=1.06 * CAMERA.fx, fy=1.06 * CAMERA.fy)
    before = exact_views(target_poses(10, 35.0))
    after, same = (
        exact_views(target_poses(10, 35.0, seed=4), camera=camera) for camera in (turned, CAMERA)
    )
    assert find_intrinsics([*before, *after], GRID, (640, 480)).rms_px < 0.3
    with pytest.raises(IntrinsicsError, match=r"px in a, of .* px in b; was the lens turned"):
        check_one_lens({"a": before, "few": after[:4], "b": after}, GRID, (640, 480))
    check_one_lens({"a": before, "b": same, "few": after[:4]}, GRID, (640, 480))


def test_a_page_printed_longer_one_way_is_told() -> None:
    poses = target_poses(15, 35.0)
    good = find_intrinsics(exact_views(poses, 0.15), GRID, (640, 480))
    assert good.longer == 0.0
    long = find_intrinsics(exact_views(poses, 0.15, stretch=(1.0, 1.03)), GRID, (640, 480))
    assert 0.01 < abs(long.longer) < 0.05


def test_what_dots_have_in_common_is_movement_and_the_rest_is_chance() -> None:
    rng = np.random.default_rng(5)
    before, beside = (exact_views([pose], 0.0)[0].pixels for pose in target_poses(2, 20.0))
    chance = rng.normal(0.0, 0.3, before.shape).astype(np.float32)
    assert np.abs(chance).max() > 0.5
    assert moved_px(before, before + chance) < 0.3
    assert moved_px(before, before + np.float32([0.6, 0.0]) + chance) > 0.4
    middle = before.mean(axis=0)
    assert moved_px(before, middle + np.float32(1.01) * (before - middle)) > 0.4
    assert moved_px(before, beside) > 3.0


@pytest.mark.scan
def test_a_soft_lens_is_told_by_its_edges(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also before there are views enough: the lens is turned by what is said."""
    sharp = blinking_grid.dots_image
    monkeypatch.setattr(blinking_grid, "dots_image", lambda c, p: sharp(c, p, 3.0))
    bag = write_grid_bag(tmp_path / "views", CAMERA, target_poses(2, 20.0))
    assert main(["calibrate", "intrinsics", str(bag), "--pitch-mm", "4"]) == 1
    told = capsys.readouterr()
    (edge,) = re.findall(r"2 views; edges ([0-9.]+) px wide", told.out)
    assert float(edge) == pytest.approx(5.0, rel=0.25)
    assert "2 different views of the grid" in told.err


@pytest.mark.scan
def test_recordings_of_two_lenses_give_no_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    turned = replace(CAMERA, fx=1.1 * CAMERA.fx, fy=1.1 * CAMERA.fy)
    bags = [
        str(write_grid_bag(tmp_path / name, camera, target_poses(8, 35.0, seed)))
        for name, camera, seed in (("one", CAMERA, 3), ("two", turned, 4))
    ]
    file = tmp_path / "camera.yaml"
    words = ["calibrate", "intrinsics", *bags, "--pitch-mm", "4", "--output", str(file)]
    assert main(words) == 1
    assert f"px in {bags[0]}, of " in capsys.readouterr().err
    assert not file.exists()


@pytest.mark.scan
def test_recordings_give_a_camera_and_its_place_on_the_tool(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = target_poses(12, 35.0)
    bag = write_grid_bag(tmp_path / "views", CAMERA, poses, HAND_EYE)
    file = tmp_path / "camera.yaml"
    words = ["calibrate", "intrinsics", str(bag), "--pitch-mm", "4", "--output", str(file)]
    assert main(words) == 0
    assert "12 views" in capsys.readouterr().out
    camera = Camera.from_yaml(file)
    assert camera.fx == pytest.approx(CAMERA.fx, rel=3e-3)
    assert (camera.cx, camera.cy) == pytest.approx((CAMERA.cx, CAMERA.cy), abs=8.0)

    out, pairs = tmp_path / "hand_eye.yaml", tmp_path / "pairs.txt"
    words = ["calibrate", "hand-eye", "--grid-recording", str(bag), "--pitch-mm", "4"]
    assert main([*words, "--pairs", str(pairs), "--output", str(out)]) == 0
    place = read_parameters(out, "ur10")["hand_eye_m"]
    np.testing.assert_allclose(place, HAND_EYE[:3, 3], atol=5e-4)
    assert main(["calibrate", "hand-eye", str(pairs)]) == 0

    (data,) = bag.glob("*.mcap")
    data.write_bytes(data.read_bytes()[: int(0.95 * data.stat().st_size)])
    capsys.readouterr()
    assert main(words) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith(f"{bag}: ")
    assert "cut off at byte" in first

    assert main(["calibrate", "intrinsics", str(bag), "--pitch-mm", "0"]) == 1
    assert "--pitch-mm 0" in capsys.readouterr().err


def test_a_recording_without_its_image_size_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "events.txt").write_text("0.1 3 4 1\n")
    assert main(["calibrate", "intrinsics", str(tmp_path), "--pitch-mm", "4"]) == 1
    assert "doesn't say how large the image is" in capsys.readouterr().err


def test_a_page_with_the_target_is_written(tmp_path: Path) -> None:
    page = tmp_path / "target.html"
    assert main(["calibrate", "intrinsics", "--target", str(page)]) == 0
    assert page.read_text().count("<circle") == 44
