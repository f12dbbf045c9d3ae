"""Edge drift on a sphere of known radius: the true height of a line follows from its place.

A line's place along the roll is right whatever its height. Drift moves the sphere's middle as well,
and what delays events; rolled over to and fro they move it both ways, and it is known.
"""

from __future__ import annotations

import numpy as np

from roller_emvs.methods.surface import SurfaceSettings

from .constant_speed import rolling_speed_m_s
from .gauge import (
    LEAST_LINES,
    OTHER_SIZE,
    Gauge,
    OtherGaugeError,
    of_lines_or_depths,
    size_text,
    take,
)
from .pass_lines import EdgeDriftError, PassLines
from .recordings import Scan
from .sphere import OtherRadiusError, Sphere, SphereError, find_sphere

#: Spread of where the sphere's middle is along the roll after a pass one way, and to and fro, m;
#: of the events' delay before and after it was calibrated, s.
_MIDDLE_M, _BOTH_WAYS_M = 1.5e-4, 2e-5
_DELAY_S, _CALIBRATED_DELAY_S = 5e-4, 3e-5


def sphere_gauges(scan: Scan, settings: SurfaceSettings, radius_m: float) -> list[Gauge]:
    """Errors of the lines on a sphere of known radius, by pass.

    Raises
    ------
    EdgeDriftError
        If the sphere can't be found, or shows too few lines.
    """
    delay_s = _CALIBRATED_DELAY_S if settings.event_delay_s else _DELAY_S

    def measure(passes: list[PassLines]) -> list[Gauge]:
        try:
            sphere = find_sphere(passes[0].cloud, passes[0].axes[:, 2], radius_m, OTHER_SIZE)
        except SphereError as reason:
            kind = OtherGaugeError if isinstance(reason, OtherRadiusError) else EdgeDriftError
            raise kind(f"{scan.name}: {reason}") from reason
        middle = (
            _MIDDLE_M
            if len(passes) == 1
            else np.hypot(_BOTH_WAYS_M, delay_s * rolling_speed_m_s(scan.track))
        )
        return [_on_sphere(scan.name, own, sphere, float(middle)) for own in passes]

    return of_lines_or_depths(scan, settings, measure)


def _on_sphere(name: str, found: PassLines, sphere: Sphere, middle_m: float) -> Gauge:
    radius_m = sphere.radius_m
    away = found.place - sphere.centre_m @ found.axes
    rho = np.hypot(away[:, 0], away[:, 1])
    inside = rho < sphere.contact_radius_m
    if inside.sum() < LEAST_LINES:
        raise EdgeDriftError(
            f"{name}: {int(inside.sum())} {found.kind} on the sphere, fewer than {LEAST_LINES}: "
            "too little of it is in view, or its skin shows too little"
        )
    away, rho = away[inside], rho[inside]
    below = np.sqrt(radius_m**2 - rho**2)
    error = away[:, 2] - below
    unknown = np.column_stack([away[:, :2] / below[:, None], np.ones(len(below))])
    # Steep and stray lines are of the sphere's foot.
    near = np.abs(error - np.median(error)) < max(0.1 * radius_m, 4e-4)
    text = (
        f"sphere of {size_text(sphere.fitted_radius_m, radius_m, '--radius-mm', sphere.odd)}, "
        f"{int(near.sum())} {found.kind} within "
        f"{sphere.contact_radius_m * 1e3:.2f} mm of its top"
    )
    spread = np.array([middle_m, 1e-3, 1e-3])
    return Gauge(
        name, error[near], unknown[near], spread, take(take(found.lines, inside), near),
        -(away[:, 0] / below)[near], True, text, found.travel,
    )  # fmt: skip
