"""All gauges of edge drift, and what some of them don't tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from roller_emvs.methods.surface import SurfaceSettings

from .gauge import Gauge, OtherGaugeError
from .pass_lines import EdgeDriftError
from .recordings import Scan
from .sphere_gauges import sphere_gauges
from .step_gauges import steps_gauges


def all_gauges(
    spheres: Sequence[Scan],
    steps: Sequence[Scan],
    settings: SurfaceSettings,
    radius_m: float,
    step_m: float,
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[list[Gauge], list[EdgeDriftError]]:
    """Gauges of all recordings, and why some tell nothing. Steps alone will do.

    Raises
    ------
    OtherGaugeError
        If a gauge has another size, and none of its kind the stated one.
    EdgeDriftError
        If no recording of steps tells anything.
    """
    found: list[Gauge] = []
    left_out: list[EdgeDriftError] = []
    done = 0
    for scans, measure, size_m in (
        (spheres, sphere_gauges, radius_m),
        (steps, steps_gauges, step_m),
    ):
        own: list[Gauge] = []
        other: OtherGaugeError | None = None
        for scan in scans:
            try:
                own += measure(scan, settings, size_m)
            except EdgeDriftError as reason:
                left_out.append(reason)
                other = reason if isinstance(reason, OtherGaugeError) else other
            done += 1
            progress(done / (len(spheres) + len(steps)))
        # Where one fits the stated size is right, and drift larger than the gauge hides the rest.
        if other is not None and not own:
            raise other
        found += own
    # Edges drift further on a sphere, which bends little, than on walls: alone it would do harm.
    if not found or (steps and all(gauge.sphere for gauge in found)):
        raise EdgeDriftError("; ".join(map(str, left_out)))
    return found, left_out
