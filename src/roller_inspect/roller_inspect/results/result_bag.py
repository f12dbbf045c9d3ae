"""The /roller topics of a run as a rosbag2 (MCAP)."""

from __future__ import annotations

from pathlib import Path

from rclpy.serialization import serialize_message

import roller_braille.messages  # noqa: F401 (registers the messages of cells)
from roller_core.bag_writer import BagWriter
from roller_core.outputs import DIAGNOSTICS, FINDING_MARKERS, FINDINGS, Output
from roller_ros import topics
from roller_ros.messages import to_message


class ResultBag:
    """Writes what stages give as the nodes would publish it.

    Parameters
    ----------
    path : path
        Bag folder to make.

    Raises
    ------
    UnwritableOutputError
        If it can't be written.
    """

    def __init__(self, path: Path) -> None:
        # Depth images are mostly NaN: a tenth of their size when compressed.
        self._writer = BagWriter(
            path,
            {
                topic.path: (topic.type_name, topics.offered(topic))
                for topic in topics.OUTPUTS
                if topic.name != DIAGNOSTICS
            },
            compress=True,
        )
        self._writer.declare_all()

    def write(self, output: Output) -> None:
        """Write one output at its time."""
        if output.topic in (FINDINGS, FINDING_MARKERS):
            # Registers theirs; what inspects loads scipy, so not before there is some.
            import roller_inspect.messages  # noqa: F401
        data = serialize_message(to_message(output))
        self._writer.write(topics.BY_NAME[output.topic].path, int(output.t_ns), data)

    def close(self) -> None:
        """Finish the bag.

        Raises
        ------
        BagFullError
            If the disk doesn't take its end; what was written before is readable.
        """
        self._writer.flush()
        self._writer.close()
