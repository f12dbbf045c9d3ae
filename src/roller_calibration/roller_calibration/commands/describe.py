"""What `calibrate sphere` tells people."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from roller_calibration import PAPER_MM_PER_PX, ContactWindow, Figures, Rolled, Sphere, check_scale


def _middle(windows: Sequence[ContactWindow], rolled: Rolled) -> ContactWindow:
    """The window of a pass that has the contact circle nearest to the middle of the image."""
    own = [w for w in windows if w.name == rolled.name]
    return min(own, key=lambda w: abs(w.view.centre_px[0] - rolled.camera.cx))


def about_spheres(
    passes: Sequence[Rolled],
    spheres: Sequence[Sphere],
    windows: Sequence[ContactWindow],
    args: argparse.Namespace,
) -> list[str]:
    """Lines about the spheres; refuses a scale that contradicts the camera."""
    lines = []
    for rolled, sphere in zip(passes, spheres, strict=True):
        view = _middle(windows, rolled).view
        count = sum(w.name == rolled.name for w in windows)
        lines.append(
            f"{rolled.name}: contact circle of {sphere.contact_radius_m * 1e3:.2f} mm "
            f"({view.radius_px:.1f} px) about ({view.centre_px[0]:.0f}, {view.centre_px[1]:.0f}) "
            f"px, {count} window{'s' * (count > 1)}; the depths fit a radius of "
            f"{sphere.fitted_radius_m * 1e3:.2f} mm and lie {sphere.scatter_m * 1e6:.0f} µm off "
            "the sphere at the median"
        )
        own = view.plane_m * 1e3 / rolled.camera.fx
        given = args.scale_mm_per_px
        off = (
            PAPER_MM_PER_PX / own - 1
            if given is None
            else check_scale(given, view.plane_m, rolled.camera.fx)
        )
        lines.append(
            f"{rolled.name}: {own:.4f} mm/px at the contact circle, {view.plane_m * 1e3:.2f} mm "
            f"away; {given or PAPER_MM_PER_PX:g} {'as given' if given else 'of the paper'} is "
            f"{off:+.1%} off"
        )
    return lines


def about_moves(
    previous: dict[str, Any],
    args: argparse.Namespace,
    old: dict[str, Any],
    values: dict[str, Any],
    before: Figures,
    after: Figures,
) -> list[str]:
    """How far parameters and error moved since an earlier calibration."""
    lines = [f"since {previous.get('date', '?')} ({args.previous.name}):"]
    skin = previous.get("skin", "")
    if skin != args.skin:
        lines.append(f"  another skin: '{skin}' then, '{args.skin}' now")
    for name, value in values.items():
        lines.append(f"  {name}: {_text(old[name])} -> {_text(value)}")
    then = previous.get("after")
    if isinstance(then, dict) and {"error_m", "coverage"} <= then.keys():
        lines.append(
            f"  its parameters had {then['error_m'] * 1e6:.1f} µm at {then['coverage']:.1%} then, "
            f"{before} now; calibrated again {after}"
        )
    return lines


def plain(value: Any) -> Any:
    """A parameter's value as YAML has it."""
    return list(value) if isinstance(value, tuple) else value


def _text(value: Any) -> str:
    return " / ".join(f"{v:.3g}" for v in value) if isinstance(value, list) else f"{value:g}"


def listed(values: dict[str, Any]) -> str:
    """Parameters with their values."""
    return ", ".join(f"{name} {_text(value)}" for name, value in values.items())
