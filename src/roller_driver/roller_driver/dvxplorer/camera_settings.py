"""What can be set on the sensor, in the names of libcaer_driver where it has them."""

from __future__ import annotations

from pydantic import Field, model_validator

from roller_core.settings import Settings

from . import protocol

#: Settings that can be changed while the camera streams.
BIASES = ("bias_sensitivity", "contrast_threshold_on", "contrast_threshold_off")


class SensorSettings(Settings):
    """Biases, region of interest and read-out of the sensor."""

    bias_sensitivity: int = Field(
        2, ge=0, le=4, description="Sensitivity to contrast: 0 lowest, 2 default, 4 highest."
    )
    contrast_threshold_on: int = Field(
        -1,
        ge=-1,
        le=protocol.MAX_THRESHOLD,
        description="Threshold of ON events, firmware 10 and newer; -1: by bias_sensitivity.",
    )
    contrast_threshold_off: int = Field(
        -1,
        ge=-1,
        le=protocol.MAX_THRESHOLD,
        description="Threshold of OFF events, firmware 10 and newer; -1: by bias_sensitivity.",
    )
    polarity_flatten: bool = Field(False, description="Report all events as ON.")
    polarity_on_only: bool = Field(False, description="Report ON events only.")
    polarity_off_only: bool = Field(False, description="Report OFF events only.")
    roi_enabled: bool = Field(False, description="Read a region of interest only.")
    roi_start_col: int = Field(
        0, ge=0, le=protocol.WIDTH - 1, description="First column of the region."
    )
    roi_start_row: int = Field(
        0, ge=0, le=protocol.HEIGHT - 1, description="First row of the region."
    )
    roi_end_col: int = Field(
        protocol.WIDTH - 1, ge=0, le=protocol.WIDTH - 1, description="Last column of the region."
    )
    roi_end_row: int = Field(
        protocol.HEIGHT - 1, ge=0, le=protocol.HEIGHT - 1, description="Last row of the region."
    )
    readout_rate: str = Field(
        "variable_5000",
        description="Read-out frames a second, firmware 10 and newer: "
        + ", ".join(protocol.READOUT_RATES)
        + ".",
    )

    @model_validator(mode="after")
    def _check(self) -> SensorSettings:
        if self.readout_rate not in protocol.READOUT_RATES:
            raise ValueError(
                f"readout_rate '{self.readout_rate}' is not one of "
                + ", ".join(protocol.READOUT_RATES)
            )
        if self.roi_enabled and (
            self.roi_end_col < self.roi_start_col or self.roi_end_row < self.roi_start_row
        ):
            raise ValueError(
                "the region of interest ends before it starts (roi_start_*, roi_end_*)"
            )
        if self.polarity_flatten + self.polarity_on_only + self.polarity_off_only > 1:
            raise ValueError(
                "only one of polarity_flatten, polarity_on_only and polarity_off_only can be true"
            )
        return self

    @property
    def flatten_code(self) -> int:
        """0 none, 1 both as ON, 2 ON only, 3 OFF only."""
        return self.polarity_flatten + 2 * self.polarity_on_only + 3 * self.polarity_off_only

    @property
    def region(self) -> tuple[int, int, int, int]:
        """First column, first row, last column, last row."""
        if not self.roi_enabled:
            return (0, 0, protocol.WIDTH - 1, protocol.HEIGHT - 1)
        return (self.roi_start_col, self.roi_start_row, self.roi_end_col, self.roi_end_row)

    @property
    def thresholds(self) -> tuple[int, int]:
        """Contrast thresholds for ON and OFF, firmware 10 and newer."""
        usual = protocol.THRESHOLDS[self.bias_sensitivity]
        on, off = self.contrast_threshold_on, self.contrast_threshold_off
        return (usual if on < 0 else on, usual if off < 0 else off)
