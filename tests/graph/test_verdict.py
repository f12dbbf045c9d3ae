"""A verdict on request is of all that was scanned, also of what other nodes still work on."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_srvs.srv import Trigger

from roller_core import outputs
from roller_core.outputs import Cloud, Output
from roller_emvs.patch import SURFACE_FIELDS, Patch
from roller_ros import messages, qos, topics

pytestmark = pytest.mark.graph

STATUS = "inspect: findings"


def strips(begin_m: float, t_ns: int, depth_m: float = 0.0) -> list[Output]:
    """Points of a plate in strips along the roll, with a round dent in the middle or without."""
    rng = np.random.default_rng(1)
    found = []
    for k in range(4):
        x = begin_m + 5e-3 * k + np.sort(rng.uniform(0.0, 5e-3, 6000))
        y = rng.uniform(0.0, 1e-2, len(x))
        z = rng.normal(0.0, 1e-5, len(x))
        z[np.hypot(x - begin_m - 1e-2, y - 5e-3) < 1.5e-3] -= depth_m
        sure, sigma = np.ones(len(x), np.float32), np.full(len(x), 2e-5, np.float32)
        patch = Patch(np.stack([x, y, z], -1), z.astype(np.float32), sure, sigma)
        cloud = Cloud(patch.columns(), SURFACE_FIELDS)
        found.append(Output(outputs.SURFACE_POINTS, t_ns + k * 10**8, "base", cloud))
    return found


def test_a_verdict_waits_for_points_that_are_still_worked_out(processes, watch):
    watcher = watch()
    points = topics.publisher(watcher.node, outputs.SURFACE_POINTS)
    statuses = watcher.node.create_publisher(DiagnosticArray, "/diagnostics", qos.DIAGNOSTICS)
    idle = ["1"]

    def say() -> None:
        values = {"packets": "9", "waiting_messages": "0", "idle": idle[0]}
        said = [KeyValue(key=key, value=value) for key, value in values.items()]
        statuses.publish(
            DiagnosticArray(status=[DiagnosticStatus(name="surface: it", values=said)])
        )

    watcher.node.create_timer(0.1, say)
    processes.start("inspect")
    watcher.spin_until(lambda: watcher.value(STATUS, "parts") == 0, 60, "inspect")
    client = watcher.node.create_client(Trigger, "/inspect/finish")
    watcher.spin_until(client.service_is_ready, 30, "service")
    refused = watcher.call("/inspect/finish", Trigger, Trigger.Request())
    assert not refused.success
    assert refused.message == "part 1: no points yet"

    idle[0] = "0"
    now = watcher.node.get_clock().now().nanoseconds
    for output in strips(0.0, now):
        points.publish(messages.to_message(output))
    watcher.spin_until(lambda: watcher.value(STATUS, "points") > 1000, 30, "points")
    answer, again = (client.call_async(Trigger.Request()) for _ in range(2))
    watcher.spin(0.7)
    assert not answer.done()
    for output in strips(0.02, now + 4 * 10**8, depth_m=3e-4):
        points.publish(messages.to_message(output))
    idle[0] = "1"
    watcher.spin_until(answer.done, 30, "the verdict")
    assert answer.result().success
    assert answer.result().message.startswith("part 1: nonconform"), answer.result().message
    watcher.spin_until(again.done, 30, "the same verdict")
    assert again.result() == answer.result()  # who asked meanwhile
    again = watcher.call("/inspect/finish", Trigger, Trigger.Request())
    assert not again.success
    assert again.message.startswith("part 2: no points yet; before: part 1: nonconform")
    assert processes.stop() == {"inspect": 0}
