"""Processes that begin with the libraries loaded, as these take longer to load than most tests."""

import multiprocessing
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(
    [
        "roller_bringup.cli",
        "roller_driver.event_camera_node",
        "roller_driver.ur10_node",
        "roller_emvs.emvs_node",
        "roller_emvs.surface_node",
        "roller_emvs.stitcher_node",
        "roller_braille.braille_node",
        "roller_recording.player_node",
        "roller_recording.recorder_node",
        "roller_sim.virtual_cell_node",
    ]
)


class ForkedProcess:
    """A module's `main` in a process of its own; what it prints goes to the end of a file.

    Its parent is a process that has loaded the libraries of all nodes; the environment and
    `sys.path` are those of now. It ends without taking the interpreter down in order: tests of
    launch files and commands start processes from nothing.

    Parameters
    ----------
    module : str
        Module with a `main`.
    words : list of str
        Command line behind the program's name.
    log : Path
        File for standard output and standard error.
    """

    def __init__(self, module: str, words: list[str], log: Path) -> None:
        arguments = (module, words, dict(os.environ), str(log))
        self._process = _CONTEXT.Process(target=_run, args=arguments)
        self._process.start()

    def poll(self) -> int | None:
        """Exit code, None while it runs."""
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """Exit code, once it has ended."""
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(str(self._process), timeout or 0.0)
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        """Send a signal."""
        if self.poll() is None and self._process.pid is not None:
            os.kill(self._process.pid, number)

    def kill(self) -> None:
        """End it at once."""
        self._process.kill()


def _run(module: str, words: list[str], environment: dict[str, str], log: str) -> None:
    os.environ.clear()
    os.environ.update(environment)
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    for stream in (1, 2):
        os.dup2(file, stream)
    sys.argv = [module, *words]
    sys.exit(import_module(module).main())
