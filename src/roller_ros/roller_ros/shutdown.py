"""For threads that publish: the graph can be gone before the node has stopped them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node


@contextmanager
def until_shutdown(node: Node) -> Iterator[None]:
    """Let what a thread does end quietly once the node's context is shut down.

    An interrupt shuts the context down before `destroy_node` is called, so a publisher that worked
    a moment ago raises.
    """
    try:
        yield
    except (_rclpy.RCLError, _rclpy.InvalidHandle):
        if node.context.ok():
            raise
