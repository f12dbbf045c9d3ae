"""What a pass over a gauge of known size gave: a sphere, equal steps, a plane."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from roller_core.errors import RollerError
from roller_core.transforms import F64
from roller_emvs.methods.surface import SurfaceSettings

from .dome_candidates import cell_medians
from .flat import CELL_M, find_plate
from .gauge import LEAST_LINES, OTHER_SIZE
from .pass_lines import WALL_SLOPE, Found, is_printed, passes_of, swept
from .recordings import Scan
from .sphere import find_sphere
from .step_profile import find_profile, printed_profile

#: Cells in which it is counted what of a sphere was seen, by its radius; of a wall, and of a plane,
#: m.
_SPHERE_CELLS, _WALL_CELL_M, _FINE_M = 12, 2e-4, 1e-4
#: Share of a plane's cells that its flatness is of.
_FLAT_SHARE = 0.95


class GaugeError(RollerError):
    """A pass in which a gauge can't be found."""


@dataclass(frozen=True)
class Reached:
    """What a pass over a gauge gave."""

    #: Mean error of the points, metres.
    error_m: float
    #: What the gauge as a whole is off by, metres: a sphere's fitted radius, the height of a step;
    #: of a plane the band that holds 95 % of cells of half a millimetre.
    form_m: float
    #: Share of the sphere's contact circle, of the walls, or of the plane with points.
    coverage: float
    #: Share of the points whose error lies within twice their uncertainty.
    within: float
    #: Points on the gauge.
    points: int
    #: Of a sphere the radius that fits it, and how far from the top points tell it, metres.
    radius_m: float | None = None
    within_m: float | None = None
    #: Whether the skin's texture shows, so that edges lie everywhere.
    printed: bool = False


@dataclass(frozen=True)
class _Swept:
    """Points in base with their uncertainty, and what they were found by."""

    points: F64
    sigma: F64
    lines: Found
    printed: bool


def _sweep(scan: Scan, settings: SurfaceSettings, depths: Found | None = None) -> _Swept:
    """A pass over a gauge; a list takes the depths of neighbourhoods too."""
    found, lines = swept(scan, settings, depths)
    if not found:
        raise GaugeError(f"{scan.name}: no points at all")
    points = np.concatenate([patch.points for patch in found])
    sigma = np.concatenate([patch.sigma for patch in found])
    return _Swept(points, sigma, lines, is_printed(found))


def on_sphere(scan: Scan, settings: SurfaceSettings, radius_m: float) -> Reached:
    """Figures of a pass over a sphere of known radius, its place fitted.

    Raises
    ------
    RollerError
        If there is no such sphere in view.
    """
    found = _sweep(scan, settings)
    points, sigma = found.points, found.sigma
    # How far off its radius may be, light decides: see `acceptance`.
    sphere = find_sphere(points, -_middle_pose(scan)[:3, 2], radius_m, OTHER_SIZE)
    away = points - sphere.centre_m
    along = away @ sphere.towards
    across = away - along[:, None] * sphere.towards
    inside = (np.linalg.norm(across, axis=1) < sphere.contact_radius_m) & (along > 0)
    error = np.abs(np.linalg.norm(away[inside], axis=1) - radius_m)
    # Cells of the plane that touches the top; the sphere's own axes turn nothing.
    plane = np.linalg.svd(sphere.towards[None])[2][1:]
    step = radius_m / _SPHERE_CELLS
    circle = np.pi * (sphere.contact_radius_m / step) ** 2
    seen = _cells(across[inside] @ plane.T, step) / circle
    fitted_m = sphere.fitted_radius_m
    reached = _reached(error, sigma[inside], abs(fitted_m - radius_m), seen, found.printed)
    return replace(reached, radius_m=fitted_m, within_m=sphere.fitted_within_m)


def on_steps(scan: Scan, settings: SurfaceSettings, step_m: float) -> Reached:
    """Figures of a pass over equal steps up and down, their place fitted.

    Errors are distances from the steps' profile; within 0.15 mm of a wall any height of it is
    right.

    Raises
    ------
    RollerError
        If there are no such steps in view.
    """
    depths: Found = []
    found = _sweep(scan, settings, depths)
    points, sigma = found.points, found.sigma
    passes = passes_of(scan.name, found.lines)
    steep = np.abs(passes[0].lines.slope) > WALL_SLOPE if passes else np.zeros(0, bool)
    if steep.sum() < LEAST_LINES:
        raise GaugeError(
            f"{scan.name}: {int(steep.sum())} lines on slopes along the roll, fewer than "
            f"{LEAST_LINES}: no steps in view"
        )
    axes = passes[0].axes
    local = points @ axes
    if found.printed and depths:
        places = np.concatenate([place for place, _, _ in depths]) @ axes
        sigma_m = np.concatenate([own.sigma_m for _, _, own in depths])
        profile = printed_profile(places, sigma_m, local, step_m)
    else:
        profile = find_profile(passes[0], local, step_m)
    if profile is None:
        raise GaugeError(f"{scan.name}: no walls of steps across the roll, or a single one")
    count, fitted_m, near, on = profile.count, profile.fitted_m, profile.near, profile.on
    if not np.isfinite(fitted_m):
        raise GaugeError(
            f"{scan.name}: {count} walls don't tell the steps' height: record two steps or more "
            "up, or two down"
        )
    if abs(fitted_m / step_m - 1) > OTHER_SIZE:
        raise GaugeError(
            f"{scan.name}: {count} walls fit steps of {fitted_m * 1e3:.3f} mm, not "
            f"{step_m * 1e3:g} mm; are these the steps, and is --step-mm right?"
        )
    if profile.apart > 1:
        raise GaugeError(
            f"{scan.name}: most of {count} walls lie {profile.apart} steps of {step_m * 1e3:g} mm "
            "above the one before: are the steps higher, and is --step-mm right?"
        )
    y = local[near, 1] / _WALL_CELL_M
    seen = _cells(np.column_stack([profile.nearest, y])[on], 1.0)
    share = seen / (count * np.ptp(np.quantile(y, [0.02, 0.98])))
    return _reached(profile.error_m, sigma[near], abs(fitted_m - step_m), share, found.printed)


def on_plane(scan: Scan, settings: SurfaceSettings, _size_m: float = 0.0) -> Reached:
    """Figures of a pass over a flat plate, its plane fitted.

    Raises
    ------
    RollerError
        If what is in view is not flat.
    """
    found = _sweep(scan, settings)
    points, sigma = found.points, found.sigma
    pose = _middle_pose(scan)
    plate = find_plate(points, pose, scan.camera)
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    lean = np.tan(np.radians(plate.tilt_deg))
    error = local[:, 2] - plate.depth_m - local[:, :2] @ lean
    cells = cell_medians(np.column_stack([local[:, :2], error]), CELL_M)[:, 2]
    rest = 0.5 * (1 - _FLAT_SHARE)
    flatness = float(np.ptp(np.quantile(cells, [rest, 1 - rest])))
    seen = _cells(local[:, :2], _FINE_M) / (len(cells) * (CELL_M / _FINE_M) ** 2)
    return _reached(np.abs(error), sigma, flatness, seen, found.printed)


@dataclass(frozen=True)
class GaugeKind:
    """A gauge: how it is measured, and what its form is called."""

    measure: Callable[[Scan, SurfaceSettings, float], Reached]
    form: str


GAUGES = {
    "sphere": GaugeKind(on_sphere, "radius off"),
    "steps": GaugeKind(on_steps, "height of a step off"),
    "plate": GaugeKind(on_plane, "flatness"),
}


def _middle_pose(scan: Scan) -> F64:
    """Camera in base in the middle of a pass."""
    middle_ns = int(scan.track.times_ns[len(scan.track) // 2])
    return np.asarray(scan.track.matrices([middle_ns])[0])


def _cells(places: F64, step: float) -> int:
    """How many cells of a grid hold places."""
    return len(np.unique(np.floor(places / step).astype(np.int64), axis=0))


def _reached(error: F64, sigma: F64, form_m: float, seen: float, printed: bool) -> Reached:
    within, mean = float((error <= 2 * sigma).mean()), float(error.mean())
    return Reached(mean, float(form_m), min(float(seen), 1.0), within, len(error), printed=printed)
