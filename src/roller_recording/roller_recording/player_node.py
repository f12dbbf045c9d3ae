"""Node `player`: a bag's recorded camera and robot, published in real time."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from pathlib import Path

from pydantic import Field
from rclpy.qos import DurabilityPolicy
from rosgraph_msgs.msg import Clock

from roller_core.errors import RollerError
from roller_core.outputs import force_topic
from roller_recording.reading.bag_reader import BagReader
from roller_recording.reading.base import RecordingError
from roller_recording.reading.event_topic import event_topic
from roller_ros import diagnostics, messages, qos, topics
from roller_ros.listeners import PlayingNode, PlaySettings
from roller_ros.node_main import run_node
from roller_ros.parameters import declare_settings

#: /clock is published once in this much of the bag's time.
_CLOCK_STEP_NS = 10_000_000


class PlayerParameters(PlaySettings):
    """Parameters of the node."""

    bag: str = Field("", description="The rosbag2 to play: its folder or its file.")
    topic: str = Field(
        "", description="Topic of the event packets in a bag that has several; empty: the only one."
    )
    clock: bool = Field(
        False,
        description="Whether to publish the bag's time on /clock, for nodes with use_sim_time; not "
        "beside live nodes that have it.",
    )


class PlayerNode(PlayingNode):
    """Publishes messages as they lie in the bag, spaced as they were logged.

    What is latched may have been said long before the scan began: it is published at once.
    """

    _p: PlayerParameters

    def __init__(self) -> None:
        super().__init__("player", "waiting")
        self._p = declare_settings(self, PlayerParameters)
        if not self._p.bag:
            raise RecordingError("parameter 'bag' is empty; name the rosbag2 to play")
        self._reader = BagReader(Path(self._p.bag))
        self._played = 0
        self._meter = diagnostics.Meter()
        in_bag = self._reader.topics
        events = event_topic(in_bag, Path(self._p.bag), self._p.topic or None)
        # Publishers by topic in the bag; a camera of another name is played as the graph's own.
        # Not _publishers: rclpy's own.
        self._outputs = {}
        self._latched = set[str]()
        for topic in topics.INPUTS + topics.FORCE:
            force = topic in topics.FORCE
            theirs = force_topic(events) if force else topics.beside(topic.name, events)
            # The older type of event packets has the same layout.
            if theirs == events or in_bag.get(theirs) == topic.type_name:
                made = self.create_publisher(topic.type, topic.name, topic.qos)
                self._outputs[theirs] = made
                if topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL:
                    self._latched.add(theirs)
        self._events = self._outputs[events]
        # Not _clock: rclpy's own.
        self._time = self.create_publisher(Clock, "/clock", qos.REPEATED) if self._p.clock else None
        self._time_ns: int | None = None
        self._diagnostics = diagnostics.Diagnostics(self, "playback", self._status, 0.5)
        self._start(self._run)

    def _run(self) -> None:
        try:
            self._wait_for_listeners(self._events)
            self._play()
        except RollerError as error:
            self._diagnostics.fault(str(error))
        self._finish()

    def _play(self) -> None:
        self._state = "playing"
        begin, first_ns = None, 0
        for item in self._reader.messages(set(self._outputs)):
            if self._stop.is_set():
                return
            if isinstance(item, RecordingError):
                self._diagnostics.fault(str(item))
                continue
            if item.topic not in self._latched and begin is None:
                begin, first_ns = time.monotonic(), item.t_ns
            if begin is not None:
                self._wait_until(begin + (item.t_ns - first_ns) * 1e-9 / self._p.rate)
                self._tell_time(item.t_ns)
            self._outputs[item.topic].publish(item.data)
            self._played += 1

    def _tell_time(self, t_ns: int) -> None:
        if self._time is not None and not (
            self._time_ns is not None and t_ns - self._time_ns < _CLOCK_STEP_NS
        ):
            self._time_ns = t_ns
            self._time.publish(Clock(clock=messages.to_time(t_ns)))

    def _status(self) -> tuple[bytes, str, Mapping[str, object]]:
        return (
            diagnostics.OK,
            self._state,
            {
                "message_rate_hz": self._meter.rates(messages=self._played)["messages"],
                "messages": self._played,
                "behind_real_time_s": round(self._late_s, 3),
            },
        )


def main() -> None:
    """Run the node."""
    sys.exit(run_node(PlayerNode))
