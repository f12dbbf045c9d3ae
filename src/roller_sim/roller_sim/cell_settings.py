"""All settings of the virtual cell, with their ranges."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field

from roller_core.settings import Settings

DefectKind = Literal[
    "dent", "crater", "scratch", "raised", "missing", "extra", "rivet_flush", "rivet_bent"
]
_Depth = Annotated[float, Field(ge=0.01, le=1.5)]
_Width = Annotated[float, Field(ge=0.1, le=3.0)]


class SceneSettings(Settings):
    """Which plate is rolled over."""

    name: str = Field("demo", description="Scene by name, or mesh:FILE.stl.")
    text: str = Field("", description="Text of Braille and letter plates; empty: the scene's own.")
    step_mm: float = Field(0.02, ge=0.005, le=0.1, description="Grid step of the height map, mm.")
    width_mm: float = Field(23.0, ge=4.0, le=60.0, description="Width of the plate, mm.")
    margin_mm: float = Field(
        8.0,
        ge=0.0,
        le=100.0,
        description="Flat plate before the first and after the last object, mm.",
    )
    length_mm: float = Field(
        0.0,
        ge=0.0,
        le=2000.0,
        description="Least length of the plate, mm; 0: as its objects need. A longer one is rolled "
        "over to its end.",
    )
    dot_height_mm: float = Field(0.48, ge=0.05, le=1.5, description="Braille: height of a dot, mm.")
    turn_deg: float = Field(
        0.0, ge=-360.0, le=360.0, description="Braille: turn of the text on the plate, degrees."
    )
    seed: int = Field(1, ge=0, le=2**31 - 1, description="Seed of defects: sizes and places.")
    defects: int = Field(12, ge=1, le=600, description="Defects on the plate `defects`.")
    defect_kinds: list[DefectKind] = Field(
        default_factory=lambda: list(get_args(DefectKind)),
        min_length=1,
        description="Kinds of defects, of " + ", ".join(get_args(DefectKind)) + ".",
    )
    defect_depths_mm: list[_Depth] = Field(
        default_factory=lambda: [0.05, 0.1, 0.2, 0.4],
        min_length=1,
        description="Depths (or heights) of defects, mm.",
    )
    defect_widths_mm: list[_Width] = Field(
        default_factory=lambda: [1.0, 2.0, 3.0],
        min_length=1,
        description="Widths of defects, mm; scratches are a third as wide and 4 mm long.",
    )
    mesh_unit: Literal["mm", "m"] = Field("mm", description="Unit of a mesh's coordinates.")


class CameraSettings(Settings):
    """The camera inside the roller, and the roller."""

    width: int = Field(640, ge=8, le=2047, description="Columns, px.")
    height: int = Field(480, ge=8, le=2047, description="Rows, px.")
    focal_px: float = Field(1066.0, ge=50.0, le=10000.0, description="Focal length, px.")
    principal_point_px: list[float] = Field(
        default_factory=lambda: [-1.0, -1.0],
        min_length=2,
        max_length=2,
        description="Principal point, px; -1: the middle.",
    )
    distortion: list[float] = Field(
        default_factory=lambda: [0.0] * 5,
        min_length=5,
        max_length=5,
        description="Plumb_bob coefficients k1 k2 p1 p2 k3.",
    )
    roller_radius_mm: float = Field(47.0, ge=10.0, le=200.0, description="Radius of the skin, mm.")


class SkinSettings(Settings):
    """How the elastomer follows the relief."""

    contact: Literal["light", "medium", "full"] = Field(
        "full", description="How hard it is pressed."
    )
    press_mm: float = Field(
        0.0, ge=0.0, le=4.5, description="Press depth at full contact, mm; 0: the scene's own."
    )


class LightSettings(Settings):
    """Light and coating."""

    kind: Literal["ring", "dome", "strong"] = Field(
        "ring",
        description="ring: LEDs that travel with the camera; strong: the same with less scattered "
        "light and a narrower lobe; dome: diffuse light that doesn't travel: brightness depends on "
        "the slope alone.",
    )
    speckle: float = Field(0.03, ge=0.0, le=0.3, description="RMS of the coating's reflectance.")
    speckle_mm: float = Field(0.1, ge=0.01, le=2.0, description="Correlation length of it, mm.")


class SensorSettings(Settings):
    """The event sensor."""

    threshold: float = Field(
        0.22, ge=0.01, le=2.0, description="Contrast threshold, log intensity."
    )
    threshold_spread: float = Field(
        0.03, ge=0.0, le=0.2, description="Fixed spread of the threshold from pixel to pixel."
    )
    bandwidth_hz: float = Field(2000.0, ge=0.0, le=1e6, description="Pixel's low pass; 0: none.")
    refractory_us: float = Field(100.0, ge=0.0, le=1e5, description="Dead time of a pixel, µs.")
    background_hz: float = Field(
        0.3, ge=0.0, le=1000.0, description="Noise events a pixel and second."
    )
    hot_share: float = Field(1e-4, ge=0.0, le=0.1, description="Share of hot pixels.")
    latency_us: float = Field(100.0, ge=0.0, le=1e4, description="Pixel's delay, µs.")
    jitter_us: float = Field(20.0, ge=0.0, le=1e3, description="Its RMS spread, µs.")
    readout_us: float = Field(
        200.0, ge=0.0, le=1e4, description="Time of a read-out frame, µs; 0: no frames."
    )
    rate_cap_mev_s: float = Field(
        165.0, ge=0.0, le=1e4, description="Most events read out, 10^6/s; 0: no cap."
    )


class MotionSettings(Settings):
    """How the robot rolls."""

    speed: float = Field(0.3, ge=0.001, le=2.0, description="Speed of the scan, m/s.")
    acceleration: float = Field(15.0, ge=0.05, le=100.0, description="Of the ramps, m/s².")
    hold_s: float = Field(0.1, ge=0.0, le=10.0, description="Standstill before and after, s.")
    reverse: bool = Field(False, description="Roll back to the start afterwards.")
    start_mm: float | None = Field(None, description="Camera's x where full speed begins, mm.")
    end_mm: float | None = Field(None, description="Camera's x where full speed ends, mm.")
    vibration_um: float = Field(
        3.0, ge=0.0, le=500.0, description="RMS of the arm's vibration, µm."
    )
    plate_origin_m: list[float] = Field(
        default_factory=lambda: [0.0, 0.0, 0.0],
        min_length=3,
        max_length=3,
        description="The plate's corner point in base, m.",
    )


class ClockSettings(Settings):
    """Clocks, poses and arrival times."""

    drift_ppm: float = Field(15.0, ge=-200.0, le=200.0, description="Sensor clock's rate error.")
    pose_rate_hz: float = Field(125.0, ge=5.0, le=1000.0, description="Poses a second.")
    pose_offset_us: float = Field(0.0, ge=-1e5, le=1e5, description="Error of all pose stamps, µs.")
    pose_jitter_us: float = Field(
        30.0, ge=0.0, le=1e4, description="RMS error of a pose stamp, µs."
    )
    pose_noise_um: float = Field(
        2.0, ge=0.0, le=500.0, description="RMS noise of positions, µm; of rotations 2.5 µrad a µm."
    )
    image_rate_hz: float = Field(25.0, ge=0.0, le=200.0, description="Intensity images a second.")


class PacketSettings(Settings):
    """How events are packed."""

    encoding: Literal["mono", "libcaer", "libcaer_cmp", "evt3"] = Field(
        "libcaer_cmp", description="Encoding of event packets."
    )


class VirtualCellSettings(Settings):
    """Everything that, with the seed, decides what the virtual cell gives."""

    seed: int = Field(1, ge=0, le=2**31 - 1, description="Seed of all chance.")
    threads: int = Field(
        0, ge=0, le=64, description="Threads; 0: all cores (results don't depend)."
    )
    scene: SceneSettings = SceneSettings.create({})
    camera: CameraSettings = CameraSettings.create({})
    skin: SkinSettings = SkinSettings.create({})
    light: LightSettings = LightSettings.create({})
    sensor: SensorSettings = SensorSettings.create({})
    motion: MotionSettings = MotionSettings.create({})
    clock: ClockSettings = ClockSettings.create({})
    packets: PacketSettings = PacketSettings.create({})
