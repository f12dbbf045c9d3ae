from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from graph.graph_world import Processes, Watcher, own_domain


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """A ROS domain of the test's own, on loopback."""
    config = Path(__file__).resolve().parents[2] / "config" / "fastdds.xml"
    monkeypatch.setenv("ROS_DOMAIN_ID", own_domain(len(request.node.nodeid)))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("FASTDDS_DEFAULT_PROFILES_FILE", str(config))


@pytest.fixture
def processes(domain: None, tmp_path: Path) -> Iterator[Processes]:
    """Nodes; those that still run at the end are stopped."""
    made = Processes(tmp_path)
    yield made
    made.stop()


@pytest.fixture
def watch(domain: None) -> Iterator[Callable[..., Watcher]]:
    """Make a watcher of the topics named."""
    made: list[Watcher] = []

    def make(*names: str) -> Watcher:
        made.append(Watcher(names))
        return made[-1]

    yield make
    for watcher in made:
        watcher.close()
