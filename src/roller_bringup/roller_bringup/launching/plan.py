"""What a launch file comes to: the processes to start."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from .errors import LaunchError


@dataclass(frozen=True)
class NodeProcess:
    """One node's process.

    Attributes
    ----------
    name
        What its output is marked with: the node's name, or the executable's.
    command
        The program and its arguments, as launch_ros would give them.
    env
        The whole environment.
    required
        Whether everything stops when it ends (on_exit="shutdown").
    respawn
        Whether it is started again when it ends by itself.
    respawn_delay_s
        How long to wait before that, seconds.
    """

    name: str
    command: tuple[str, ...]
    env: Mapping[str, str] = field(repr=False)
    required: bool = False
    respawn: bool = False
    respawn_delay_s: float = 0.0


class LaunchPlan:
    """The processes of a launch file, and the parameter files written for them.

    Use it as a context manager, or `close` it, to remove those files.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.processes: list[NodeProcess] = []
        self._folder = tempfile.TemporaryDirectory(prefix="roller_launch_")

    @property
    def folder(self) -> Path:
        """Where the parameter files are."""
        return Path(self._folder.name)

    def close(self) -> None:
        """Remove the parameter files."""
        self._folder.cleanup()

    def __enter__(self) -> LaunchPlan:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def load(
    path: Path | str,
    arguments: Mapping[str, str] | None = None,
    environment: Mapping[str, str] | None = None,
) -> LaunchPlan:
    """Work out what a launch file starts.

    Parameters
    ----------
    path
        The launch file.
    arguments
        Values of its arguments by name; those it gives no default must be there.
    environment
        The environment to start from; this process's by default.

    Returns
    -------
    LaunchPlan
        The processes, in the order of the file.

    Raises
    ------
    LaunchError
        The file has something outside the subset, an argument is missing or unknown, or a
        package, an executable or a parameter file isn't there.
    """
    # The interpreter makes NodeProcess, so it can't be imported at the top.
    from .interpreter import Interpreter

    file = Path(path).absolute()
    given = dict(arguments or {})
    plan = LaunchPlan(file)
    try:
        interpreter = Interpreter(plan, given, dict(environment or os.environ))
        interpreter.run_file(file)
        unknown = sorted(given.keys() - interpreter.declared)
        if unknown:
            known = ", ".join(sorted(interpreter.declared)) or "none"
            raise LaunchError(f"no argument '{unknown[0]}'; there are: {known}", file)
        if not plan.processes:
            raise LaunchError("nothing to start", file)
    except BaseException:
        plan.close()
        raise
    return plan
