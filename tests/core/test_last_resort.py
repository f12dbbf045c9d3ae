"""A process ends even where Python is stuck in a library."""

import subprocess
import sys

import pytest

from roller_core.last_resort import ends_within

#: `PyDLL` keeps the interpreter's lock during the call, as a library that hangs may.
STUCK = """
import ctypes, sys
from roller_core.last_resort import ends_within
with ends_within(1, {code}):
    ctypes.PyDLL(None).sleep(60)
"""


@pytest.mark.parametrize("code", [0, 3])
def test_a_call_that_keeps_the_lock_ends(code: int) -> None:
    ended = subprocess.run([sys.executable, "-c", STUCK.format(code=code)], timeout=50)
    assert ended.returncode == code


def test_what_is_done_in_time_goes_on() -> None:
    code = (
        "from roller_core.last_resort import ends_within; import time\n"
        "with ends_within(1, 3): pass\n"
        "time.sleep(1.5); print('on')"
    )
    ended = subprocess.run([sys.executable, "-c", code], timeout=50, capture_output=True, text=True)
    assert (ended.returncode, ended.stdout) == (0, "on\n")


def test_errors_come_through() -> None:
    with pytest.raises(ValueError, match="mine"), ends_within(60, 3):
        raise ValueError("mine")
