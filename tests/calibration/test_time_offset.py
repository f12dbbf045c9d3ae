"""Delay of event stamps against poses, on scans that go to and fro with a known delay."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.scans import (
    DEPTH_M,
    LEVEL,
    PIXEL_M,
    scan_of,
    swinging,
    there_and_back,
    uneven,
    write_scan,
)
from emvs.scenes import CAMERA, Motion, track_of
from roller_bringup.cli import main
from roller_calibration.bidirectional import TimeOffsetError
from roller_calibration.commands.time_offset import _describe
from roller_calibration.recordings import Scan
from roller_calibration.time_offset import TimeOffset, estimate_time_offset
from roller_core.calibration_file import read_record
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.transforms import rotation_vector_to_quaternion
from roller_inspect.pipeline import PipelineSettings


@pytest.mark.parametrize("delay_s", [0.0013, -0.0007])
def test_two_speeds_separate_delay_from_travel(delay_s: float) -> None:
    scans = [scan_of(there_and_back(v), delay_s) for v in (0.1, 0.25)]
    found = estimate_time_offset(scans, DEPTH_M)
    assert found.delay_s == pytest.approx(delay_s, abs=4e-5)
    assert found.deviation_s < 1e-4
    # An event comes as the point enters the pixel, half a pixel before its middle.
    assert found.late_m == pytest.approx(-PIXEL_M / 2, abs=1e-5)
    assert found.speeds_m_s == pytest.approx((0.1, 0.25), rel=0.03)


def test_close_edges_count_alone_where_there_are_any() -> None:
    """What pixels are blind for moves wide structures by a travel that goes with the speed."""
    # Texture from 0 to 3 mm of each 6 mm, edges far apart in the rest.
    fine = np.cumsum(np.random.default_rng(5).uniform(0.0001, 0.00025, 400)) - 0.02
    close, wide = fine[fine % 0.006 < 0.003], uneven()
    wide = wide[(wide % 0.006 > 0.0034) & (wide % 0.006 < 0.0056)]
    scans, wide_alone = [], []
    for speed in (0.1, 0.25):
        course = there_and_back(speed)
        off, true = scan_of(course, 0.0011, wide), scan_of(course, 0.001, close)
        together = EventArray.concatenate([off.events, true.events])
        order = np.argsort(together.t_ns, kind="stable")
        scans.append(replace(true, events=together[order]))
        wide_alone.append(off)
    found = estimate_time_offset(scans, DEPTH_M)
    assert found.delay_s == pytest.approx(0.001, abs=1e-5)
    # Without any, all are better than nothing.
    found = estimate_time_offset(wide_alone, DEPTH_M)
    assert found.delay_s == pytest.approx(0.0011, abs=4e-5)


def test_how_soon_a_pixel_answers_again_bounds_what_is_taken_for_delay() -> None:
    once = [scan_of(there_and_back(v), 0.0013) for v in (0.1, 0.25)]
    again = [replace(scan, events=_with_echoes(scan.events, 100_000)) for scan in once]
    plain, echoing = (estimate_time_offset(scans, DEPTH_M) for scans in (once, again))
    # Turning round shows a pixel the same line twice.
    assert 150e-6 < plain.blind_s < 300e-6
    assert plain.deviation_s > plain.blind_s / 4
    assert echoing.blind_s == pytest.approx(100e-6, abs=1e-6)
    assert 25e-6 < echoing.deviation_s < plain.deviation_s


def _with_echoes(events: EventArray, after_ns: int) -> EventArray:
    """A tenth of the events once more at the same pixel."""
    echo = events[::10]
    late = EventArray.from_arrays(echo.x, echo.y, echo.t_ns + after_ns, echo.p)
    both = EventArray.concatenate([events, late])
    return both[np.argsort(both.t_ns, kind="stable")]


def test_one_speed_holds_both() -> None:
    found = estimate_time_offset([scan_of(there_and_back(0.2), 0.001)], DEPTH_M)
    assert found.late_m is None
    assert found.delay_s == pytest.approx(0.001 - PIXEL_M / 2 / 0.2, abs=4e-5)
    # Which of both isn't known, and the deviation says so: edges lag by 0.1 mm.
    assert found.deviation_s == pytest.approx(1e-4 / 0.2, rel=0.1)


def test_a_swing_has_speeds_enough() -> None:
    found = estimate_time_offset([scan_of(swinging(0.4), 0.0011)], DEPTH_M)
    assert found.late_m is not None
    assert found.deviation_s < 1.5e-4
    assert found.delay_s == pytest.approx(0.0011, abs=3 * found.deviation_s)


def test_depth_hardly_matters_and_a_far_base_not_at_all() -> None:
    course = there_and_back(0.2)
    near = scan_of(course, 0.001)

    def far_away(t: float) -> tuple[np.ndarray, np.ndarray]:
        return course.motion(t)[0] + [3000.0, -2000.0, 500.0], LEVEL

    far = replace(near, track=track_of(far_away, course.duration_s))
    expected = estimate_time_offset([near], DEPTH_M).delay_s
    assert estimate_time_offset([far], DEPTH_M).delay_s == pytest.approx(expected, abs=1e-6)
    other = estimate_time_offset([near], DEPTH_M + 5e-4).delay_s
    assert other == pytest.approx(expected, abs=5e-5)


def test_a_camera_a_quarter_turn_round() -> None:
    course = there_and_back(0.2)
    level = scan_of(course, 0.001)
    quarter: Motion = lambda t: (  # noqa: E731
        course.motion(t)[0],
        rotation_vector_to_quaternion([0.0, 0.0, -np.pi / 2]),
    )
    e, f = level.events, CAMERA.fx
    upright = Camera(CAMERA.height, CAMERA.width, f, f, CAMERA.cy, CAMERA.cx)
    turned = EventArray.from_arrays(CAMERA.height - 1 - e.y, e.x, e.t_ns, e.p)
    scan = Scan("scan", turned, upright, track_of(quarter, course.duration_s))
    expected = estimate_time_offset([level], DEPTH_M).delay_s
    assert estimate_time_offset([scan], DEPTH_M).delay_s == pytest.approx(expected, abs=5e-6)


def one_way() -> Scan:
    scan = scan_of(there_and_back(0.2), 0.0)
    half = int(np.searchsorted(scan.events.t_ns, 95_000_000))
    return Scan("scan", scan.events[:half], CAMERA, track_of(there_and_back(0.2).motion, 0.08))


def nothing_seen() -> Scan:
    scan = scan_of(there_and_back(0.2), 0.0)
    return Scan("scan", scan.events[:100], CAMERA, scan.track)


def standing() -> Scan:
    scan = scan_of(there_and_back(0.2), 0.0)
    return Scan("scan", scan.events, CAMERA, track_of(lambda _: (np.zeros(3), LEVEL), 0.2))


def even_lines() -> Scan:
    return scan_of(there_and_back(0.2), 0.0, np.arange(-0.02, 0.05, 0.0013))


def noise() -> Scan:
    rng = np.random.default_rng(0)
    n = 60_000
    x, y = rng.integers(0, 320, n), rng.integers(0, 120, n)
    times = np.sort(rng.integers(0, 200_000_000, n))
    events = EventArray.from_arrays(x, y, times, rng.integers(0, 2, n))
    return Scan("scan", events, CAMERA, track_of(there_and_back(0.2).motion, 0.2))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (one_way, "one way only"),
        (nothing_seen, "fewer than"),
        (standing, "moves by less"),
        (even_lines, "the relief repeats"),
        (noise, "agree nowhere"),
    ],
)
def test_what_shows_nothing_is_refused(make: Callable[[], Scan], says: str) -> None:
    with pytest.raises(TimeOffsetError, match=says):
        estimate_time_offset([make()], DEPTH_M)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Recordings by their speed, 1.2 ms late, and their camera."""
    folder = tmp_path_factory.mktemp("time_offset")
    CAMERA.to_yaml(folder / "camera.yaml")
    found = {"camera": str(folder / "camera.yaml"), "missing": str(folder / "missing")}
    for speed in ("0.1", "0.2", "0.25"):
        scan = scan_of(there_and_back(float(speed)), 0.0012)
        found[speed] = str(write_scan(folder / speed, scan))
    return found


def test_two_scans_give_the_nodes_their_delay(
    recorded: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "cell" / "delay.yaml"
    words = ["calibrate", "--time-offset", recorded["0.1"], recorded["0.25"], "-o", str(file)]
    assert main([*words, "--camera", recorded["camera"]]) == 0
    assert "lag the poses by 1." in capsys.readouterr().out
    settings = PipelineSettings.load(file)
    for part in (settings.depth, settings.surface, settings.braille):
        assert part.event_delay_s == pytest.approx(0.0012, abs=5e-5)


def test_subcommand_is_the_option_and_carries_parameters_over(
    recorded: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    params = tmp_path / "params.yaml"
    params.write_text("emvs: {ros__parameters: {paper.threshold_c: 9.0, event_delay_s: 0.05}}")
    files = [tmp_path / "one.yaml", tmp_path / "two.yaml"]
    for word, file in zip(("--time-offset", "time-offset"), files, strict=True):
        given = ["--camera", recorded["camera"], "--params", str(params), "-o", str(file)]
        assert main(["calibrate", word, recorded["0.2"], *given]) == 0
        assert "give another recording" in capsys.readouterr().out
    one, two = (PipelineSettings.load(file).depth for file in files)
    assert one == two
    assert one.paper.threshold_c == 9.0
    assert one.event_delay_s == pytest.approx(0.0012, abs=4e-4)
    record = read_record(files[0], "time_offset")
    assert record is not None
    assert record["data"] == ["0.2"]


@pytest.mark.parametrize(("fast_m_s", "advised"), [(0.25, False), (0.5, True)])
def test_a_scan_too_fast_for_its_pixels_is_named(fast_m_s: float, advised: bool) -> None:
    found = TimeOffset(0.001, 1e-4, 4e-4, 5e-5, (0.1, fast_m_s), 10_000)
    lines = _describe(found)
    assert "blind for up to 0.40 ms" in lines[2]
    assert any("moves by 0.20 mm" in line and "at 0.3 m/s" in line for line in lines) == advised


def test_what_to_calibrate_must_be_said(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as fault:
        main(["calibrate", "scan"])
    assert fault.value.code == 2
    assert "sphere" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["missing"], "there is no such file"),
        (["0.2", "0.2", "--poses", "p.txt"], "goes with one recording"),
        (["0.2", "-o", "/proc/none/delay.yaml"], "can't be written"),
    ],
)
def test_faults_are_one_line(
    recorded: dict[str, str], capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    given = [recorded.get(word, word) for word in words]
    command = ["calibrate", "--time-offset", *given, "--camera", recorded["camera"]]
    assert main(command) == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("error: ")
    assert says in line
