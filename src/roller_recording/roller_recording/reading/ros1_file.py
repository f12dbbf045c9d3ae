"""ROS 1 bags, as the same topics of a rosbag2 would read."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from rosbags.rosbag1 import Reader, ReaderError

from roller_core.bags import EVENT_PACKET, typestore
from roller_recording.raw_message import RawMessage

from .base import MalformedRecordingError, RecordingError, TruncatedRecordingError
from .dvs_messages import DVS_ARRAY, DvsPackets
from .storage import Items, Storage, reason

#: Types that have another name in ROS 2, with the same fields.
_RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}


class Ros1File(Storage):
    """A ROS 1 bag in the order of log times; messages come in CDR.

    Raises
    ------
    RecordingError
        If it can't be read.
    """

    def __init__(self, path: Path, shown: Path | None = None) -> None:
        super().__init__(path, shown)
        try:
            with Reader(path) as reader:
                for c in reader.connections:
                    self.topics[c.topic] = _RENAMED.get(c.msgtype, c.msgtype)
                    self.counts[c.topic] += c.msgcount
                if reader.message_count:
                    self.start_ns, self.end_ns = reader.start_time, reader.end_time - 1
        except (ReaderError, AssertionError, ValueError, KeyError) as error:
            raise RecordingError(
                f"bag {self.shown}: can't be read as a ROS 1 bag ({reason(error)}); "
                "`rosbag reindex` mends one that was cut off"
            ) from error
        self.unchecked = self.counts.total()

    def messages(self, topics: Collection[str]) -> Items:
        """Messages of some topics; one that can't be converted is left out, with a fault."""
        store, dvs = typestore(), DvsPackets()
        last_ns = self.start_ns or 0
        try:
            with Reader(self.path) as reader:
                wanted = [c for c in reader.connections if c.topic in topics]
                for connection, log_ns, raw in reader.messages(wanted) if wanted else ():
                    kind, topic, last_ns = self.topics[connection.topic], connection.topic, log_ns
                    try:
                        if kind == DVS_ARRAY:
                            data, kind = dvs.from_ros1(topic, raw), EVENT_PACKET
                        else:
                            data = bytes(store.ros1_to_cdr(raw, kind))
                    except KeyError:
                        continue  # of a type that nobody here reads
                    except Exception as error:  # whatever damaged bytes lead to
                        yield MalformedRecordingError(
                            f"bag {self.shown}: a message on {topic} at {log_ns * 1e-9:.6f} s is "
                            f"malformed ({reason(error)}); it is left out"
                        )
                        continue
                    yield RawMessage(log_ns, topic, data, kind)
        except Exception as error:  # whatever the library meets in a damaged file
            yield TruncatedRecordingError(
                f"bag {self.shown}: breaks off {(last_ns - (self.start_ns or 0)) * 1e-9:.3f} s "
                f"after its start ({reason(error)}); what came before is kept"
            )
