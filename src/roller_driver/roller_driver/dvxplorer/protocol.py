"""What the DVXplorer Mini speaks over USB: ids, requests, registers and event words.

Sources: libcaer (dvxplorer.c), jAER (DVXplorerFX3HardwareInterface) and a trace of dv-processing
2.0.4 against an emulated device. Not tried on a camera by us.

Two generations of firmware differ in everything but the event words. From firmware 10 on, the
camera has parameters of its own for the sensor and takes 8-byte values; firmware 8 and 9 take
4-byte values and let the host write the sensor's registers (module 5).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias

VENDOR_ID: Final = 0x152A
PRODUCT_ID: Final = 0x8419
#: High byte of bcdDevice of the MIPI models; the FX3 models have others and another stream.
MODEL_MINI: Final = 4

CONFIGURATION: Final = 1
INTERFACE: Final = 0
DATA_ENDPOINT: Final = 0x82

VENDOR_OUT: Final = 0x40
VENDOR_IN: Final = 0xC0
REQUEST_PARAMETER: Final = 0xBF
REQUEST_LOG_LEVEL: Final = 0xB1
REQUEST_FLUSH: Final = 0xC6

WIDTH: Final = 640
HEIGHT: Final = 480

OLDEST_FIRMWARE: Final = 8
FIRST_NEW_FIRMWARE: Final = 10

MODULE_DVS: Final = 1
MODULE_IMU: Final = 3
#: Sensor registers, firmware 8 and 9.
MODULE_SENSOR: Final = 5
MODULE_SYSTEM: Final = 6

# Parameters of module 1, firmware 10 and newer (0 to 3 in both generations).
DVS_WIDTH: Final = 0
DVS_HEIGHT: Final = 1
DVS_ORIENTATION: Final = 2
DVS_RUN: Final = 3
DVS_FLATTEN: Final = 4
DVS_SUBSAMPLE_X: Final = 5
DVS_SUBSAMPLE_Y: Final = 6
DVS_GLOBAL_HOLD: Final = 8
DVS_GLOBAL_RESET: Final = 9
DVS_RESET_SKIP: Final = 10
DVS_MIPI_TIMEOUT_ENABLE: Final = 11
DVS_MIPI_TIMEOUT_US: Final = 12
DVS_READOUT: Final = 13
DVS_THRESHOLD_ON: Final = 14
DVS_THRESHOLD_OFF: Final = 15
DVS_CROP_X: Final = 19
DVS_CROP_Y: Final = 20
DVS_CROP_WIDTH: Final = 21
DVS_CROP_HEIGHT: Final = 22
DVS_CROP_APPLY: Final = 23
DVS_FLIP_X: Final = 24
DVS_FLIP_Y: Final = 25

IMU_TYPE: Final = 0
IMU_ORIENTATION: Final = 1
IMU_RUN: Final = (2, 3, 4)

SYSTEM_LOGIC_VERSION: Final = 0
SYSTEM_CHIP: Final = 1
SYSTEM_LOGIC_PATCH: Final = 7
LOGIC_VERSION: Final = 18
LEAST_LOGIC_PATCH: Final = 2

# Sensor registers, firmware 8 and 9.
REG_BIAS_LOGSFONREST: Final = 0x000B
REG_BIAS_LOGALOGD: Final = 0x000C
REG_BIAS_SFOFF: Final = 0x0012
REG_BIAS_AMP: Final = 0x0018
REG_BIAS_ON: Final = 0x001C
REG_BIAS_OFF: Final = 0x001E
REG_MODE: Final = 0x3000
REG_PACKET_FORMAT: Final = 0x3067
REG_RESTART: Final = 0x3201
REG_TIME_RESET: Final = 0x3238
REG_CROP_BYPASS: Final = 0x3300
REG_CROP_Y_START_GROUP: Final = 0x3301
REG_CROP_Y_START_MASK: Final = 0x3302
REG_CROP_Y_END_GROUP: Final = 0x3303
REG_CROP_Y_END_MASK: Final = 0x3304
REG_CROP_X_START: Final = 0x3305
REG_CROP_X_END: Final = 0x3307
MODE_OFF: Final = 0
MODE_STREAM: Final = 2
PACKET_FORMAT_GROUPS: Final = 0x80

#: Read-out rate codes of firmware 10 and newer: frames a second at a constant rate, as fast with
#: frames left out under load (lossy), or slowing down under load (variable).
READOUT_RATES: Final[dict[str, int]] = {
    "constant_100": 0,
    "constant_200": 1,
    "constant_500": 2,
    "constant_1000": 3,
    "lossy_2000": 4,
    "lossy_5000": 5,
    "lossy_10000": 6,
    "variable_2000": 7,
    "variable_5000": 8,
    "variable_10000": 9,
    "variable_15000": 10,
}
MAX_THRESHOLD: Final = 17
#: Thresholds by `bias_sensitivity` for firmware 10 and newer, which has no such setting: the
#: middle is the camera's default, the steps are ours.
THRESHOLDS: Final = (15, 12, 9, 6, 3)
#: Registers by `bias_sensitivity` for firmware 8 and 9.
SENSITIVITY: Final[dict[int, tuple[int, int, int, int, int]]] = {
    REG_BIAS_LOGSFONREST: (0x06, 0x06, 0x06, 0x04, 0x04),
    REG_BIAS_SFOFF: (0x7D, 0x7D, 0x7D, 0x7F, 0x7F),
    REG_BIAS_ON: (0x06, 0x03, 0x00, 0x05, 0x02),
    REG_BIAS_OFF: (0x02, 0x05, 0x08, 0x03, 0x06),
}


@dataclass(frozen=True, slots=True)
class Write:
    """Set a parameter of a module."""

    module: int
    parameter: int
    value: int


@dataclass(frozen=True, slots=True)
class Read:
    """Read a parameter.

    The answer, if one comes, must be `exactly` or `at_least` that; only `required` reads must be
    answered, because some cameras let others run into the time-out.
    """

    module: int
    parameter: int
    what: str
    exactly: int | None = None
    at_least: int | None = None
    required: bool = False


@dataclass(frozen=True, slots=True)
class Vendor:
    """A vendor request without data; the camera may not know it."""

    request: int
    value: int = 0


@dataclass(frozen=True, slots=True)
class Wait:
    """Do nothing for a while."""

    seconds: float


@dataclass(frozen=True, slots=True)
class ClearHalt:
    """Clear the halt of the data endpoint."""


Step: TypeAlias = Write | Read | Vendor | Wait | ClearHalt


def value_length(firmware: int) -> int:
    """Bytes of a parameter's value (big-endian) on the wire."""
    return 8 if firmware >= FIRST_NEW_FIRMWARE else 4
