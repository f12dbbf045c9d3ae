"""Names of frames, unless a user says otherwise.

They stand by themselves: the live page, which is to stay small, loads no settings models.
"""

#: The robot's base.
BASE_FRAME = "base"
#: The tool (TCP), which the robot moves.
TOOL_FRAME = "tool0_controller"
#: The event camera: x right, y down, z forward.
CAMERA_FRAME = "event_camera_optical_frame"
