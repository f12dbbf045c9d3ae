"""Parameters of the recorder."""

from __future__ import annotations

from pydantic import Field

from roller_core.outputs import EVENTS
from roller_core.settings import Settings


class RecorderParameters(Settings):
    """Parameters of the node."""

    output: str = Field("recording", description="Bag folder to write; must not exist yet.")
    raw: bool = Field(
        False,
        description="Only what a replay needs: events, camera_info, transforms and force; else "
        "also pictures, results and diagnostics.",
    )
    events_topic: str = Field(
        EVENTS,
        pattern=r"^/?[A-Za-z_][A-Za-z0-9_/]*$",
        description="Topic of the event packets; camera_info and image_raw lie beside it.",
    )
    compress: bool = Field(False, description="Compress the bag (zstd, chunk by chunk).")
    queue_mb: float = Field(
        512.0,
        ge=1.0,
        le=1e6,
        description="Memory for what waits for the disk, MB; what comes when it is full is not "
        "written, counted and reported.",
    )
    keep_free_mb: float = Field(
        200.0,
        ge=0.0,
        le=1e9,
        description="Disk space that is left free, MB; recording ends before.",
    )
