"""Set up the workspace: `make setup`.

Standard library only: this runs before anything is installed.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import sys
import time
from pathlib import Path

import distribution
import system
import wheels
from steps import SetupError, Steps
from venv_builder import Environment

ROOT = Path(__file__).resolve().parents[2]


def set_up() -> None:
    """Bring the workspace up to date; what is up to date is left alone."""
    start = time.monotonic()
    found = distribution.find()
    mode = "wheels" if found is None else "distribution"
    environment = Environment(ROOT / ".venv", mode)
    steps = Steps(environment.path / "setup")
    changed = False

    missing = system.missing_packages()
    if missing:
        # The log can't live in a virtual environment that isn't there yet.
        system.provide(Steps(ROOT / "log" / "setup"), missing)
    changed |= environment.ensure(steps)
    if found is None:
        changed |= wheels.build(ROOT, environment, steps)
    else:
        changed |= distribution.build(ROOT, environment, steps, found)
    steps.mark("mode", mode)

    if changed:
        print(f"setup: ready in {time.monotonic() - start:.0f} s; try ./roller --help")
    else:
        print("setup: nothing to do")


def main() -> int:
    """Run, one at a time in a checkout."""
    os.umask(0o022)
    lock = os.open(ROOT, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        print("setup: waiting for another set-up of this checkout", flush=True)
        fcntl.flock(lock, fcntl.LOCK_EX)
    try:
        set_up()
    except SetupError as error:
        print(f"setup: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nsetup: interrupted; `make setup` goes on from here", file=sys.stderr)
        return 130
    finally:
        shutil.rmtree(ROOT / "scripts" / "workspace" / "__pycache__", ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
