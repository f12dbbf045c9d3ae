"""What the middleware keeps of what was sent."""

import subprocess
import sys

import pytest

#: Memory in use, MB, that fifty large messages and as many small ones after them leave behind.
LEFT_MB = """
import array, ctypes
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from roller_ros import qos
from roller_ros.refusals import init_ros

class Heap(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in (
        "arena", "ordblks", "smblks", "hblks", "mapped", "usmblks", "fsmblks", "used", "free", "top"
    )]

mallinfo = ctypes.CDLL(None).mallinfo2
mallinfo.restype = Heap

def used():
    heap = mallinfo()
    return heap.used + heap.mapped

init_ros([])
node = Node("scan")
publisher = node.create_publisher(PointCloud2, "points", qos.SURFACE)
before = used()
for size in 50 * [1_000_000] + 50 * [1000]:
    publisher.publish(PointCloud2(data=array.array("B", bytes(size))))
print((used() - before) * 1e-6)
node.destroy_node()
rclpy.try_shutdown()
"""


@pytest.mark.usefixtures("domain")
def test_a_large_message_leaves_no_large_buffer_behind() -> None:
    done = subprocess.run([sys.executable, "-c", LEFT_MB], capture_output=True, text=True)
    if "mallinfo2" in done.stderr:
        pytest.skip("this C library doesn't tell")
    assert float(done.stdout) < 10, done.stderr
