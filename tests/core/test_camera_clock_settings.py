"""Camera model, sensor clock and settings."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import Field

from roller_core.camera import Camera, CameraError
from roller_core.clock import SensorClock
from roller_core.errors import SettingsError
from roller_core.parameter_files import parameter_file, read_parameters
from roller_core.settings import Settings

DISTORTED = Camera(640, 480, 1066.0, 1060.0, 319.5, 239.5, (-0.14, 0.09, -3e-4, 2e-4, 0.01))


def test_undistortion_inverts_projection_up_to_the_corner() -> None:
    table = DISTORTED.undistortion_table()
    corners = np.array([[0, 0], [639, 0], [0, 479], [639, 479], [320, 240]])
    ideal = table[corners[:, 1], corners[:, 0]]
    back = DISTORTED.project(DISTORTED.rays(ideal) * 0.045)
    np.testing.assert_allclose(back, corners, atol=1e-3)
    np.testing.assert_allclose(DISTORTED.distort(DISTORTED.undistort(corners)), corners, atol=1e-8)


@pytest.mark.parametrize(
    ("model", "d"),
    [("rational_polynomial", (-0.1, 0.05, 0, 0, 0, 0.1, 0, 0)), ("equidistant", (0.01, -0.002))],
)
def test_other_models_invert(model: str, d: tuple[float, ...]) -> None:
    camera = Camera(640, 480, 1066, 1066, 319.5, 239.5, d, model)
    pixels = np.array([[0.0, 0.0], [639.0, 479.0], [100.0, 400.0]])
    np.testing.assert_allclose(camera.distort(camera.undistort(pixels)), pixels, atol=1e-6)


def test_table_without_distortion_is_the_grid() -> None:
    table = Camera(8, 6, 10, 10, 3.5, 2.5).undistortion_table()
    assert table.shape == (6, 8, 2)
    assert tuple(table[4, 7]) == (7.0, 4.0)


def test_camera_yaml_round_trip(tmp_path: Path) -> None:
    DISTORTED.to_yaml(tmp_path / "camera.yaml")
    assert Camera.from_yaml(tmp_path / "camera.yaml") == DISTORTED


@pytest.mark.parametrize(
    "text",
    [
        "a: [",
        "just text",
        "image_width: 640\n",
        "image_width: 640\nimage_height: 480\ncamera_matrix: {data: [1, 2]}\n",
    ],
)
def test_camera_yaml_faults(tmp_path: Path, text: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(CameraError, match="camera"):
        Camera.from_yaml(path)
    with pytest.raises(CameraError, match="can't be read"):
        Camera.from_yaml(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("entry", "name"),
    [
        ("image_width: wide", "image_width"),
        ("image_height: .inf", "image_height"),
        ("camera_matrix: {data: [1, 0, x, 0, 1, 0, 0, 0, 1]}", "camera_matrix"),
        ("camera_matrix: [1, 0, 0, 0, 1, 0, 0, 0, 1]", "camera_matrix"),
        ("distortion_coefficients: {data: [k1]}", "distortion_coefficients"),
        ("distortion_coefficients: 0.1", "distortion_coefficients"),
        ("distortion_coefficients: {rows: 1, cols: 4, dat: [1]}", "distortion_coefficients"),
        ("distortion_coefficients: {rows: 1, cols: 4}", "distortion_coefficients"),
    ],
)
def test_the_entry_of_a_camera_yaml_that_is_wrong_is_named(
    tmp_path: Path, entry: str, name: str
) -> None:
    right = ["image_width: 9", "image_height: 9", "camera_matrix: {data: [1,0,0,0,1,0,0,0,1]}"]
    path = tmp_path / "camera.yaml"
    path.write_text("\n".join(line for line in right if not line.startswith(name)) + f"\n{entry}\n")
    with pytest.raises(CameraError, match=rf"^camera {path}: entry '{name}' is missing or wrong; "):
        Camera.from_yaml(path)


def written(path: Path, *more: str) -> Path:
    """A camera_info YAML file with entries beside those that it must have."""
    matrix = "camera_matrix: {data: [9, 0, 4, 0, 9, 4, 0, 0, 1]}"
    path.write_text("\n".join(["image_width: 9", "image_height: 9", matrix, *more]) + "\n")
    return path


@pytest.mark.parametrize(
    "entry", ["", "distortion_coefficients: {data: []}", "distortion_coefficients:",
              "distortion_coefficients: {rows: 0, cols: 0}"],
)  # fmt: skip
def test_a_lens_without_distortion(tmp_path: Path, entry: str) -> None:
    camera = Camera.from_yaml(written(tmp_path / "camera.yaml", entry, "camera_name: ours"))
    assert not camera.is_distorted


def test_a_matrix_of_another_size_than_it_says(tmp_path: Path) -> None:
    entry = "distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0]}"
    path = written(tmp_path / "camera.yaml", entry)
    with pytest.raises(
        CameraError, match=rf"^camera {path}: entry '.*': a matrix of 1 × 5 has 4 n"
    ):
        Camera.from_yaml(path)


def test_a_misspelt_distortion_is_no_lens_without_one(tmp_path: Path) -> None:
    path = written(tmp_path / "camera.yaml", "distortion_coeficients: {data: [0.1, 0, 0, 0, 0]}")
    with pytest.raises(CameraError, match="'distortion_coeficients'; is it 'distortion_coeffic"):
        Camera.from_yaml(path)


@pytest.mark.parametrize(("index", "value"), [(1, 0.5), (3, -0.1), (6, 1.0), (7, 1e-4), (8, 7.0)])
def test_a_matrix_that_is_more_than_focal_lengths_and_centre(index: int, value: float) -> None:
    k = [9.0, 0.0, 4.0, 0.0, 9.0, 4.0, 0.0, 0.0, 1.0]
    assert Camera.from_matrix(9, 9, k).fx == 9.0
    assert Camera.from_matrix(9, 9, [9.0, 1e-14, *k[2:]]).fx == 9.0
    k[index] = value
    with pytest.raises(CameraError, match="is it K"):
        Camera.from_matrix(9, 9, k)


def test_uncalibrated_camera_is_refused() -> None:
    with pytest.raises(CameraError, match="calibrated"):
        Camera.from_matrix(640, 480, [0] * 9)


def test_clock_recovers_offset_and_skew() -> None:
    """50 ppm of drift and 0–1 ms of late arrival: within 100 µs, as a cell needs."""
    rng = np.random.default_rng(1)
    clock = SensorClock()
    offset_ns = 1_790_000_000_000_000_000
    errors = []
    for k in range(20_000):
        device = 5_000_000_000 + k * 2_000_000
        true = offset_ns + device + round((device - 5_000_000_000) * 50e-6)
        clock.observe(device, true + round(rng.exponential(300_000)))
        if k > 5000:
            errors.append(int(clock.to_ros_ns(device)) - true)
    assert np.abs(errors).max() < 100_000
    assert abs(clock.skew - 50e-6) < 5e-6


def test_clock_is_monotonic_between_packets() -> None:
    rng = np.random.default_rng(2)
    clock = SensorClock()
    last = 0
    for k in range(5000):
        device = k * 1_000_000
        clock.observe(device, 10**18 + device + round(rng.exponential(200_000)))
        now = int(clock.to_ros_ns(device))
        assert now > last
        last = now


def test_clock_starts_anew_after_a_step() -> None:
    clock = SensorClock()
    for k in range(100):
        clock.observe(k * 10_000_000, 10**18 + k * 10_000_000)
    clock.observe(0, 10**18 + 2_000_000_000)
    assert clock.steps == 1
    assert int(clock.to_ros_ns(0)) == 10**18 + 2_000_000_000


def test_exact_clock_is_the_identity() -> None:
    clock = SensorClock()
    for k in range(100):
        clock.observe(10**18 + k, 10**18 + k)
    assert int(clock.to_ros_ns(10**18 + 7)) == 10**18 + 7


def test_many_times_are_mapped_as_one_by_one() -> None:
    """Sensors give one time to many events: stretches of it are worked out once."""
    rng = np.random.default_rng(4)
    clock = SensorClock()
    for k in range(3000):
        clock.observe(k * 1_000_000, 10**18 + k * 1_000_050 + round(rng.exponential(200_000)))
    assert clock.skew != 0
    stretches = rng.choice([1, 2, 64, 65, 300], 100)
    times = np.repeat(2_900_000_000 + np.cumsum(rng.integers(1000, 200_000, 100)), stretches)
    want = [int(clock.to_ros_ns(int(t))) for t in times]
    np.testing.assert_array_equal(clock.to_ros_ns(times), want)


class _Group(Settings):
    sigma_px: float = Field(5.0, ge=1.0, description="Neighbourhood, px.")
    votes: int = Field(2, description="Votes.")


class _Demo(Settings):
    planes: int = Field(5, ge=2, le=9, description="Planes.")
    focus: _Group = _Group(votes=4)


def _demo(path: Path, node: str) -> _Demo:
    return _Demo.create(read_parameters(path, node))


def test_settings_from_yaml(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text("/**:\n  ros__parameters: {planes: 3}\nemvs:\n  ros__parameters: {planes: 4}\n")
    assert _demo(path, "emvs").planes == 4
    assert _demo(path, "other").planes == 3


@pytest.mark.parametrize("key", ["emvs", "/emvs", "/**/emvs", "/*/emvs", "left/emvs", "/left/emvs"])
def test_parameters_of_a_node_in_any_namespace(tmp_path: Path, key: str) -> None:
    path = tmp_path / "p.yaml"
    inner = "ros__parameters: {planes: 4}"
    every = "/**:\n  ros__parameters: {planes: 3, use_sim_time: true}\n"
    # As in ROS 2, what is said last counts, and some parameters are rclpy's own.
    for text, planes in ((f"{every}{key}:\n  {inner}\n", 4), (f"{key}:\n  {inner}\n{every}", 3)):
        path.write_text(text)
        assert read_parameters(path, "emvs") == {"planes": planes}
        assert read_parameters(path, "vs") == {"planes": 3}
    path.write_text(f"left: {{{key}: {{{inner}}}}}\n")
    assert read_parameters(path, "emvs") == {"planes": 4}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("emvs:\n  ros__parameters: {planes: 99}\n", "'planes' = 99"),
        ("emvs:\n  ros__parameters: {plane: 3}\n", "unknown entry 'plane'; is it 'planes'"),
        ("emvs: {ros__parameters: {focus_sigma_px: 3}}\n", "is it 'focus.sigma_px'"),
        ("emvs: {ros__parameters: {focus: {sigma_px: 0}}}\n", "'focus.sigma_px' = 0"),
        ("emvs: {planes: 3}\n", "ros__parameters"),
        ("- 3\n", "expected"),
        ("a: &a {b: *a}\n", "aliases"),
        ("a: [\n\n}", "line 3: not a YAML file"),
    ],
)
def test_settings_faults(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=message):
        _demo(path, "emvs")


def test_a_group_given_in_part_keeps_the_rest_of_its_default(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(
        "/**: {ros__parameters: {focus: {sigma_px: 3}}}\n"
        "emvs: {ros__parameters: {focus.sigma_px: 2}}\n"
        "other: {ros__parameters: {focus: {votes: 7}}}\n"
    )
    assert _demo(path, "emvs").focus == _Group(sigma_px=2.0, votes=4)
    assert _demo(path, "other").focus == _Group(sigma_px=3.0, votes=7)
    assert "      votes: 4\n" in parameter_file({"emvs": _Demo})
