"""Parameters of node `ur10`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import Field, model_validator

from roller_core.errors import SettingsError
from roller_core.frame_settings import RobotFrames
from roller_core.parameter_files import read_parameters
from roller_core.pose_track import Pose
from roller_core.settings import Settings
from roller_core.transforms import rotation_vector_to_quaternion, unit_quaternion

_NO_QUATERNION = (0.0, 0.0, 0.0, 1.0)
_NO_ROTATION = (0.0, 0.0, 0.0)
#: No camera or tool is further from the flange than this, m, nor turned by more than this, rad:
#: then it is in millimetres or degrees.
_FARTHEST_M, _MOST_RAD = 1.0, 2 * np.pi + 1e-6


def _check_units(name: str, position_m: Sequence[float], rotation_rad: Sequence[float]) -> None:
    away, turn = float(np.linalg.norm(position_m)), float(np.linalg.norm(rotation_rad))
    if away > _FARTHEST_M:
        raise ValueError(f"{name} lies {away:.3g} m away: is it in millimetres?")
    if turn > _MOST_RAD:
        raise ValueError(f"{name} is turned by {turn:.3g} rad: is it in degrees?")


class HandEyeSettings(Settings):
    """The camera's place on the tool, as `roller calibrate` finds it."""

    hand_eye_m: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="Camera's position in the tool's frame, m."
    )
    hand_eye_quaternion: tuple[float, float, float, float] = Field(
        _NO_QUATERNION, description="Camera's rotation in the tool's frame, x y z w."
    )
    hand_eye_rotation_rad: tuple[float, float, float] = Field(
        _NO_ROTATION,
        description="The same as a rotation vector, rad; give one of the two.",
    )
    hand_eye_identity: bool = Field(
        False,
        description="Whether the camera's frame is the tool's on purpose: nothing else is set.",
    )

    @model_validator(mode="after")
    def _check(self) -> HandEyeSettings:
        length = float(np.linalg.norm(self.hand_eye_quaternion))
        if not 0.99 < length < 1.01:
            raise ValueError(f"hand_eye_quaternion has length {length:.3g}, not 1")
        if (
            self.hand_eye_quaternion != _NO_QUATERNION
            and self.hand_eye_rotation_rad != _NO_ROTATION
        ):
            raise ValueError("give hand_eye_quaternion or hand_eye_rotation_rad, not both")
        _check_units("hand_eye", self.hand_eye_m, self.hand_eye_rotation_rad)
        return self

    @property
    def hand_eye_known(self) -> bool:
        """Whether anything but the default is set, or the default is meant."""
        return self.hand_eye_identity or (
            self.hand_eye_m,
            self.hand_eye_quaternion,
            self.hand_eye_rotation_rad,
        ) != (
            (0.0, 0.0, 0.0),
            _NO_QUATERNION,
            _NO_ROTATION,
        )

    @property
    def hand_eye(self) -> Pose:
        """The camera in the tool's frame."""
        if self.hand_eye_rotation_rad != _NO_ROTATION:
            rotation = rotation_vector_to_quaternion(self.hand_eye_rotation_rad)
        else:
            rotation = unit_quaternion(self.hand_eye_quaternion)
        return Pose(np.array(self.hand_eye_m), rotation)


class Ur10Parameters(HandEyeSettings, RobotFrames):
    """Where the robot is and what is published of it."""

    robot_ip: str = Field("192.168.56.101", description="Address of the robot's controller.")
    tcp_offset: tuple[float, ...] = Field(
        (0.0,),
        description="Tool centre point on the flange that the camera's place was found with: "
        "x y z (m), rotation vector (rad); with another no poses are published. A single 0: any.",
    )
    hand_eye_file: str = Field(
        "",
        description="Parameter file that must set the camera's place, as a launch argument names "
        "it; empty: none must.",
    )
    connect: bool = Field(
        True,
        description="Whether to connect to the robot; false where the robot's own driver publishes "
        "its poses: the camera's place alone is published.",
    )
    publish_tf: bool = Field(
        True,
        description="Publish base -> tool on /tf; false where the robot's own driver does.",
    )
    publish_hand_eye: bool = Field(
        True, description="Publish tool -> camera on /tf_static, once it is set."
    )
    least_force_n: float = Field(
        0.0, ge=0.0, le=500.0, description="Contact is lost below this force, N; 0: not watched."
    )
    most_force_n: float = Field(
        0.0, ge=0.0, le=500.0, description="Pressed too hard above this force, N; 0: not watched."
    )

    @model_validator(mode="after")
    def _check_tool(self) -> Ur10Parameters:
        if len(self.tcp_offset) not in (1, 6):
            raise ValueError(f"tcp_offset has {len(self.tcp_offset)} values, not 6")
        _check_units("tcp_offset", self.tcp_offset[:3], self.tcp_offset[3:])
        if 0 < self.most_force_n <= self.least_force_n:
            raise ValueError(
                f"most_force_n {self.most_force_n:g} isn't above least_force_n "
                f"{self.least_force_n:g}"
            )
        return self

    def check_hand_eye_file(self) -> None:
        """Hold `hand_eye_file` to what it was given for.

        Raises
        ------
        SettingsError
            If it says nothing of the camera's place: that of another file, or none, would hold.
        """
        if not self.hand_eye_file:
            return
        if not read_parameters(self.hand_eye_file, "ur10").keys() & HandEyeSettings.model_fields:
            raise SettingsError(
                f"hand_eye {self.hand_eye_file}: there is no camera's place on the tool in it "
                "(section ur10, hand_eye_m); give the file that `roller calibrate hand-eye "
                "--output` wrote, or leave the argument out"
            )
