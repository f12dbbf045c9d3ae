"""What to send to start and to stop the camera, both generations of firmware."""

from __future__ import annotations

from collections.abc import Sequence

from . import protocol as p
from .camera_settings import SensorSettings
from .protocol import ClearHalt, Read, Step, Vendor, Wait, Write

_LOG_LEVEL_WARNING = 2


def identify(firmware: int) -> Sequence[Step]:
    """What to ask before anything is set."""
    if firmware >= p.FIRST_NEW_FIRMWARE:
        return (
            Vendor(p.REQUEST_LOG_LEVEL, _LOG_LEVEL_WARNING),
            Vendor(p.REQUEST_FLUSH),
            Read(p.MODULE_DVS, p.DVS_WIDTH, "sensor width", exactly=p.WIDTH),
            Read(p.MODULE_DVS, p.DVS_HEIGHT, "sensor height", exactly=p.HEIGHT),
            Read(p.MODULE_IMU, p.IMU_TYPE, "IMU type"),
        )
    return (
        Read(
            p.MODULE_SYSTEM,
            p.SYSTEM_LOGIC_VERSION,
            "logic version",
            exactly=p.LOGIC_VERSION,
            required=True,
        ),
        Read(
            p.MODULE_SYSTEM,
            p.SYSTEM_LOGIC_PATCH,
            "logic patch",
            at_least=p.LEAST_LOGIC_PATCH,
            required=True,
        ),
        Read(p.MODULE_SYSTEM, p.SYSTEM_CHIP, "chip id"),
        Read(p.MODULE_DVS, p.DVS_WIDTH, "sensor width", exactly=p.WIDTH),
        Read(p.MODULE_DVS, p.DVS_HEIGHT, "sensor height", exactly=p.HEIGHT),
        Read(p.MODULE_DVS, p.DVS_ORIENTATION, "sensor orientation"),
        Read(p.MODULE_IMU, p.IMU_TYPE, "IMU type"),
        Read(p.MODULE_IMU, p.IMU_ORIENTATION, "IMU orientation"),
    )


def configure(firmware: int, settings: SensorSettings, orientation: int = 0) -> Sequence[Step]:
    """What to send to set the sensor up.

    Parameters
    ----------
    firmware : int
        Low byte of bcdDevice.
    settings : SensorSettings
        What is wanted.
    orientation : int
        What the camera said of how its sensor is mounted: bit 1 columns, bit 0 rows reversed.
        Firmware 8 and 9 count the region of interest along the sensor.
    """
    if firmware >= p.FIRST_NEW_FIRMWARE:
        return _configure_new(settings)
    return _configure_old(settings, orientation)


def set_biases(firmware: int, settings: SensorSettings) -> Sequence[Step]:
    """What sets the biases alone, also while the camera streams."""
    if firmware >= p.FIRST_NEW_FIRMWARE:
        on, off = settings.thresholds
        return (
            Write(p.MODULE_DVS, p.DVS_THRESHOLD_ON, on),
            Write(p.MODULE_DVS, p.DVS_THRESHOLD_OFF, off),
        )
    return tuple(
        Write(p.MODULE_SENSOR, register, values[settings.bias_sensitivity])
        for register, values in p.SENSITIVITY.items()
    )


def _configure_new(settings: SensorSettings) -> Sequence[Step]:
    on, off = settings.thresholds
    x0, y0, x1, y1 = settings.region
    dvs = (
        (p.DVS_READOUT, p.READOUT_RATES[settings.readout_rate]),
        (p.DVS_THRESHOLD_ON, on),
        (p.DVS_THRESHOLD_OFF, off),
        (p.DVS_FLATTEN, settings.flatten_code),
        (p.DVS_SUBSAMPLE_X, 0),
        (p.DVS_SUBSAMPLE_Y, 0),
        (p.DVS_GLOBAL_HOLD, 1),
        (p.DVS_GLOBAL_RESET, 0),
        (p.DVS_RESET_SKIP, 0),
        (p.DVS_CROP_X, x0),
        (p.DVS_CROP_Y, y0),
        (p.DVS_CROP_WIDTH, x1 - x0 + 1),
        (p.DVS_CROP_HEIGHT, y1 - y0 + 1),
        (p.DVS_CROP_APPLY, 0),
        (p.DVS_MIPI_TIMEOUT_ENABLE, 1),
        (p.DVS_MIPI_TIMEOUT_US, 2000),
    )
    flip = Read(p.MODULE_DVS, p.DVS_ORIENTATION, "sensor orientation")
    # The vendor's values; the IMU is started with the sensor but its endpoint is never read.
    imu = ((5, 11), (7, 5), (6, 2), (8, 11), (10, 2), (9, 2))
    return (
        *(Write(p.MODULE_DVS, *pair) for pair in dvs),
        flip,
        Write(p.MODULE_DVS, p.DVS_FLIP_X, 0),
        Write(p.MODULE_DVS, p.DVS_CROP_APPLY, 0),
        flip,
        Write(p.MODULE_DVS, p.DVS_FLIP_Y, 0),
        Write(p.MODULE_DVS, p.DVS_CROP_APPLY, 0),
        *(Write(p.MODULE_IMU, *pair) for pair in imu),
    )


def _configure_old(settings: SensorSettings, orientation: int) -> Sequence[Step]:
    fixed = [(p.REG_BIAS_AMP, 0x04), (p.REG_BIAS_LOGALOGD, 0x14)]
    # Flatten codes 1, 2, 3 are bits 6, 5, 4.
    flatten = (0, 0x40, 0x20, 0x10)[settings.flatten_code]
    registers = [(p.REG_PACKET_FORMAT, p.PACKET_FORMAT_GROUPS | flatten)]
    registers += _crop_registers(settings, orientation)
    registers.append((p.REG_RESTART, 2))
    return (
        *(Write(p.MODULE_SENSOR, *pair) for pair in fixed),
        *set_biases(p.FIRST_NEW_FIRMWARE - 1, settings),
        *(Write(p.MODULE_SENSOR, *pair) for pair in registers),
    )


def _crop_registers(settings: SensorSettings, orientation: int) -> list[tuple[int, int]]:
    x0, y0, x1, y1 = settings.region
    if orientation & 2:
        x0, x1 = p.WIDTH - 1 - x1, p.WIDTH - 1 - x0
    if orientation & 1:
        y0, y1 = p.HEIGHT - 1 - y1, p.HEIGHT - 1 - y0
    start_mask, end_mask = (0xFF << (y0 % 8)) & 0xFF, 0xFF >> (7 - y1 % 8)
    if y0 // 8 == y1 // 8:
        # In one group of rows only the end's mask counts.
        start_mask, end_mask = 0xFF, start_mask & end_mask
    return [
        (p.REG_CROP_X_START, x0 >> 8),
        (p.REG_CROP_X_START + 1, x0 & 0xFF),
        (p.REG_CROP_X_END, x1 >> 8),
        (p.REG_CROP_X_END + 1, x1 & 0xFF),
        (p.REG_CROP_Y_START_GROUP, y0 // 8),
        (p.REG_CROP_Y_START_MASK, start_mask),
        (p.REG_CROP_Y_END_GROUP, y1 // 8),
        (p.REG_CROP_Y_END_MASK, end_mask),
        (p.REG_CROP_BYPASS, 0 if settings.roi_enabled else 1),
    ]


def before_reading(firmware: int) -> Sequence[Step]:
    """What to send before the first read waits on the data endpoint."""
    if firmware >= p.FIRST_NEW_FIRMWARE:
        return ()
    return (
        Write(p.MODULE_DVS, p.DVS_RUN, 0),
        *(Write(p.MODULE_IMU, run, 0) for run in p.IMU_RUN),
        Wait(0.01),
        ClearHalt(),
    )


def run(firmware: int) -> Sequence[Step]:
    """What to send once a read waits: the stream begins."""
    imu = tuple(Write(p.MODULE_IMU, run, 1) for run in p.IMU_RUN)
    if firmware >= p.FIRST_NEW_FIRMWARE:
        return (Write(p.MODULE_DVS, p.DVS_RUN, 1), *imu)
    return (
        *imu,
        Write(p.MODULE_SENSOR, p.REG_TIME_RESET, 1),
        Write(p.MODULE_SENSOR, p.REG_TIME_RESET, 0),
        Write(p.MODULE_SENSOR, p.REG_MODE, p.MODE_STREAM),
    )


def stop(firmware: int) -> Sequence[Step]:
    """What ends the stream."""
    quiet = (
        Write(p.MODULE_DVS, p.DVS_RUN, 0),
        *(Write(p.MODULE_IMU, run, 0) for run in p.IMU_RUN),
    )
    if firmware >= p.FIRST_NEW_FIRMWARE:
        return quiet
    return (Write(p.MODULE_SENSOR, p.REG_MODE, p.MODE_OFF), *quiet)
