"""The scans that tests share."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import simulated_scans
from simulated_scans import Scans

SMALL = {
    "camera": {"width": 64, "height": 32},
    "scene": {"step_mm": 0.1},
    "motion": {"start_mm": 5.0, "end_mm": 8.0},
}


def test_a_scan_is_simulated_once_for_its_settings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated = []
    write_bag = simulated_scans.write_bag
    monkeypatch.setattr(
        simulated_scans, "write_bag", lambda *a: (simulated.append(a), write_bag(*a))
    )
    (tmp_path / "older source").mkdir()
    with ThreadPoolExecutor(2) as pool:
        asked = [pool.submit(Scans(tmp_path).bag, "flat", 0.5, **SMALL) for _ in range(2)]
        first, second = (future.result() for future in asked)
    assert first == second
    assert len(simulated) == 1
    assert not (tmp_path / "older source").exists()
    scans = Scans(tmp_path)
    assert scans.bag("flat", 0.5, **SMALL, clock={"image_rate_hz": 0.0}) == first
    assert scans.bag("flat", 0.5, **SMALL, seed=5) != first
    assert len(simulated) == 2


def test_a_scan_is_read_as_a_replay_reads_it(scans: Scans) -> None:
    scan = scans.scan("three_lines", 0.5, **SMALL)
    assert scan is scans.scan("three_lines", 0.5, **SMALL)
    assert len(scan.events) > 100
    assert scan.camera.width == 64
    assert scan.truth.start_ros_ns <= scan.events.t_ns[0] < scan.track.end_ns
    assert scans.events("three_lines", 0.5, **SMALL) is scan.events


def test_long_tests_are_there() -> None:
    for name in simulated_scans.LONG_TESTS:
        assert any(Path(__file__).parent.glob(name.rstrip("/") + "*")), name
