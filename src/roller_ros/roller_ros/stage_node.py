"""A live node around a stage: messages in, what the stage gives out."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from event_camera_msgs.msg import EventPacket
from rclpy.event_handler import SubscriptionEventCallbacks
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage

from roller_core import outputs
from roller_core.clock import SensorClock
from roller_core.codecs import CodecError, RawPacket
from roller_core.errors import RollerError
from roller_core.event_stage import EventStage
from roller_core.memory import keep_loaded, take_memory
from roller_core.outputs import ScanFault
from roller_core.stage import ERROR, Stage

from . import diagnostics, messages, qos, topics
from .feeding import backlog_for, bulk_of, feed, packet_of
from .node import RollerNode
from .parameters import declare_settings
from .polling import Poller
from .senders import Senders
from .services import PatientAnswers, offer
from .worker import Worker

#: Messages that are taken without looking for results while more wait.
_MOST_UNPROCESSED = 10
#: A scan begins and ends with windows too short for a result; more of them in a row are bad.
_MOST_EMPTY = 3
#: What it does before it listens.
_PREPARING = "not ready: it compiles its kernels, on a first run for a minute or two"
#: Topics whose messages alone don't keep it awake.
_QUIET = (outputs.TF, outputs.TF_STATIC, outputs.WRENCH)


class StageNode(RollerNode):
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
        self._empty = 0
        self._faults = self._unprocessed = 0
        self._growth = diagnostics.Growth()
        self._meter = diagnostics.Meter()
        self._working = threading.Lock()  # the stage: the worker's, or a service's
        self._outputs = {name: topics.publisher(self, name) for name in kind.outputs}
        self._diagnostics = diagnostics.Diagnostics(
            self, kind.part, self._status, hardware_id=settings.sensor_frame
        )
        with self._diagnostics.preparing(_PREPARING):
            stage.warm_up()
        take_memory(kind.memory_ahead)
        keep_loaded()
        self._worker: Worker[tuple[str, Any]] = Worker(
            self._handle, self._flush, settings.idle_flush_s, backlog_for(settings, kind),
            self._settled,
        )  # fmt: skip
        frames = settings.base_frame, settings.moving_frame
        self._senders = Senders(self, frames, kind.inputs, self._submit)
        self._poller = Poller(self)
        for name in kind.inputs:
            self._listen(name)
        patiently = stage.patient_services
        patient = PatientAnswers(self, lambda: self._worker.waiting) if patiently else None
        for name, act in stage.services().items():
            waits = patient if name in patiently else None
            offer(self, name, partial(self._act, act), waits)
        self._poller.start()

    def destroy_node(self) -> None:
        """Stop the worker first: it publishes. Say what waited for it."""
        if hasattr(self, "_poller"):
            self._poller.stop()
        if hasattr(self, "_worker"):  # else the node gave up before it had one
            self._worker.stop()
            if waited := self._unfinished():
                print(f"ended before its work was done: {waited}", file=sys.stderr, flush=True)
        super().destroy_node()

    def _unfinished(self) -> str:
        """What came and isn't in any result; empty: nothing."""
        messages_left = len(self._worker.backlog)
        pipeline = self.stage.pipeline if isinstance(self.stage, EventStage) else None
        events = pipeline.held_events if pipeline is not None else 0
        found = [f"{messages_left} messages waited"] if messages_left else []
        found += [f"{events} events were in windows not yet complete"] if events else []
        return ", ".join(found)

    def _listen(self, name: str) -> None:
        topic, senders = topics.BY_NAME[name], self._senders
        if name == outputs.TF:
            self._poller.subscribe(TFMessage, name, senders.take_poses, qos.EVERY_TF)
        elif name == outputs.EVENTS:
            self._poller.subscribe(EventPacket, name, self._take_packet, topic.qos, packet_of)
        elif name == outputs.CAMERA_INFO:
            # Latched, as it should be, and as drivers have it that send it over and over.
            for quality in (qos.EVERY_LATCHED, qos.REPEATED):
                self.create_subscription(
                    CameraInfo, name, senders.take_camera, quality,
                    event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
                )  # fmt: skip
        elif name == outputs.TF_STATIC:
            self.create_subscription(
                TFMessage, name, lambda m: self._submit(name, m), qos.EVERY_LATCHED
            )
        else:

            def take(message: Any, info: Mapping[str, Any]) -> None:
                if senders.takes_result(name, info):
                    self._submit(name, message)

            self.create_subscription(topic.type, name, take, topic.qos)

    def _take_packet(
        self, message: RawPacket | EventPacket | CodecError, info: Mapping[str, Any]
    ) -> None:
        if isinstance(message, CodecError):
            self._submit(outputs.EVENTS, message)
        else:
            self._senders.take_packet(message, info)

    def _submit(self, topic: str, item: Any) -> None:
        bulk = bulk_of(item) if isinstance(item, (RawPacket, EventPacket)) else None
        self._worker.submit((topic, item), topic not in _QUIET, bulk)

    def _act(self, act: Callable[[], str], late: str) -> tuple[bool, str]:
        """Do what a service asks for; `late` are nodes that still work on what came."""
        with self._working:
            try:
                success, said = True, act()
            except RollerError as error:
                success, said = False, str(error)
            self._publish()
        return success, said + (f"; {late} still had work left" if late else "")

    def _handle(self, item: tuple[str, Any]) -> None:
        with self._working:
            poses = self.stage.frames.counts.poses
            feed(self.stage, *item, self._fault)
            if self.stage.frames.counts.poses > poses and self._poses_are_late():
                self._worker.keep_awake()
            # Results don't depend on when they are asked for, and asking costs.
            self._unprocessed += 1
            if self._worker.waiting <= 1 or self._unprocessed >= _MOST_UNPROCESSED:
                self._publish()

    def _poses_are_late(self) -> bool:
        """Whether events wait for poses that are still on their way."""
        return isinstance(self.stage, EventStage) and self.stage.poses_behind_ns > 0

    def _settled(self) -> bool:
        with self._working:
            return self.stage.settled and not self._poses_are_late()

    def _flush(self) -> None:
        with self._working:
            self._publish(flush=True)

    def _publish(self, flush: bool = False) -> None:
        self._unprocessed, told = 0, list[tuple[str, bytes] | RollerError]()
        try:
            for result in self.stage.results(flush):
                for output in result.outputs:
                    self._outputs[output.topic].publish(messages.to_message(output))
                self._empty = self._empty + 1 if result.notice else 0
                if result.notice:
                    bad = any(isinstance(output.data, ScanFault) for output in result.outputs)
                    bad |= self._empty > _MOST_EMPTY
                    told.append((result.notice, diagnostics.ERROR if bad else diagnostics.WARN))
                if result.fault:
                    told.append(result.fault)
        except RollerError as error:
            told.append(error)
        finally:
            # Last, as nobody waits for it: rclpy takes 50 ms for a process's first line.
            for said in told:
                if isinstance(said, RollerError):
                    self._fault(said)
                else:
                    self._diagnostics.fault(*said)

    def _fault(self, error: RollerError) -> None:
        self._faults += 1
        self._diagnostics.fault(str(error))

    def _status(self) -> tuple[bytes, str, Mapping[str, object]]:
        stage, worker = self.stage, self._worker
        self._poller.warn_of_unsuited()
        self._senders.look()
        level, message = self._health()
        values: dict[str, object] = {
            **self._meter.rates(**stage.rated()),
            **stage.counts(),
            "waiting_messages": worker.waiting,
            "idle": int(worker.waiting == 0 and (worker.idle or stage.settled)),
            "dropped_messages": worker.backlog.dropped,
            "faults": self._faults,
            **self._senders.counts(),
        }
        if outputs.TF in stage.inputs:
            values |= diagnostics.pose_figures(stage.frames.counts)
        if isinstance(stage, EventStage):
            clock = stage.stream.clock if stage.stream is not None else SensorClock()
            values |= diagnostics.clock_figures(clock)
            values["waiting_packets"] = worker.backlog.waiting_bulk
            values["waiting_mb"] = round(worker.backlog.waiting_bytes / 1e6, 1)
        return level, message, values

    def _health(self) -> tuple[bytes, str]:
        """The worst that is the matter."""
        level, matter = self.stage.health()
        if level == ERROR:
            return diagnostics.ERROR, matter
        if conflict := self._senders.conflict():
            return diagnostics.ERROR, conflict
        if matter:
            return bytes([level]), matter
        stream = self.stage.stream if isinstance(self.stage, EventStage) else None
        if stream is not None and self._growth.of("clock steps", stream.clock.steps) > 0:
            return (
                diagnostics.WARN,
                "the camera's clock has jumped against the host's; its map is started anew",
            )
        left_out, slow, came_not = 0, "", 0
        if isinstance(self.stage, EventStage):
            (left_out, slow), came_not = self.stage.too_slow(), self.stage.lost_packets
            if (
                self._growth.of("left out", left_out) > 0
            ):  # since the last report: it holds no more than that
                return diagnostics.WARN, slow
        if self.stage.lost or self._worker.backlog.dropped:
            # What waited too long goes too where there is no keeping up: that is no loss by itself.
            return diagnostics.WARN, slow if left_out and not came_not else "data were lost"
        return diagnostics.OK, "running"
