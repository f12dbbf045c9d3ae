"""Running our ROS 2 launch files (XML) where `ros2 launch` is absent.

What they use is read as `ros2 launch` reads it, with one process a node and the same arguments;
anything else is refused, naming file and line.
"""

from .document import LaunchError
from .interpreter import Argument, list_arguments, load
from .plan import LaunchPlan, NodeProcess
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
