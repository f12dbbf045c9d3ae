"""Ports of Fast DDS that were left half made: no node waits for them, one line says what to do."""

import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from roller_ros.shared_memory import SharedMemoryError, check_shared_memory, half_made

WHOLE = b"\2\0\0\0" + bytes(100)
#: Left by a process that found no room for one.
FAILED = b"\0"
#: Left by a process that was killed before it made room, before it began, and while it filled it.
HALF = {"empty": b"", "room": bytes(100), "begun": b"\1\0\0\0" + bytes(100)}


@pytest.mark.parametrize("content", HALF.values(), ids=HALF)
@pytest.mark.parametrize("name", ["fastdds_port7003", "fastrtps_port7412"])
def test_a_half_made_port_is_named(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / "fastdds_port7000").write_bytes(WHOLE)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SharedMemoryError, match=rf"killed as it began; remove it: rm \S+/{name}$"):
        check_shared_memory(tmp_path)


def test_what_else_lies_there_is_none_of_them(tmp_path: Path) -> None:
    """Locks and segments of participants may be empty, other programs' are theirs, and no one waits
    for a port that couldn't be made."""
    (tmp_path / "fastdds_port7000").write_bytes(WHOLE)
    (tmp_path / "fastdds_port7001").write_bytes(FAILED)
    for name in ("fastdds_port7000_el", "sem.fastdds_port7000_mutex", "fastdds_0123", "port7000"):
        (tmp_path / name).write_bytes(b"")
    check_shared_memory(tmp_path)
    check_shared_memory(tmp_path / "not_there")


def test_one_that_is_being_made_is_waited_for(tmp_path: Path) -> None:
    port = tmp_path / "fastdds_port7000"
    port.write_bytes(HALF["begun"])

    def finish() -> None:
        time.sleep(0.2)
        port.write_bytes(WHOLE)

    other = threading.Thread(target=finish)
    other.start()
    check_shared_memory(tmp_path)
    other.join()
    assert not half_made(tmp_path)


def in_own_shared_memory(content: str) -> list[str]:
    """A command's beginning: in a /dev/shm of its own, the machine's first ports hold something."""
    script = (
        "mount -t tmpfs tmpfs /dev/shm && "
        f"for p in $(seq 7000 7020); do printf '{content}' > /dev/shm/fastdds_port$p; done && "
        'exec "$@"'
    )
    own = ["unshare", "--mount", "sh", "-c", script, "sh"]
    if not shutil.which("unshare") or subprocess.run([*own, "true"], check=False).returncode:
        pytest.skip("no right to mount a /dev/shm of one's own")
    return own


@pytest.mark.graph
@pytest.mark.parametrize("content", ["", "\\1"], ids=["empty", "begun"])
def test_a_node_ends_with_a_line_where_it_would_hang(content: str) -> None:
    """A node that starts opens the first port of the machine."""
    own = in_own_shared_memory(content)
    node = [str(Path(sys.executable).with_name("emvs_node")), "--ros-args"]
    ended = subprocess.run([*own, *node], capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 1, ended.stderr
    assert ended.stderr.count("\n") == 1
    assert "no node can start: /dev/shm/fastdds_port7000" in ended.stderr


@pytest.mark.graph
def test_a_node_starts_where_there_was_no_room_for_ports() -> None:
    own = in_own_shared_memory("\\0")
    code = (
        "from rclpy.context import Context; from rclpy.node import Node; "
        "from roller_ros.refusals import init_ros; "
        "context = Context(); init_ros(context=context); "
        "Node('there', context=context).destroy_node(); context.try_shutdown()"
    )
    ended = subprocess.run(
        [*own, sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert ended.returncode == 0, ended.stderr
