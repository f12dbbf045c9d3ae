"""Giving way on busy cores."""

import subprocess
import sys
from pathlib import Path

import pytest

GROUP = Path("/proc/self/autogroup")
CODE = """
import os
from pathlib import Path
from roller_ros.priority import give_way
group = Path("/proc/self/autogroup")
before = os.nice(0)
give_way(7)
print(os.nice(0) - before, *(group.read_text().split()[-1:] if group.exists() else ""))
"""


@pytest.mark.parametrize("leads", [True, False])
def test_a_node_gives_way_with_its_group_where_that_is_its_own(leads: bool) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, start_new_session=leads
    )
    assert ended.returncode == 0, ended.stderr
    # Nor is there a group where no session was made, as of the first process of a machine.
    nice, *group = ended.stdout.split()
    assert nice == "7"
    try:
        before = GROUP.read_text().split()[-1]
        GROUP.write_text(before)
    except (OSError, IndexError):
        return  # no such groups here, or none that we may change
    assert group == (["7"] if leads else [before])
