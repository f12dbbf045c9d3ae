"""A live node around a stage: messages in, what the stage gives out."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from event_camera_msgs.msg import EventPacket
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.task import Future
from sensor_msgs.msg import CameraInfo
from std_srvs.srv import Trigger
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
from .camera_source import CameraSource
from .feeding import NEW_SOURCE, backlog_for, bulk_of, feed, packet_of
from .node import RollerNode
from .parameters import declare_settings
from .polling import Poller
from .sources import OneSource, publishers
from .tf import PoseSources
from .work_left import WorkLeft
from .worker import Worker

#: Messages that are taken without looking for results while more wait.
_MOST_UNPROCESSED = 10
#: A scan begins and ends with windows too short for a result; more of them in a row are bad.
_MOST_EMPTY = 3
#: What it does before it listens.
_PREPARING = "not ready: it compiles its kernels, on a first run for a minute or two"
#: How long a service waits for nodes that still work on what came, s.
_PATIENCE_S = 10.0
#: A sender that isn't followed is looked up in the graph no more often, s.
_LOOK_S = 0.2


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
        self._looked_s = 0.0
        self._faults = self._unprocessed = self._steps_told = self._left_out_told = 0
        self._poses = PoseSources(settings.base_frame, settings.moving_frame)
        self._events, self._cameras = OneSource(), CameraSource[CameraInfo]()
        #: Of all topics that other nodes of the graph work out: depth maps, points.
        self._results = OneSource(latched=True, processes=True)
        self._meter = diagnostics.Meter()
        self._working = threading.Lock()  # the stage: the worker's, or a service's
        # Whom to follow: the poller's, or that of the thread that spins.
        self._sources = threading.RLock()
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
        self._poller = Poller(self)
        for name in kind.inputs:
            self._listen(name)
        self._others = WorkLeft(self) if stage.patient_services else None
        for name, act in stage.services().items():
            self._offer(name, act)
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
        topic, submit = topics.BY_NAME[name], self._worker.submit
        if name == outputs.TF:
            self._poller.subscribe(TFMessage, name, self._take_tf, qos.EVERY_TF)
        elif name == outputs.EVENTS:
            self._poller.subscribe(EventPacket, name, self._take_packet, topic.qos, packet_of)
        elif name == outputs.CAMERA_INFO:
            # Latched, as it should be, and as drivers have it that send it over and over.
            for quality in (qos.EVERY_LATCHED, qos.REPEATED):
                self.create_subscription(
                    CameraInfo, name, self._take_camera, quality,
                    event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
                )  # fmt: skip
        elif name == outputs.TF_STATIC:
            self.create_subscription(
                TFMessage, name, lambda m: submit((name, m), False), qos.EVERY_LATCHED
            )
        else:

            def take(message: Any, info: Mapping[str, Any]) -> None:
                if self.resolve_topic_name(name) not in self._taken_results or (
                    self._accepts_result(info)
                ):
                    submit((name, message), name != outputs.WRENCH)

            self.create_subscription(topic.type, name, take, topic.qos)

    def _accepts_result(self, info: Mapping[str, Any]) -> bool:
        """Whether a result is of the process that is followed, or of that node started again."""
        if self._results.accepts(info):
            return True
        before, now_s = self._results.followed, time.monotonic()
        if now_s - self._looked_s < _LOOK_S:
            return False
        self._looked_s = now_s
        self._keep_to_results()
        return before != self._results.followed and self._results.accepts(info)

    @property
    def _taken_results(self) -> list[str]:
        """Topics taken that other nodes of the graph work out."""
        ours = {topic.name for topic in topics.OUTPUTS} - {outputs.CONTACT}
        return [self.resolve_topic_name(name) for name in self.stage.inputs if name in ours]

    def _take_tf(self, message: TFMessage, info: Mapping[str, Any]) -> None:
        with self._sources:
            taken = self._poses.takes(message, info)
        if taken:
            self._worker.submit((outputs.TF, message), False)

    def _offer(self, name: str, act: Callable[[], str]) -> None:
        """Offer what a stage may be asked as a service ~/name."""
        patient = name in self.stage.patient_services
        asked: list[Future[tuple[bool, str]]] = []

        async def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            if asked:  # meanwhile again: it is of the same
                response.success, response.message = await asked[0]
                return response
            asked.append(Future[tuple[bool, str]]())
            try:
                late = await self._all_that_came() if patient else ""
                with self._working:
                    try:
                        response.success, response.message = True, act()
                    except RollerError as error:
                        response.success, response.message = False, str(error)
                    if late:
                        response.message += f"; {late} still had work left"
                    self._publish()
            finally:
                asked.pop().set_result((response.success, response.message))
            return response

        # While it waits, others have their turn.
        group = ReentrantCallbackGroup()
        self.create_service(Trigger, f"~/{name}", serve, callback_group=group)

    async def _all_that_came(self) -> str:
        """Wait until what came by now is here; who still works on it after `_PATIENCE_S`."""
        assert self._others is not None
        done, asked = Future[str](), self._others.ask()
        end_s = time.monotonic() + _PATIENCE_S

        def look() -> None:
            left = asked.unfinished
            here = not left and self._worker.waiting == 0
            if not done.done() and (here or time.monotonic() > end_s):
                done.set_result(left)

        timer = self.create_timer(0.05, look, clock=diagnostics.STEADY)
        try:
            return await done
        finally:
            asked.open = False
            self.destroy_timer(timer)

    def _take_packet(
        self, message: RawPacket | EventPacket | CodecError, info: Mapping[str, Any]
    ) -> None:
        if isinstance(message, CodecError):
            self._worker.submit((outputs.EVENTS, message))
            return
        with self._sources:
            before = self._events.followed
            if not self._events.accepts(info):
                return
            if before != self._events.followed:
                if before is not None:
                    self._worker.submit((outputs.EVENTS, NEW_SOURCE))
                self._submit_camera(self._cameras.of_events(self._events.followed))
        self._worker.submit((outputs.EVENTS, message), bulk=bulk_of(message))

    def _take_camera(self, message: CameraInfo, info: Mapping[str, Any]) -> None:
        with self._sources:
            self._submit_camera(self._cameras.take(message, info, self._events.followed))

    def _submit_camera(self, camera: CameraInfo | None) -> None:
        if camera is not None:
            self._worker.submit((outputs.CAMERA_INFO, camera))

    def _check_cameras(self) -> None:
        """Follow another camera_info when the publisher of the first is gone."""
        alive = publishers(self, self.resolve_topic_name(outputs.CAMERA_INFO))
        self._submit_camera(self._cameras.check(alive))

    def _keep_to_results(self) -> None:
        """Follow another process's results when the first is dead, or sends but some of them."""
        by_topic = [publishers(self, name) for name in self._taken_results]
        alive = {sender: name for found in by_topic for sender, name in found.items()}
        self._results.keep_to(alive, whole=by_topic)
        self._results.keep_to_name(alive)

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
            return self.stage.settled

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
        with self._sources:
            return self._status_of_sources()

    def _status_of_sources(self) -> tuple[bytes, str, Mapping[str, object]]:
        stage, worker = self.stage, self._worker
        self._poller.warn_of_unsuited()
        if isinstance(stage, EventStage):
            self._check_cameras()
        self._keep_to_results()
        level, message = self._health()
        values: dict[str, object] = {
            **self._meter.rates(**stage.rated()),
            **stage.counts(),
            "waiting_messages": worker.waiting,
            "idle": int(worker.waiting == 0 and (worker.idle or stage.settled)),
            "dropped_messages": worker.backlog.dropped,
            "faults": self._faults,
        }
        if outputs.TF in stage.inputs:
            values |= diagnostics.pose_figures(stage.frames.counts)
            values["foreign_poses"] = self._poses.foreign
        if self._taken_results:
            values["foreign_results"] = self._results.foreign
        if isinstance(stage, EventStage):
            clock = stage.stream.clock if stage.stream is not None else SensorClock()
            values |= diagnostics.clock_figures(clock)
            values["waiting_packets"] = worker.backlog.waiting_bulk
            values["waiting_mb"] = round(worker.backlog.waiting_bytes / 1e6, 1)
            values["foreign_packets"] = self._events.foreign
            values["foreign_camera_infos"] = self._cameras.foreign
        return level, message, values

    def _health(self) -> tuple[bytes, str]:
        """The worst that is the matter."""
        level, matter = self.stage.health()
        if level == ERROR:
            return diagnostics.ERROR, matter
        if conflict := self._conflict():
            return diagnostics.ERROR, conflict
        if matter:
            return bytes([level]), matter
        if isinstance(self.stage, EventStage) and self.stage.stream is not None:
            steps = self.stage.stream.clock.steps
            jumped, self._steps_told = steps > self._steps_told, steps
            if jumped:
                return (
                    diagnostics.WARN,
                    "the camera's clock has jumped against the host's; its map is started anew",
                )
        left_out, slow, came_not = 0, "", 0
        if isinstance(self.stage, EventStage):
            (left_out, slow), came_not = self.stage.too_slow(), self.stage.lost_packets
            before, self._left_out_told = self._left_out_told, left_out
            if left_out > before:  # since the last report: it holds no more than that
                return diagnostics.WARN, slow
        if self.stage.lost or self._worker.backlog.dropped:
            # What waited too long goes too where there is no keeping up: that is no loss by itself.
            return diagnostics.WARN, slow if left_out and not came_not else "data were lost"
        return diagnostics.OK, "running"

    def _conflict(self) -> str:
        """Publishers that don't agree; empty: there is but one of each topic."""
        if conflict := self._poses.pose_conflict(self):
            return conflict
        for source, names in (
            (self._events, [self.resolve_topic_name(outputs.EVENTS)]),
            (self._cameras, [self.resolve_topic_name(outputs.CAMERA_INFO)]),
            (self._results, self._taken_results),
        ):
            what = ", ".join(names)
            if conflict := source.conflict(self, names, what, "stop all but one"):
                return conflict
        return ""
