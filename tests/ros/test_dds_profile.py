"""Shared memory of a process that sends little."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from roller_ros.dds_profile import PROFILE, sharing_less

NODE = """
import re, sys
import rclpy
from roller_ros.dds_profile import less_shared
from roller_ros.refusals import init_ros

init_ros([])
node = less_shared(lambda: rclpy.create_node("sends_little"), int(sys.argv[1]))()
line = r"(?m)^([0-9a-f]+)-([0-9a-f]+) .*/fastdds_[0-9a-f]+$"
found = re.findall(line, open("/proc/self/maps").read())
print(max(int(b, 16) - int(a, 16) for a, b in found))
node.destroy_node()
rclpy.shutdown()
"""


@pytest.mark.parametrize(("most", "megabytes"), [(0, 4), (16 << 20, 16), (1 << 30, 32)])
def test_a_process_shares_as_much_as_it_says(most: int, megabytes: int) -> None:
    words = [sys.executable, "-c", NODE, str(most)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert 0 <= int(done.stdout) - (megabytes << 20) < 2 << 20
    assert "Error" not in done.stderr


def test_what_is_no_profile_of_ours_stays(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    bare = tmp_path / "bare.xml"
    bare.write_text("<profiles/>")
    for value in (str(bare), "/nowhere.xml", ""):
        monkeypatch.setenv(PROFILE, value)
        with sharing_less():
            assert os.environ[PROFILE] == value
        assert os.environ[PROFILE] == value


def test_the_rest_of_the_profile_stays_and_nothing_is_left_lying_about() -> None:
    before = os.environ[PROFILE]
    size = r"<segment_size>\d+</segment_size>"
    with sharing_less():
        changed = Path(os.environ[PROFILE])
        assert re.sub(size, "", changed.read_text()) == re.sub(size, "", Path(before).read_text())
    assert os.environ[PROFILE] == before
    assert not changed.exists()
