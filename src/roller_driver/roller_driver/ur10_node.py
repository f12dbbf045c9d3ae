"""Node `ur10`: the robot's poses on /tf, the camera's place on /tf_static, the tool's velocity."""

from __future__ import annotations

import sys
from collections.abc import Mapping

import numpy as np
from geometry_msgs.msg import TwistStamped, Vector3, WrenchStamped
from tf2_msgs.msg import TFMessage

from roller_core import outputs
from roller_core.clock import SensorClock
from roller_core.pose_track import Pose
from roller_driver.ur10.contact_watch import ContactWatch
from roller_driver.ur10.receiver import RobotReceiver, RobotSample
from roller_driver.ur10.receiver_status import SEARCHING, ReceiverStatus
from roller_driver.ur10.robot_settings import Ur10Parameters
from roller_ros import diagnostics, messages, qos, topics
from roller_ros.dds_profile import less_shared
from roller_ros.node import RollerNode
from roller_ros.node_main import run_node
from roller_ros.parameters import declare_settings
from roller_ros.tf import OtherPublishers
from roller_ros.worker import end_process
from tf_transformations import quaternion_about_axis


class Ur10Node(RollerNode):
    """Publishes what the robot's controller says."""

    def __init__(self) -> None:
        super().__init__("ur10")
        p = self._p = declare_settings(self, Ur10Parameters)
        p.check_hand_eye_file()
        self._clock_map = SensorClock()
        self._published = 0
        self._growth = diagnostics.Growth()
        self._meter = diagnostics.Meter()
        # Not _publishers: rclpy's own.
        self._tf = (
            self.create_publisher(TFMessage, outputs.TF, qos.TF)
            if p.connect and p.publish_tf
            else None
        )
        self._wrench = topics.publisher(self, outputs.WRENCH)
        self._contact = ContactWatch(p.least_force_n, p.most_force_n)
        self._velocity = self.create_publisher(TwistStamped, "~/tool_velocity", qos.TF)
        if p.publish_hand_eye and p.hand_eye_known:  # a wrong place would give wrong depth
            self._static = self.create_publisher(TFMessage, outputs.TF_STATIC, qos.TF_STATIC)
            now = self.get_clock().now().nanoseconds
            fixed = messages.transform(p.hand_eye, now, p.tool, p.sensor_frame)
            self._static.publish(TFMessage(transforms=[fixed]))
        self._others = OtherPublishers(self, p.tool)
        self._diagnostics = diagnostics.Diagnostics(
            self, "robot", self._status, hardware_id=p.robot_ip
        )
        self._receiver = RobotReceiver(
            p.robot_ip,
            self._take,
            on_change=self._on_change,
            on_failure=end_process,
            clock_ns=lambda: int(self.get_clock().now().nanoseconds),
            tcp_offset=p.tcp_offset,
        )
        if p.connect:
            self._receiver.start()

    def destroy_node(self) -> None:
        """Stop the receiver first: it publishes."""
        if hasattr(self, "_receiver"):  # else the node gave up before it had one
            self._receiver.stop()
        super().destroy_node()

    def _on_change(self, state: str, fault: str) -> None:
        if fault:
            self._diagnostics.fault(fault)
        else:
            self.get_logger().info(f"robot {self._p.robot_ip}: {state}")

    def _take(self, sample: RobotSample) -> None:
        self._clock_map.observe(sample.controller_ns, sample.arrival_ns)
        # A pose older than the one before would make a scan's recording useless.
        stamp_ns = self._clock_map.stamp(sample.controller_ns)
        if stamp_ns is not None:
            self._publish(sample, stamp_ns)

    def _publish(self, sample: RobotSample, stamp_ns: int) -> None:
        p = self._p
        if self._tf is not None:
            angle = float(np.linalg.norm(sample.pose[3:]))
            rotation = quaternion_about_axis(angle, sample.pose[3:] if angle else (0, 0, 1))
            pose = Pose(np.array(sample.pose[:3]), rotation)
            self._others.published(stamp_ns)
            self._tf.publish(
                TFMessage(transforms=[messages.transform(pose, stamp_ns, p.base, p.tool)])
            )
            self._published += 1
        if sample.wrench:
            self._contact.take(sample.wrench, sample.speed)
        if sample.wrench and self._wrench.get_subscription_count():
            fx, fy, fz, tx, ty, tz = sample.wrench
            wrench = WrenchStamped(header=messages.header(stamp_ns, p.base))
            wrench.wrench.force = Vector3(x=fx, y=fy, z=fz)
            wrench.wrench.torque = Vector3(x=tx, y=ty, z=tz)
            self._wrench.publish(wrench)
        if self._velocity.get_subscription_count():
            twist = TwistStamped(header=messages.header(stamp_ns, p.base))
            vx, vy, vz, wx, wy, wz = sample.speed
            twist.twist.linear = Vector3(x=vx, y=vy, z=vz)
            twist.twist.angular = Vector3(x=wx, y=wy, z=wz)
            self._velocity.publish(twist)

    def _status(self) -> tuple[bytes, str, Mapping[str, object]]:
        s, p = self._receiver.status, self._p
        if self._tf is not None:
            self._others.check()
        return (
            *self._health(s),
            {
                "state": s.state,
                "robot": p.robot_ip,
                "controller": s.controller or "",
                "rate_hz": s.controller.rate_hz if s.controller else "",
                "mode": s.mode,
                "safety": s.safety,
                "pose_rate_hz": self._meter.rates(samples=s.samples)["samples"],
                "force_n": "" if self._contact.force_n is None else round(self._contact.force_n, 1),
                "samples": s.samples,
                "published": self._published,
                "missed": s.missed,
                "pose_gaps": s.gaps,
                "longest_pose_gap_s": round(s.longest_gap_s, 3),
                "torn_reads": s.torn,
                "not_finite": s.not_finite,
                "connects": s.connects,
                **diagnostics.clock_figures(self._clock_map),
                "clock_steps_back": s.steps_back,
            },
        )

    def _health(self, s: ReceiverStatus) -> tuple[bytes, str]:
        """The worst that is the matter."""
        p, grown = self._p, self._growth.of
        missed, no_numbers = grown("missed", s.missed), grown("not finite", s.not_finite)
        jumped = grown("clock steps", self._clock_map.steps) > 0
        contact = self._contact.verdict()
        if s.state == SEARCHING:
            return diagnostics.ERROR, s.fault or f"looking for robot {p.robot_ip}"
        if simulated := diagnostics.simulated_clock(self):
            return diagnostics.ERROR, simulated
        if s.stopped_for_safety:
            return diagnostics.ERROR, f"the robot stands: {s.safety}"
        if p.publish_hand_eye and not p.hand_eye_known:
            return diagnostics.ERROR, (
                "the camera's place on the tool is not set (hand_eye_m), so there is no depth: "
                "calibrate it; hand_eye_identity says that it is the tool's own on purpose"
            )
        if self._others.found:
            return diagnostics.ERROR, (
                f"another node publishes {p.tool} on /tf too: set publish_tf to false here or stop "
                "the other"
            )
        if no_numbers:
            return diagnostics.ERROR, f"{no_numbers} poses are no numbers, and left out"
        if contact:
            return diagnostics.ERROR, contact
        if jumped:
            return (
                diagnostics.WARN,
                "the controller's clock has jumped against the host's; its map restarts",
            )
        if missed:
            return diagnostics.WARN, f"{missed} poses were missed"
        return diagnostics.OK, s.state if p.connect else "another node connects to the robot"


def main() -> None:
    """Run the node."""
    sys.exit(run_node(less_shared(Ur10Node)))
