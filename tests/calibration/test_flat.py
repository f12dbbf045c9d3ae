"""Depth range from a flat plate, by the part of a pass at one speed."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.scans import ROLLING, sphere_pass, write_scan
from emvs.scenes import track_of
from roller_bringup.cli import main
from roller_calibration.constant_speed import SpeedError, constant_speed_part
from roller_calibration.flat import FlatError, find_plate
from roller_calibration.recordings import Scan
from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.events import EventArray
from roller_core.parameter_files import read_parameters
from roller_core.pose_track import PoseTrack
from roller_core.transforms import pose_matrix, rotation_vector_to_quaternion
from roller_inspect.pipeline import PipelineSettings

CAMERA = Camera(640, 480, 1066.0, 1066.0, 319.5, 239.5)


def plate(tilt: float = 0.0, bump_m: float = 0.0, count: int = 4000) -> np.ndarray:
    """Points of a plate in the camera's frame, 45 mm away."""
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-0.012, 0.012, count), rng.uniform(-0.009, 0.009, count)
    z = 0.045 + tilt * x - bump_m * np.exp(-(x**2 + y**2) / (2 * 0.004**2))
    return np.column_stack([x, y, z + rng.normal(0, 3e-5, count)])


def test_depth_range_holds_plate_relief_and_margin() -> None:
    pose = pose_matrix([0.3, -0.2, 0.7], rotation_vector_to_quaternion([3.0, 0.2, 0.1]))
    points = plate(0.02) @ pose[:3, :3].T + pose[:3, 3]
    stray = np.random.default_rng(3).normal(points.mean(axis=0), 0.003, (150, 3))
    found = find_plate(np.concatenate([points, stray]), pose, CAMERA)
    assert found.depth_m == pytest.approx(0.045, abs=1e-5)
    assert found.tilt_deg == pytest.approx((np.degrees(0.02), 0.0), abs=0.03)
    # At the image's border rays meet z = 0.045 + 0.02·x.
    edge = np.array([CAMERA.cx, -CAMERA.cx]) / CAMERA.fx
    assert (found.nearest_m, found.farthest_m) == pytest.approx(
        tuple(np.sort(0.045 / (1 - 0.02 * edge))), abs=2e-5
    )
    low, high = found.depth_range_m(1.5e-3, 0.5e-3)
    assert (found.nearest_m - low, high - found.farthest_m) == pytest.approx((2e-3, 2e-3))


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (plate(bump_m=1e-3), "not flat"),
        (plate(0.15), "leans by 8.5"),
        (plate(count=100), "too few events"),
        (plate() * [0.05, 1, 1], "too little of the plate"),
    ],
    ids=["bump", "tilt", "few", "narrow"],
)
def test_what_is_no_flat_plate_is_refused(points: np.ndarray, says: str) -> None:
    with pytest.raises(FlatError, match=says):
        find_plate(points, np.eye(4), CAMERA)


def stop_and_go(t: float) -> float:
    """Travel at a time: 30 ms of standstill, 20 ms of ramp, 60 ms at 0.3 m/s, then slower."""
    ramp, even, after = np.clip(t - 0.03, 0, 0.02), np.clip(t - 0.05, 0, 0.06), max(t - 0.11, 0)
    return float(7.5 * ramp**2 + 0.3 * even + 0.2 * after)


def test_only_the_part_at_one_speed_counts() -> None:
    times = np.arange(0, 140 * 10**6, 100_000)
    x = np.zeros(len(times), np.uint16)
    events = EventArray(x, x, times.astype(np.int64), np.zeros(len(times), np.uint8))
    track = track_of(lambda t: (np.array([0.2, stop_and_go(t), 0]), [1, 0, 0, 0]), 0.14)
    rolled = Scan("pass", events, ROLLING, track)
    kept = constant_speed_part(rolled, 0.01).events.t_ns * 1e-9
    assert 0.05 <= kept.min() <= 0.063
    assert 0.097 <= kept.max() <= 0.11
    with pytest.raises(SpeedError, match=r"pass: .* at one speed, less than 20 mm"):
        constant_speed_part(rolled, 0.02)


def test_the_way_back_in_the_air_is_no_part_of_the_pass() -> None:
    """Rolled for 15 mm, lifted, and back over 30 mm, where noise alone comes."""
    rolled_s, end_s = 0.15, 0.35

    def way(t: float) -> tuple[np.ndarray, list[float]]:
        if t < rolled_s:
            return np.array([0.0, 0.1 * t, 0.0]), [1, 0, 0, 0]
        return np.array([0.0, 0.015 - 0.15 * (t - rolled_s), -0.02]), [1, 0, 0, 0]

    times = np.concatenate([np.arange(0, rolled_s, 1e-5), np.arange(rolled_s, end_s, 1e-3)])
    x = np.zeros(len(times), np.uint16)
    events = EventArray(x, x, (times * 1e9).astype(np.int64), np.zeros(len(times), np.uint8))
    kept = constant_speed_part(Scan("pass", events, ROLLING, track_of(way, end_s)), 0.01).events
    assert kept.t_ns[-1] < 1e9 * rolled_s + 1e7  # as speeds are taken over 20 ms
    assert len(kept) > 10_000


@pytest.mark.parametrize("poses", [0, 1, 2, 20])
def test_no_motion_is_no_constant_speed_part(poses: int) -> None:
    still = PoseTrack()
    for k in range(poses):
        still.append(k * 8_000_000, [0, 0, 0], [1, 0, 0, 0])
    with pytest.raises(RollerError):
        constant_speed_part(replace(sphere_pass(), track=still), 0.01)


def test_plate_gives_the_depth_range(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "range.yaml"
    words = ["calibrate", "flat", str(world / "plate"), "--camera", str(world / "camera.yaml")]
    assert main([*words, "-o", str(file), "--margin-mm", "0.4", "--reach-mm", "1.6"]) == 0
    assert "a margin of 0.4 mm" in capsys.readouterr().out
    settings = PipelineSettings.load(file)
    for node in ("emvs", "surface"):
        assert ROLLING.same_intrinsics(read_parameters(file, node)["calibrated_camera"])
    for part in (settings.depth, settings.surface):
        assert part.depth_min_m == pytest.approx(0.0432, abs=5e-5)
        assert part.depth_max_m == pytest.approx(0.0472, abs=5e-5)
    words[2] = str(world / "pass")
    assert main(words) == 1
    assert "not flat" in capsys.readouterr().err


def test_the_plates_depth_is_that_where_it_was_rolled_over(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Lifted by 10 mm afterwards, with more noise up there than events of the pass."""
    scan = sphere_pass(dots=0, plate_dots=700)
    track = PoseTrack()
    track.assign(scan.track)
    place = scan.track.positions[-1]
    for k in range(1, 60):
        lift = [0.0, 0.0, -0.01 * min(k / 10, 1.0)]
        track.append(scan.track.end_ns + k * 8_000_000, place + lift, [0, 0, 0, 1])
    count = len(scan.events) + 1000
    times = np.linspace(scan.track.end_ns + 100_000_000, track.end_ns - 1, count).astype(np.int64)
    x, y = np.random.default_rng(0).integers(0, 140, (2, count))
    noise = EventArray.from_arrays(x, y, times, np.zeros(count))
    events = EventArray.concatenate([scan.events, noise])
    lifted = write_scan(tmp_path / "lifted", replace(scan, events=events, track=track))
    words = ["calibrate", "flat", str(lifted), "--camera", str(world / "camera.yaml")]
    assert main(words) == 0
    assert "plate at 45.2" in capsys.readouterr().out


def test_a_scan_with_ramps_gives_the_depth_range(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scan, file = tmp_path / "flat", tmp_path / "range.yaml"
    textured = ["--set", "light.speckle=0.08", "--set", "camera.height=160"]
    assert main(["simulate", "flat", "--speed", "0.3", *textured, "-o", str(scan)]) == 0
    assert main(["calibrate", "flat", str(scan), "-o", str(file)]) == 0
    assert "a margin of 0.5 mm" in capsys.readouterr().out
    settings = PipelineSettings.load(file)
    for part in (settings.depth, settings.surface):
        assert part.depth_min_m == pytest.approx(0.043, abs=1e-4)
        assert part.depth_max_m == pytest.approx(0.047, abs=1e-4)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--search-mm", "0.038", "0.052"], "--search-mm 0.038: expected 1 to 500"),
        (["--reach-mm", "0.0015"], "--reach-mm 0.0015: expected 0.01 to 50"),
        (["--margin-mm", "nan"], "--margin-mm nan: expected"),
    ],
)
def test_metres_in_place_of_millimetres_are_refused(
    capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    assert main(["calibrate", "flat", "plate", *words]) == 1
    assert says in capsys.readouterr().err


def test_nothing_is_written_into_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scan").mkdir()
    output = tmp_path / "scan" / "cell.yaml"
    assert main(["calibrate", "flat", str(tmp_path / "scan"), "--output", str(output)]) == 1
    assert "overlaps with the input" in capsys.readouterr().err
    assert not output.exists()


def test_a_folder_is_no_parameter_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It was said to overlap with the input, and named as that."""
    (tmp_path / "cell").mkdir()
    words = ["calibrate", "flat", str(tmp_path / "scan"), "--output", str(tmp_path / "cell")]
    assert main(words) == 1
    said = capsys.readouterr().err
    assert said == f"error: {tmp_path / 'cell'}: is a folder; give the name of a file\n"


def test_a_place_where_nothing_can_be_written_is_said_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Some calibrations take minutes."""
    (tmp_path / "file").touch()
    words = ["calibrate", "flat", str(tmp_path / "no scan"), "--output"]
    assert main([*words, str(tmp_path / "file" / "cell.yaml")]) == 1
    assert "cell.yaml: can't be written (Not a directory)" in capsys.readouterr().err
    asked = os.access  # permissions don't hold whoever is root
    monkeypatch.setattr(os, "access", lambda path, mode: path != tmp_path and asked(path, mode))
    assert main([*words, str(tmp_path / "new" / "cell.yaml")]) == 1
    said = capsys.readouterr().err
    file = tmp_path / "new" / "cell.yaml"
    assert said == (f"error: {file}: can't be written (Permission denied); give another --output\n")
