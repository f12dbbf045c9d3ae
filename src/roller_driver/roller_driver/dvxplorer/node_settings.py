"""Parameters of node `event_camera`, in libcaer_driver's names where it has them."""

from __future__ import annotations

from pydantic import Field, field_validator

from roller_core.codecs import ENCODED_ENCODINGS
from roller_core.frame_names import CAMERA_FRAME

from .camera_settings import SensorSettings


class EventCameraParameters(SensorSettings):
    """The sensor's settings and how its events are published."""

    serial: str = Field("", description="Serial number of the camera; empty: the first one found.")
    camera_frame_id: str = Field(CAMERA_FRAME, description="Frame of all messages' headers.")
    camerainfo_url: str = Field(
        "",
        description="Calibration, ROS camera_info YAML: a path or a file:// URL; empty: none, and "
        "camera_info says that the camera is not calibrated.",
    )
    encoding: str = Field(
        "libcaer_cmp",
        description="Encoding of event packets: " + ", ".join(ENCODED_ENCODINGS) + ".",
    )
    event_message_time_threshold: float = Field(
        1.0e-3, ge=1.0e-5, le=0.1, description="Longest time of a packet, s."
    )
    image_rate: float = Field(
        25.0, ge=0.0, le=200.0, description="Pictures of events a second, for people; 0: none."
    )
    autostart: bool = Field(
        True, description="Configure and activate at once; false: wait for lifecycle transitions."
    )
    backend: str = Field(
        "",
        description="USB library: package.module:function that returns a pyusb backend, such as a "
        "simulated camera; empty: the system's libusb.",
    )

    @field_validator("encoding")
    @classmethod
    def _encoding(cls, value: str) -> str:
        if value not in ENCODED_ENCODINGS:
            raise ValueError(f"can't be written; known are {', '.join(ENCODED_ENCODINGS)}")
        return value
