"""An interrupt while a program loads."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from llvmlite.binding import ffi, get_process_triple

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


def call_in_llvm(called: Callable[[], None]) -> None:
    """Have LLVM's library call back, under its lock."""

    def left() -> None:
        pass

    ffi.register_lock_callback(called, left)
    try:
        get_process_triple()
    finally:
        ffi.unregister_lock_callback(called, left)


def call_in_destructor(called: Callable[[], None]) -> None:
    class Dropped:
        def __del__(self) -> None:
            called()

    Dropped()


def interruptible(
    call: Callable[[Callable[[], None]], None], compile_kernel: Callable[[], None]
) -> None:
    with terminate_in_order():
        call(compile_kernel)
        time.sleep(30.0)


@pytest.mark.parametrize("call", [call_in_llvm, call_in_destructor])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_while_a_kernel_compiles_is_neither_lost_nor_a_fault(
    number: int, call: Callable[[Callable[[], None]], None]
) -> None:
    """What is raised in LLVM's callbacks and in destructors goes nowhere."""
    compiled: list[str] = []

    def compile_kernel() -> None:
        if compiled:
            return
        os.kill(os.getpid(), number)
        time.sleep(0.01)
        compiled.append("whole")

    # As at a terminal, even where the tests run in the background.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt) as raised:
            interruptible(call, compile_kernel)
    finally:
        signal.signal(signal.SIGINT, before)
    assert compiled == ["whole"]
    other = threading.Thread(target=get_process_triple, daemon=True)
    other.start()
    other.join(timeout=30.0)
    assert not other.is_alive()  # the lock is free
    assert getattr(raised.value, "number", signal.SIGINT) == number


def test_what_is_loaded_runs_and_can_be_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("loaded")
    seen: list[object] = []
    module.main = lambda: seen.append(signal.getsignal(signal.SIGINT))  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "loaded", module)
    load_and_run("loaded")
    assert seen == [signal.getsignal(signal.SIGINT)]
