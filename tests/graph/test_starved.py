"""What is taken again is told from what failed."""

import ctypes
import time

import pytest

from starved import LIMIT_S, Stalls


@pytest.mark.parametrize("stands_still", [False, True])
def test_a_process_that_stood_still_is_known(stands_still: bool) -> None:
    with Stalls() as stalls:
        time.sleep(0.1)
        if stands_still:
            ctypes.PyDLL(None).usleep(int(2e6 * LIMIT_S))  # with the interpreter's lock
    assert (stalls.longest_s > LIMIT_S) >= stands_still
