"""An interrupt while a program loads."""

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from roller_core.signals import load_and_run, terminate_in_order

LOADING = """
import time
print("loading", flush=True)
time.sleep(60.0)
"""


def test_an_interrupt_while_a_program_loads_prints_nothing(tmp_path: Path) -> None:
    (tmp_path / "slow_to_load.py").write_text(LOADING)
    code = "from roller_core.signals import load_and_run; load_and_run('slow_to_load')"
    # As at a terminal, even where the tests run in the background.
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); " + code
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "loading\n"
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=60) == ("", "")
    assert process.returncode == -signal.SIGINT


def compile_for_long(called: Callable[[], None]) -> None:
    with terminate_in_order():
        ctypes.CFUNCTYPE(None)(called)()
        time.sleep(30.0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_while_a_kernel_compiles_is_neither_lost_nor_a_fault(number: int) -> None:
    """LLVM calls this with what it compiled: what is raised in it goes nowhere."""
    compiled = []

    def _raw_object_cache_notify() -> None:
        os.kill(os.getpid(), number)
        time.sleep(0.01)
        compiled.append("whole")

    # As at a terminal, even where the tests run in the background.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt) as raised:
            compile_for_long(_raw_object_cache_notify)
    finally:
        signal.signal(signal.SIGINT, before)
    assert compiled == ["whole"]
    assert getattr(raised.value, "number", signal.SIGINT) == number


def test_what_is_loaded_runs_and_can_be_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("loaded")
    seen: list[object] = []
    module.main = lambda: seen.append(signal.getsignal(signal.SIGINT))  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "loaded", module)
    load_and_run("loaded")
    assert seen == [signal.getsignal(signal.SIGINT)]
