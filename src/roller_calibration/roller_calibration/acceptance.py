"""What a cell reaches on known gauges, against what the virtual cell promises for its own.

Both go the same way, from the events of a pass over a gauge to figures; no truth is read. What
the virtual cell can't know, such as the cell's own light and robot, isn't in the promise.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from roller_core.progress import progress_bar
from roller_emvs.methods.surface import SurfaceSettings
from roller_recording.reading import open_recording
from roller_sim.bag import write_bag
from roller_sim.cell import VirtualCell
from roller_sim.cell_settings import VirtualCellSettings
from roller_sim.objects import SPHERE_RADIUS, STAIR_RISE
from roller_sim.presets import COATINGS, LIGHTS

from .constant_speed import rolling_speed_m_s
from .reached import GAUGES, Reached
from .recordings import Scan, whole_scan
from .sphere import SEEMING_FALL_M, seeming_radii

#: A cell may err so many times as much as the virtual one, and this much more, m; and see this
#: share of what that sees. Errors must lie within twice their uncertainty in this share of points.
_TIMES, _MORE_M, _SEES, _WITHIN = 1.5, 1e-5, 0.8, 0.8
#: The form of the whole, one figure a pass, may be off by so much more, m.
_MORE_FORM_M = {"steps": 2.5e-5, "plate": 2.5e-5}
#: How much further than the stated sphere one may fall to the edge of its contact, m, by light, and
#: with a calibration of edge drift: drift makes spheres seem rounder. Measured on the virtual cell,
#: radii of 3 to 10 mm at 0.1 to 0.5 m/s, both coatings: -27 to 19 µm in dome light, 2 to 83 and -23
#: to 110 under the ring with a calibration and without, 4 to 120 and -12 to 140 in strong light.
_FALL_M = {
    ("dome", True): (-6e-5, 6e-5), ("dome", False): (-6e-5, 6e-5),
    ("ring", True): (-2e-5, 1.05e-4), ("ring", False): (-4.5e-5, 1.35e-4),
    ("strong", True): (-2.5e-5, 1.45e-4), ("strong", False): SEEMING_FALL_M,
}  # fmt: skip


@dataclass(frozen=True)
class Promise:
    """How the virtual cell makes a promise: its scene and coating, and the gauge's size, m."""

    scene: str
    size_m: float
    coating: str = "plain"


#: By gauge. A plate shows nothing but what is printed on the skin.
PROMISES = {
    "sphere": Promise("sphere", SPHERE_RADIUS * 1e-3),
    "steps": Promise("stairs", STAIR_RISE * 1e-3),
    "plate": Promise("flat", 0.0, "textured"),
}


@dataclass(frozen=True)
class Limits:
    """What is accepted: errors at most, metres, and shares at least; None: not judged."""

    error_m: float
    form_m: float | None
    coverage: float
    within: float = _WITHIN
    #: The least and the largest radius that a sphere may seem to have, metres.
    radius_m: tuple[float, float] | None = None


def limits(gauge: str, promise: Reached, radius_m: tuple[float, float] | None = None) -> Limits:
    """What a cell must reach on a gauge of which the virtual one promises so much."""
    more_m = _MORE_FORM_M.get(gauge)
    form_m = None if more_m is None else _TIMES * promise.form_m + more_m
    return Limits(
        _TIMES * promise.error_m + _MORE_M, form_m, _SEES * promise.coverage, radius_m=radius_m
    )


def accepted_radii(
    radius_m: float, reached: Reached, light: str, calibrated: bool
) -> tuple[float, float] | None:
    """The least and the largest radius that a sphere may seem to have, metres; None: no sphere.

    Light that travels bends a sphere, and how much isn't known: the range says how well the radius
    is judged.
    """
    if reached.within_m is None:
        return None
    return seeming_radii(radius_m, reached.within_m, _FALL_M[light, calibrated])


def promised(gauge: str, scan: Scan, light: str, printed: bool = False) -> Reached:
    """What the virtual cell reaches on its own gauge with the scan's camera and speed.

    Under a printed skin if the scan's is.

    Raises
    ------
    RollerError
        If the virtual cell doesn't show its gauge to this camera.
    """
    camera, own = scan.camera, PROMISES[gauge]
    lit, coating = LIGHTS[light], "textured" if printed else own.coating
    settings = VirtualCellSettings.create(
        {
            **lit,
            "light": {**lit.get("light", {}), **COATINGS[coating].get("light", {})},
            "scene": {"name": own.scene},
            "motion": {"speed": round(max(rolling_speed_m_s(scan.track), 0.02), 3)},
            "camera": {
                "width": camera.width, "height": camera.height, "focal_px": camera.fx,
                "principal_point_px": [max(camera.cx, 0.0), max(camera.cy, 0.0)],
            },
            "clock": {"image_rate_hz": 0.0},
        }
    )  # fmt: skip
    with TemporaryDirectory(prefix="roller_promise_") as folder:
        bag = Path(folder) / own.scene
        with progress_bar(f"simulate the {gauge}") as progress:
            write_bag(VirtualCell(settings), bag, progress)
        virtual = whole_scan(open_recording(bag))
    return GAUGES[gauge].measure(virtual, SurfaceSettings.create({}), own.size_m)


def shortfalls(gauge: str, reached: Reached, least: Limits) -> Iterable[str]:
    """What keeps a cell from being accepted, in words."""
    form = GAUGES[gauge].form
    for what, errs_m, most_m in (
        (f"on the {gauge} errors are", reached.error_m, least.error_m),
        (f"the {gauge}: {form}", reached.form_m, least.form_m),
    ):
        if most_m is not None and errs_m > most_m:
            yield f"{what} {errs_m * 1e6:.0f} µm, at most {most_m * 1e6:.0f} are accepted"
    if reached.radius_m is not None and least.radius_m is not None:
        low_m, high_m = least.radius_m
        if not low_m <= reached.radius_m <= high_m:
            yield (
                f"the {gauge} fits a radius of {reached.radius_m * 1e3:.2f} mm, {low_m * 1e3:.2f} "
                f"to {high_m * 1e3:.2f} are accepted; is --radius-mm right?"
            )
    if reached.coverage < least.coverage:
        yield (
            f"{reached.coverage:.0%} of the {gauge} seen, at least {least.coverage:.0%} are "
            "expected"
        )
    if reached.within < least.within:
        yield (
            f"{reached.within:.0%} of the errors on the {gauge} lie within twice their "
            f"uncertainty, at least {least.within:.0%} are expected"
        )


def golden_shortfalls(inspection: Mapping[str, Any]) -> Iterable[str]:
    """The same of an inspection of a good part against its golden reference."""
    reference = (inspection.get("reference") or {}).get("kind")
    if reference != "golden":
        yield f"golden scan: inspected against '{reference}', not against a golden reference"
    elif inspection.get("verdict") != "conform":
        yield f"golden scan: {inspection.get('verdict')}: {inspection.get('reason')}"
