"""A live node around a stage: messages in, what the stage gives out."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any

from event_camera_msgs.msg import EventPacket
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from roller_core import outputs
from roller_core.clock import SensorClock
from roller_core.errors import RollerError
from roller_core.outputs import Output, Result
from roller_core.sensor_pose import transforms_of
from roller_core.stage import ERROR, EventStage, Stage

from . import diagnostics, messages, qos, topics
from .draining import subscribe_draining
from .parameters import declare_settings
from .tf import PoseSources
from .worker import Worker

#: Messages that are taken without looking for results while more wait.
_MOST_UNPROCESSED = 10


def feed(stage: Any, topic: str, message: Any, on_fault: Callable[[RollerError], None]) -> None:
    """Give a message to a stage as plain data.

    Parameters
    ----------
    stage : Stage
        Takes it.
    topic : str
        Where it came, as in `Stage.inputs`.
    message : message
        An event packet, camera_info, transforms or an image.
    on_fault : callable
        Called with the reason when the message, or a part of it, is left out.
    """
    if isinstance(message, TFMessage):
        for transform in transforms_of(message, static=topic == outputs.TF_STATIC):
            try:
                stage.take_transform(transform)
            except RollerError as error:
                on_fault(error)
        return
    try:
        if isinstance(message, EventPacket):
            stage.take_packet(message)
        elif isinstance(message, CameraInfo):
            stage.take_camera(messages.camera_from_info(message))
        elif isinstance(message, Image):
            stamp, frame = messages.to_ns(message.header.stamp), message.header.frame_id
            stage.take_output(Output(topic, stamp, frame, messages.image_to_array(message)))
    except RollerError as error:
        on_fault(error)


class StageNode(Node):
    """Subscribes for a stage, and publishes its results and its health.

    All work is done in one thread in the order of arrival, so what comes out is what a replay of
    the same messages gives. Broken input is reported and left out.

    Parameters
    ----------
    kind : type of Stage
        The stage; its parameters are the node's.
    **options
        Of `rclpy.node.Node`, such as `parameter_overrides`.
    """

    def __init__(self, kind: type[Stage[Any]], **options: Any) -> None:
        super().__init__(kind.node, **options)
        settings = declare_settings(self, kind.model)
        self.stage = stage = kind(settings)
        stage.clock_ns = lambda: int(self.get_clock().now().nanoseconds)
        self._faults = self._unprocessed = self._steps_told = 0
        self._sources = PoseSources(settings.base_frame, settings.moving_frame)
        self._meter = diagnostics.Meter()
        self._working = threading.Lock()  # the stage: the worker's, or a service's
        self._outputs = {name: topics.publisher(self, name) for name in kind.outputs}
        stage.warm_up()
        self._diagnostics = diagnostics.Diagnostics(
            self, kind.part, self._status, hardware_id=settings.sensor_frame
        )
        self._worker: Worker[tuple[str, Any]] = Worker(
            self._handle, self._flush, settings.idle_flush_s, kind.most_waiting
        )
        for name in kind.inputs:
            self._listen(name)
        for name, act in stage.services().items():
            self._offer(name, act)

    def destroy_node(self) -> None:
        """Stop the worker first: it publishes."""
        if hasattr(self, "_worker"):  # else the node gave up before it had one
            self._worker.stop()
        super().destroy_node()

    def _listen(self, name: str) -> None:
        topic, submit = topics.BY_NAME[name], self._worker.submit
        if name == outputs.TF:
            self.create_subscription(TFMessage, name, self._take_tf, qos.EVERY_TF)
        elif name == outputs.EVENTS:
            subscribe_draining(self, EventPacket, name, lambda m: submit((name, m)), topic.qos)
        elif name == outputs.CAMERA_INFO:
            # Latched, as it should be, and as drivers have it that send it over and over.
            for quality in (topic.qos, qos.REPEATED):
                self.create_subscription(
                    CameraInfo, name, lambda m: submit((name, m)), quality,
                    event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
                )  # fmt: skip
        else:
            awake = name != outputs.TF_STATIC
            self.create_subscription(
                topic.type, name, lambda m: submit((name, m), awake), topic.qos
            )

    def _take_tf(self, message: TFMessage, info: Mapping[str, Any]) -> None:
        if self._sources.accepts(message, info):
            self._worker.submit((outputs.TF, message), False)

    def _offer(self, name: str, act: Callable[[], str]) -> None:
        """Offer what a stage may be asked as a service ~/name."""

        def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            with self._working:
                try:
                    response.success, response.message = True, act()
                except RollerError as error:
                    response.success, response.message = False, str(error)
                self._publish()
            return response

        self.create_service(Trigger, f"~/{name}", serve)

    def _handle(self, item: tuple[str, Any]) -> None:
        with self._working:
            feed(self.stage, *item, self._fault)
            # Results don't depend on when they are asked for, and asking costs.
            self._unprocessed += 1
            if self._worker.waiting <= 1 or self._unprocessed >= _MOST_UNPROCESSED:
                self._publish()

    def _flush(self) -> None:
        with self._working:
            self._publish(flush=True)

    def _publish(self, flush: bool = False) -> None:
        self._unprocessed = 0
        try:
            for result in self.stage.results(flush):
                self._send(result)
        except RollerError as error:
            self._fault(error)

    def _send(self, result: Result) -> None:
        for output in result.outputs:
            self._outputs[output.topic].publish(messages.to_message(output))
        if result.notice:
            self._diagnostics.fault(result.notice)
        if result.fault is not None:
            self._fault(result.fault)

    def _fault(self, error: RollerError) -> None:
        self._faults += 1
        self._diagnostics.fault(str(error))

    def _status(self) -> tuple[bytes, str, Mapping[str, object]]:
        stage, worker = self.stage, self._worker
        level, message = self._health()
        values: dict[str, object] = {
            **self._meter.rates(**stage.rated()),
            **stage.counts(),
            "waiting_messages": worker.waiting,
            "dropped_messages": worker.dropped,
            **diagnostics.pose_figures(stage.frames.counts),
            "foreign_poses": self._sources.foreign,
            "faults": self._faults,
        }
        if isinstance(stage, EventStage):
            clock = stage.stream.clock if stage.stream is not None else SensorClock()
            values |= diagnostics.clock_figures(clock)
        return level, message, values

    def _health(self) -> tuple[bytes, str]:
        """The worst that is the matter."""
        level, matter = self.stage.health()
        if level == ERROR:
            return diagnostics.ERROR, matter
        if conflict := self._sources.conflict(self):
            return diagnostics.ERROR, conflict
        if matter:
            return bytes([level]), matter
        if isinstance(self.stage, EventStage) and self.stage.stream is not None:
            events = self.resolve_topic_name(outputs.EVENTS)
            cameras = self.count_publishers(events)
            if cameras > 1:
                return diagnostics.ERROR, f"{cameras} nodes publish {events}: stop all but one"
            steps = self.stage.stream.clock.steps
            jumped, self._steps_told = steps > self._steps_told, steps
            if jumped:
                return (
                    diagnostics.WARN,
                    "the camera's clock has jumped against the host's; its map is started anew",
                )
        if self.stage.lost or self._worker.dropped:
            return diagnostics.WARN, "data were lost"
        return diagnostics.OK, "running"
