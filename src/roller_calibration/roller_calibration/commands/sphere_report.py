"""What `calibrate sphere` reports."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from roller_calibration.contact import ContactWindow
from roller_calibration.gauge import size_text
from roller_calibration.parameter_choice import LEAST_GAIN, ParameterChoice
from roller_calibration.recordings import Scan
from roller_calibration.scale import PAPER_MM_PER_PX, check_scale
from roller_calibration.sphere import Sphere


def _middle(windows: Sequence[ContactWindow], scan: Scan) -> ContactWindow:
    """The window of a pass that has the contact circle nearest to the middle of the image."""
    own = [w for w in windows if w.name == scan.name]
    return min(own, key=lambda w: abs(w.view.centre_px[0] - scan.camera.cx))


def describe_spheres(
    passes: Sequence[Scan],
    spheres: Sequence[Sphere],
    windows: Sequence[ContactWindow],
    args: argparse.Namespace,
) -> list[str]:
    """Lines about the spheres; refuses a scale that contradicts the camera."""
    lines = []
    for scan, sphere in zip(passes, spheres, strict=True):
        view = _middle(windows, scan).view
        count = sum(w.name == scan.name for w in windows)
        lines.append(
            f"{scan.name}: contact circle of {sphere.contact_radius_m * 1e3:.2f} mm "
            f"({view.radius_px:.1f} px) about ({view.centre_px[0]:.0f}, {view.centre_px[1]:.0f}) "
            f"px, {count} window{'s' * (count > 1)}; the depths fit a radius of "
            f"{size_text(sphere.fitted_radius_m, sphere.radius_m, '--radius-mm', sphere.odd)} "
            f"and lie {sphere.scatter_m * 1e6:.0f} µm off the sphere at the median"
        )
        own = view.plane_m * 1e3 / scan.camera.fx
        given = args.scale_mm_per_px
        off = (
            PAPER_MM_PER_PX / own - 1
            if given is None
            else check_scale(given, view.plane_m, scan.camera.fx)
        )
        lines.append(
            f"{scan.name}: {own:.4f} mm/px at the contact circle, {view.plane_m * 1e3:.2f} mm "
            f"away; {given or PAPER_MM_PER_PX:g} {'as given' if given else 'of the paper'} is "
            f"{off:+.1%} off"
        )
    return lines


def describe_choice(choice: ParameterChoice, groups: str) -> list[str]:
    """Lines about the parameters before and after, and how far the choice holds elsewhere.

    `groups`: what was held out, recordings or windows.
    """
    lines = []
    if choice.stays:
        lines.append(f"no choice of the grid is better by {LEAST_GAIN:.1%}: the parameters stay")
    lines += [
        f"before: {_named(choice.old)}: {choice.before}",
        f"after:  {_named(choice.values)}: {choice.after}",
        "(mean absolute error of measured pixels within the contact circle; at least "
        f"{choice.least_coverage:.1%} of it must be measured)",
    ]
    if choice.held_out is not None:
        lines.append(f"held out: {choice.held_out} on {groups} that had no say in the choice")
        if choice.held_out.error_m >= choice.before.error_m and choice.values != choice.old:
            lines.append("that is no better than before: more passes would make the choice firmer")
    return lines + [f"{name} is at the end of its range" for name in choice.border]


def describe_changes(
    previous: dict[str, Any],
    args: argparse.Namespace,
    choice: ParameterChoice,
) -> list[str]:
    """How far parameters and error moved since an earlier calibration."""
    lines = [f"since {previous.get('date', '?')} ({args.previous.name}):"]
    skin = previous.get("skin", "")
    if skin != args.skin:
        lines.append(f"  another skin: '{skin}' then, '{args.skin}' now")
    for name, value in choice.values.items():
        lines.append(f"  {name}: {_text(choice.old[name])} -> {_text(value)}")
    then = previous.get("after")
    if isinstance(then, dict) and {"error_m", "coverage"} <= then.keys():
        lines.append(
            f"  its parameters had {then['error_m'] * 1e6:.1f} µm at {then['coverage']:.1%} then, "
            f"{choice.before} now; calibrated again {choice.after}"
        )
    return lines


def _text(value: Any) -> str:
    return " / ".join(f"{v:.3g}" for v in value) if isinstance(value, list) else f"{value:g}"


def _named(values: dict[str, Any]) -> str:
    """Parameters with their values."""
    return ", ".join(f"{name} {_text(value)}" for name, value in values.items())
