"""`roller record`: record the running graph."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from roller_core.command_help import add_examples
from roller_core.option_types import add_output
from roller_core.progress import status_line
from roller_core.signals import handling_ends

if TYPE_CHECKING:
    from roller_recording.recorder_node import RecorderNode
    from roller_recording.writing import Progress

#: After this long without them, s, missing inputs are reported.
_PATIENCE_S = 5.0


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `record` to the command's parser."""
    parser = subparsers.add_parser(
        "record",
        help="record the running graph",
        description="Record the whole cell into a rosbag2 (MCAP): events, camera_info, pictures, "
        "transforms, force, results and diagnostics. Ctrl-C ends it; a second one doesn't wait for "
        "the disk. The exit code is 1 if anything was lost.",
    )
    add_output(parser, "bag folder to make (recording_DATE_TIME)")
    parser.add_argument(
        "--duration", type=_seconds, metavar="S", help="end after so many seconds (at Ctrl-C)"
    )
    parser.add_argument(
        "--raw",
        action="store_true",
        help="only what a replay needs: events, camera_info, transforms and force",
    )
    parser.add_argument(
        "--topic",
        metavar="NAME",
        help="topic of the event packets, the camera's other topics beside it; "
        "/CELL/event_camera/events: all topics of that cell (/event_camera/events)",
    )
    parser.add_argument(
        "--compress", action="store_true", help="compress the bag (zstd); takes more of a core"
    )
    parser.add_argument(
        "--queue-mb", type=float, metavar="MB", help="memory for what waits for the disk (512)"
    )
    parser.add_argument(
        "--keep-free-mb", type=float, metavar="MB", help="end when the disk has less free (200)"
    )
    add_examples(
        parser,
        "record --output scan  # until Ctrl-C",
        "record --output scan --raw --duration 20",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Record until it is asked to end, or something ends it."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.parameter import Parameter

    from roller_recording.recorder_node import RecorderNode
    from roller_ros.refusals import init_ros

    values = {
        "output": str(args.output or time.strftime("recording_%Y-%m-%d_%H-%M-%S")),
        "raw": args.raw,
        "events_topic": args.topic,
        "compress": args.compress,
        "queue_mb": args.queue_mb,
        "keep_free_mb": args.keep_free_mb,
    }
    given = [Parameter(name, value=value) for name, value in values.items() if value is not None]
    interrupts: list[int] = []
    with handling_ends(lambda number, _: interrupts.append(number)):
        init_ros([])
        node, code = None, 1
        try:
            node = RecorderNode(parameter_overrides=given)
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            code = _record(node, executor.spin_once, args.duration, interrupts)
            return code
        finally:
            if node is not None:
                node.exit_code = code
                node.destroy_node()
            rclpy.try_shutdown()


def _record(
    node: RecorderNode,
    spin_once: Callable[[float], None],
    duration_s: float | None,
    interrupts: list[int],
) -> int:
    recorder, begin = node.recorder, time.monotonic()
    end = float("inf") if duration_s is None else begin + duration_s
    patient = True
    with status_line() as (show, report):
        speed = _Speed()
        report(f"recording to {node.path}; Ctrl-C ends it")
        while not interrupts and recorder.fault is None and time.monotonic() < end:
            spin_once(min(0.1, max(end - time.monotonic(), 0.0)))
            progress = recorder.progress()
            show(speed.line(time.monotonic() - begin, progress))
            if patient and time.monotonic() - begin > _PATIENCE_S:
                patient = False
                if missing := node.missing():
                    report(f"nothing yet on {', '.join(missing)}")
        node.stop_taking()
        while not recorder.drain(0.1) and len(interrupts) < 2:
            show(f"writing what waits: {recorder.progress().waiting_bytes / 1e6:.0f} MB")
        recorder.stop()
    print(_summary(node))
    faults = node.faults()
    if not recorder.progress().packets:
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        faults.append(
            f"no event packet came on {', '.join(recorder.event_topics)} (ROS domain {domain}); "
            "is the camera's node running?"
        )
    for line in faults:
        print(f"error: {line}", file=sys.stderr)
    return 1 if faults else 0


def _summary(node: RecorderNode) -> str:
    p, recorder = node.recorder.progress(), node.recorder
    seconds = recorder.events_s
    rate = f", {p.events / seconds * 1e-6:.2f} million a second" if seconds else ""
    lines = [
        f"{node.path}: {recorder.duration_s:.1f} s, {p.bytes_written / 1e6:.1f} MB, "
        f"{sum(p.messages.values())} messages; {p.packets} event packets, {p.events} events{rate}"
    ]
    if missing := [name for name in node.missing() if name not in recorder.event_topics]:
        lines.append(
            f"nothing came on {', '.join(missing)}; a replay then needs --camera (camera_info) "
            "or --poses (tf, tf_static)"
        )
    return "\n".join(lines)


class _Speed:
    """The status line, with rates over the last second."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, Progress]] = deque()

    def line(self, t_s: float, now: Progress) -> str:
        seen = self._seen
        seen.append((t_s, now))
        while len(seen) > 2 and seen[1][0] <= t_s - 1.0:
            seen.popleft()
        begin_s, then = seen[0]
        dt_s = max(t_s - begin_s, 1e-3)
        return (
            f"{int(t_s) // 60:02d}:{t_s % 60:04.1f}  "
            f"{(now.events - then.events) / dt_s * 1e-6:6.2f} Mev/s  "
            f"{(now.bytes_written - then.bytes_written) / dt_s * 1e-6:6.1f} MB/s  "
            f"{now.bytes_written * 1e-6:8.1f} MB  "
            f"lost packets {now.lost_before}, messages {now.lost_here}  "
            f"waiting {now.waiting_bytes * 1e-6:.1f} MB"
        )


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number of seconds") from None
    if not value > 0:
        raise argparse.ArgumentTypeError("must be above 0")
    return value
