"""Fixtures of all tests."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from own import ros_domain
from simulated_scans import LONG_TESTS, Scans

ROOT = Path(__file__).resolve().parents[1]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that take long, and those that read what others simulated."""
    long = tuple(str(ROOT / "tests" / name) for name in LONG_TESTS)
    for item in items:
        if "scans" in getattr(item, "fixturenames", ()) or str(item.path).startswith(long):
            item.add_marker(pytest.mark.scan)


@pytest.fixture(scope="session")
def scans(request: pytest.FixtureRequest) -> Scans:
    """Simulated scans, shared by all tests: `scans.bag("stairs", speed=0.3)`; see `Scans`."""
    assert request.config.cache is not None
    return Scans(Path(request.config.cache.mkdir("scans")))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real recordings, kept beside the checkout or where ROLLER_SHARED_DATA says."""
    beside = ROOT.parent / "shared" / "data"
    folder = Path(os.environ.get("ROLLER_SHARED_DATA", beside))
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}; set ROLLER_SHARED_DATA to their folder")
    return folder


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS domain of the test's own, on loopback, also for the processes it starts."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("FASTDDS_DEFAULT_PROFILES_FILE", str(ROOT / "config" / "fastdds.xml"))
    with ros_domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        yield number
