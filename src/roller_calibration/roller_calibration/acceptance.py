"""What a cell reaches on a known sphere, against what the virtual cell promises for its own.

Both go the same way, from the events of a pass over a sphere to figures; no truth is read. What
the virtual cell can't know, such as the cell's own light and robot, isn't in the promise.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from roller_emvs.methods.surface import SurfaceSettings, SurfaceSweep
from roller_emvs.methods.surface.sweep import SurfacePatch
from roller_recording.reading import open_recording
from roller_sim.bag import write_bag
from roller_sim.cell import VirtualCell
from roller_sim.cell_settings import VirtualCellSettings
from roller_sim.objects import SPHERE_RADIUS
from roller_sim.presets import LIGHTS

from .constant_speed import rolling_speed_m_s
from .recordings import Scan, whole_scan
from .sphere import SphereError, find_sphere

#: A cell may err so many times as much as the virtual one, and this much more, m; and see this
#: share of what that sees. Errors must lie within twice their uncertainty in this share of points.
_TIMES, _MORE_M, _SEES, _WITHIN = 1.5, 1e-5, 0.8, 0.8
#: Cells in which it is counted what of a sphere was seen, by its radius.
_CELLS = 12


@dataclass(frozen=True)
class Reached:
    """What a pass over a part gave.

    Attributes
    ----------
    error_m : float
        Mean error of the points, metres.
    coverage : float
        Share of the sphere's contact circle with points.
    within : float
        Share of the points whose error lies within twice their uncertainty.
    points : int
        Points on the sphere.
    """

    error_m: float
    coverage: float
    within: float
    points: int


def on_sphere(scan: Scan, settings: SurfaceSettings, radius_m: float) -> Reached:
    """Figures of a pass over a sphere of known radius, its place fitted.

    Raises
    ------
    SphereError
        If there is no such sphere in view.
    """
    sweep = SurfaceSweep(settings, scan.camera, scan.track)
    sweep.add_events(scan.events)
    found = [r for r in sweep.results(flush=True) if isinstance(r, SurfacePatch) and len(r)]
    if not found:
        raise SphereError(f"{scan.name}: no points at all")
    points = np.concatenate([patch.points for patch in found])
    sigma = np.concatenate([patch.sigma for patch in found])
    middle_ns = int(scan.track.times_ns[len(scan.track) // 2])
    towards = -scan.track.matrices([middle_ns])[0][:3, 2]
    sphere = find_sphere(points, towards, radius_m)
    away = points - sphere.centre_m
    along = away @ sphere.towards
    across = away - along[:, None] * sphere.towards
    inside = (np.linalg.norm(across, axis=1) < sphere.contact_radius_m) & (along > 0)
    error = np.abs(np.linalg.norm(away[inside], axis=1) - radius_m)
    # Cells of the plane that touches the top; the sphere's own axes turn nothing.
    plane = np.linalg.svd(sphere.towards[None])[2][1:]
    step = radius_m / _CELLS
    seen = {tuple(c) for c in np.floor(across[inside] @ plane.T / step).astype(int).tolist()}
    circle = np.pi * (sphere.contact_radius_m / step) ** 2
    return Reached(
        float(error.mean()),
        min(len(seen) / circle, 1.0),
        float((error <= 2 * sigma[inside]).mean()),
        int(inside.sum()),
    )


def promised(scan: Scan, light: str) -> Reached:
    """What the virtual cell reaches on its sphere with the scan's camera and speed.

    Raises
    ------
    RollerError
        If the virtual cell doesn't show its sphere to this camera.
    """
    camera = scan.camera
    settings = VirtualCellSettings.create(
        {
            **LIGHTS[light],
            "scene": {"name": "sphere"},
            "motion": {"speed": round(max(rolling_speed_m_s(scan.track), 0.02), 3)},
            "camera": {
                "width": camera.width, "height": camera.height, "focal_px": camera.fx,
                "principal_point_px": [max(camera.cx, 0.0), max(camera.cy, 0.0)],
            },
            "clock": {"image_rate_hz": 0.0},
        }
    )  # fmt: skip
    with TemporaryDirectory(prefix="roller_promise_") as folder:
        bag = Path(folder) / "sphere"
        write_bag(VirtualCell(settings), bag)
        virtual = whole_scan(open_recording(bag))
    return on_sphere(virtual, SurfaceSettings.create({}), SPHERE_RADIUS * 1e-3)


def shortfalls(reached: Reached, promise: Reached) -> Iterable[str]:
    """What keeps a cell from being accepted, in words."""
    errs_um, most_um = reached.error_m * 1e6, (_TIMES * promise.error_m + _MORE_M) * 1e6
    if errs_um > most_um:
        yield f"the sphere errs {errs_um:.0f} µm, at most {most_um:.0f} are accepted"
    least = _SEES * promise.coverage
    if reached.coverage < least:
        yield f"{reached.coverage:.0%} of the sphere was seen, at least {least:.0%} are expected"
    if reached.within < _WITHIN:
        yield (
            f"{reached.within:.0%} of the errors lie within twice their uncertainty, at least "
            f"{_WITHIN:.0%} are expected"
        )


def golden_shortfalls(inspection: Mapping[str, Any]) -> Iterable[str]:
    """The same of an inspection of a good part against its golden reference."""
    reference = (inspection.get("reference") or {}).get("kind")
    if reference != "golden":
        yield f"golden scan: inspected against '{reference}', not against a golden reference"
    elif inspection.get("verdict") != "conform":
        yield f"golden scan: {inspection.get('verdict')}: {inspection.get('reason')}"
