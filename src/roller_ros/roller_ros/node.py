"""What all nodes of the workspace are."""

from __future__ import annotations

from rclpy.node import Node

from roller_core.last_resort import ends_within

#: Time in which a node leaves the graph, s; it takes some hundredths.
LEAVES_WITHIN_S = 5


class RollerNode(Node):
    """A node that leaves the graph in time.

    Fast DDS 3.2 can hang there for good, with the interpreter's lock held, when other nodes leave
    at the same time: `DomainParticipant::set_listener` waits for a callback that waits for it.
    Nodes stop their own work before, in their `destroy_node`, so nothing is lost then.

    Attributes
    ----------
    exit_code : int, optional
        That of the process when it ends with the node, None: when it doesn't.
    """

    exit_code: int | None = None

    def destroy_node(self) -> None:
        """Leave the graph."""
        if self.exit_code is None:
            super().destroy_node()
        else:
            with ends_within(LEAVES_WITHIN_S, self.exit_code):
                super().destroy_node()
