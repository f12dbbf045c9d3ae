"""Fixtures of all tests."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from own import ros_domain
from roller_core.pose_smoothing import StampSmoother
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods.surface import SurfaceSettings
from roller_emvs.warm_up import warm_up
from roller_sim.cell import VirtualCell
from simulated_scans import LONG_TESTS, Scans, scan_settings
from starved import take

ROOT = Path(__file__).resolve().parents[1]
#: So many tests of one run need most kernels.
MANY_TESTS = 500

# How long an example takes says something of the machine, nothing of the code.
settings.register_profile(
    "any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("any machine")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the tests that take long, and those that read what others simulated.

    Of two processes one begins with the graphs, which mostly wait, the other with scans, which
    compute; the quick tests that are left over even out at the end.
    """
    long = tuple(str(ROOT / "tests" / name) for name in LONG_TESTS)
    for item in items:
        if "scans" in getattr(item, "fixturenames", ()) or str(item.path).startswith(long):
            item.add_marker(pytest.mark.scan)
    if hasattr(config, "workerinput"):
        kinds: dict[str, list[pytest.Item]] = {"graph": [], "scan": [], "quick": []}
        for item in items:
            marked = (kind for kind in kinds if item.get_closest_marker(kind))
            kinds[next(marked, "quick")].append(item)
        graph, scan, quick = kinds.values()
        # Each of two processes gets half of the list, and steals from the other's end.
        first = max(len(items) // 2 - len(graph), 0)
        items[:] = [*graph, *quick[:first], *scan, *quick[first:]]


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Take tests of live graphs again where the machine starved."""
    if item.get_closest_marker("graph") is None:
        return None
    take(item, nextitem)
    return True


def pytest_collection_finish(session: pytest.Session) -> None:
    """Compile the kernels that most tests need before the first of many, each by one process."""
    if not hasattr(session.config, "workerinput") or len(session.items) < MANY_TESTS:
        return
    assert session.config.cache is not None
    folder = Path(session.config.cache.mkdir("kernels"))
    # Those of `focus` and `surface` are partly the same, and with them those of `bma`: last.
    tasks = {
        "evidence": ("focus", "surface"),
        "votes": ("virtual cell", "stamps", "bma", "left_right"),
    }
    for wait in (False, True):
        for task, kernels in tasks.items():
            with open(folder / task, "w") as lock, suppress(BlockingIOError):
                fcntl.flock(lock, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
                for name in () if wait else kernels:
                    compile_kernels(name)


def compile_kernels(name: str) -> None:
    """Compile those of a method, of the virtual cell or of poses' stamps, or load them."""
    if name == "virtual cell":
        small = {"width": 64, "height": 16, "focal_px": 533.0}
        cell = VirtualCell(scan_settings("flat", 0.5, {"camera": small}))
        for _ in cell.raw_events():
            break
    elif name == "stamps":
        StampSmoother(1)
    elif name == "surface":
        warm_up(SurfaceSettings.create({}))
    else:
        warm_up(DepthSettings.create({"method": name}))


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
