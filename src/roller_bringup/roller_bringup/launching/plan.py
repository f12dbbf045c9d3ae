"""What a launch file comes to: the processes to start."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class NodeProcess:
    """One node's process."""

    #: The node's name.
    name: str
    #: The program and its arguments, as launch_ros would give them.
    command: tuple[str, ...]
    #: The whole environment.
    env: Mapping[str, str] = field(repr=False)
    #: Whether everything stops when it ends (on_exit="shutdown").
    required: bool = False
    #: The node's namespace.
    namespace: str = "/"
    #: How long it has after SIGINT before SIGTERM, s; None: as all.
    grace_s: float | None = None
    #: Whether it is started by `roller_core.signals.load_and_run`.
    ours: bool = False

    @property
    def label(self) -> str:
        """Name with namespace, that its output is marked with: `emvs` or `left/emvs`."""
        return f"{self.namespace}/{self.name}".strip("/")


class LaunchPlan:
    """The processes of a launch file, and the parameter files written for them.

    Use it as a context manager, or `close` it, to remove those files.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.processes: list[NodeProcess] = []
        self._folder = tempfile.TemporaryDirectory(prefix="roller_launch_")

    def write(self, text: str) -> Path:
        """Keep a parameter file for the processes."""
        folder = Path(self._folder.name)
        path = folder / f"parameters_{len(list(folder.iterdir()))}.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    def close(self) -> None:
        """Remove the parameter files."""
        self._folder.cleanup()

    def __enter__(self) -> LaunchPlan:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
