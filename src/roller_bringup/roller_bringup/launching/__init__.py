"""Running ROS 2 launch files (XML) where `ros2 launch` is absent.

A strict subset: what it reads it does as `ros2 launch` would, with one process a node and the same
arguments; what it doesn't know it refuses, naming file and line.
"""

from .arguments import Argument, list_arguments
from .errors import LaunchError
from .plan import LaunchPlan, NodeProcess, load
from .runner import Runner, run

__all__ = [
    "Argument",
    "LaunchError",
    "LaunchPlan",
    "NodeProcess",
    "Runner",
    "list_arguments",
    "load",
    "run",
]
