"""Parameters of node `event_camera`, in libcaer_driver's names where it has them."""

from __future__ import annotations

from pydantic import Field, field_validator

from roller_core.codecs import ENCODED_ENCODINGS

from .camera_settings import SensorSettings


class EventCameraParameters(SensorSettings):
    """The sensor's settings and how its events are published."""

    serial: str = Field("", description="Serial number of the camera; empty: the first one found.")
    camera_frame_id: str = Field(
        "event_camera_optical_frame", description="Frame of all messages' headers."
    )
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
    event_message_size_threshold: int = Field(
        380_000,
        ge=1000,
        le=2**31 - 1,
        description="Largest packet, bytes; above 400 kB a DDS set up as usual loses messages.",
    )
    event_send_queue_size: int = Field(
        1000, ge=1, le=100_000, description="Packets that may wait to be sent."
    )
    statistics_print_interval: float = Field(
        10.0, ge=0.0, le=86_400.0, description="Pause between rates in the log, s; 0: none."
    )
    time_reset_delay: float = Field(
        0.0,
        ge=0.0,
        le=3600.0,
        description="Set the camera's clock to zero this long after the start, s; 0: never. "
        "Firmware 8 and 9.",
    )
    image_rate: float = Field(
        25.0, ge=0.0, le=200.0, description="Pictures of events a second, for people; 0: none."
    )
    autostart: bool = Field(
        True, description="Configure and activate at once; false: wait for lifecycle transitions."
    )
    retry_interval: float = Field(
        1.0, ge=0.05, le=60.0, description="Pause between attempts to find the camera, s."
    )
    usb_transfer_size: int = Field(
        65_536, ge=16_384, le=1_048_576, description="Size of one USB read, bytes."
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

    @property
    def max_events(self) -> int:
        """Events that surely fit `event_message_size_threshold` (8 bytes at worst)."""
        return max(1, self.event_message_size_threshold // 8)
