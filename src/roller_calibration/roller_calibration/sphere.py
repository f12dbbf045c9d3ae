"""A sphere of known radius in the points of a rolling pass: where it is, and where skin touches it.

The paper takes the contact circle from one depth map. Here all depth maps of a pass count: the
sphere stands still in base, so it is one place, and each window's truth follows from its pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from roller_core.errors import RollerError
from roller_core.transforms import F64

from .dome_candidates import dome_places

#: Fewest points of a pass, and of a contact patch.
LEAST_POINTS, LEAST_IN_CONTACT = 300, 150
#: A fitted radius may differ from the stated one by this share.
RADIUS_TOLERANCE = 0.1
#: The skin has left the sphere where the median distance exceeds this share of the radius.
_LEAVES = 1 / 32
#: Width of the rings in which that is looked at, and fewest points of one.
_RING, _LEAST_IN_RING = 1 / 20, 12
#: Largest contact radius in radii: further out a dome is too steep to be touched.
_MOST_CONTACT, _LEAST_CONTACT = 0.95, 0.3
#: Sectors around the top, how many must hold points, and share of points near the sphere.
_SECTORS, _LEAST_SECTORS, _LEAST_SHARE = 8, 4, 0.6
#: A second dome counts if it has this share of the first one's points.
_SECOND = 0.2
#: Radii that a dome may turn out to have, in stated ones.
_RADII = (0.2, 4.0)
_ROUNDS = 4
#: By how much further than the stated sphere one seems to fall from its top to the edge of its
#: contact without a calibration, in any light, m: drift of edges makes it seem rounder. Measured on
#: the virtual cell, radii of 3 to 10 mm at 0.1 to 0.5 m/s: -27 to 140 µm.
SEEMING_FALL_M = -4.5e-5, 1.65e-4


class SphereError(RollerError):
    """A pass in which the sphere can't be found."""


class OtherRadiusError(SphereError):
    """A sphere of another radius than was said."""


@dataclass(frozen=True)
class Sphere:
    """A sphere in base, and the circle within which the skin touches it."""

    #: In base, metres. Shape (3,).
    centre_m: F64
    #: Unit vector in base from the surface to the camera. Shape (3,).
    towards: F64
    #: The stated radius.
    radius_m: float
    #: Of the contact circle, about the axis through the centre, metres.
    contact_radius_m: float
    #: Radius that the points alone give, metres, and the distance from the top up to which they
    #: count, which hardly depends on the stated one.
    fitted_radius_m: float
    fitted_within_m: float
    #: Median distance of the points in contact from the sphere, metres.
    scatter_m: float
    #: Points in contact.
    points: int

    @property
    def top_m(self) -> F64:
        """The sphere's highest point in base, metres."""
        return self.centre_m + self.radius_m * self.towards

    @property
    def contact_plane_m(self) -> float:
        """How far the contact circle's plane lies over the centre (the paper's -z_b), metres."""
        return float(np.sqrt(self.radius_m**2 - self.contact_radius_m**2))

    @property
    def fall_m(self) -> float:
        """How much further the fitted sphere falls to its edge than the stated one, metres.

        By the parabolas at their tops: it says how well the radius is known, whatever it is.
        """
        bent = 1 / self.fitted_radius_m - 1 / self.radius_m
        return 0.5 * self.fitted_within_m**2 * bent

    @property
    def odd(self) -> bool:
        """Whether no light makes a sphere of the stated radius seem as the fitted one."""
        least, most = SEEMING_FALL_M
        return not least <= self.fall_m <= most

    def moved_to_top(self, height_m: float) -> Sphere:
        """The same sphere with its top at a height (z in base), metres."""
        shift = (height_m - self.top_m[2]) / self.towards[2]
        return replace(self, centre_m=self.centre_m + shift * self.towards)


def find_sphere(
    points_m: F64, towards: F64, radius_m: float, tolerance: float = RADIUS_TOLERANCE
) -> Sphere:
    """Find the one sphere among points.

    Parameters
    ----------
    points_m : ndarray of float64, shape (n, 3)
        Points of all depth maps of a pass in base, metres.
    towards : ndarray of float64, shape (3,)
        Direction in base from the surface to the camera.
    radius_m : float
        Radius of the sphere, metres.
    tolerance : float
        Share by which the radius of what is found may differ.

    Raises
    ------
    SphereError
        Saying why: too few points, no sphere, two, or another radius.
    """
    if len(points_m) < LEAST_POINTS:
        raise SphereError(
            f"{len(points_m)} depths, fewer than {LEAST_POINTS}: too few events; roll faster, "
            "lower the camera's threshold or give the skin more texture"
        )
    frame = _frame(towards)
    local = points_m @ frame.T
    fitted = [_fit_dome(local, place, radius_m) for place in dome_places(local, radius_m)]
    domes = _distinct([dome for dome in fitted if dome.good])
    if not domes:
        raise SphereError(
            f"no sphere of about {radius_m * 1e3:g} mm radius in view, or fewer than "
            f"{LEAST_IN_CONTACT} depths on it"
        )
    if len(domes) > 1:
        apart = np.hypot(*(domes[0].apex[:2] - domes[1].apex[:2]))
        raise SphereError(
            f"{len(domes)} spheres in view, {apart * 1e3:.1f} mm apart: roll over one alone"
        )
    dome = domes[0]
    if abs(dome.radius_m / radius_m - 1) > tolerance:
        raise OtherRadiusError(
            f"the dome in view fits a radius of {dome.radius_m * 1e3:.2f} mm, not "
            f"{radius_m * 1e3:g} mm (allowed: {tolerance:.0%}); check --radius-mm and the camera's "
            "calibration"
        )
    return _with_radius(local, dome, radius_m, frame)


def seeming_radii(
    radius_m: float, within_m: float, fall_m: tuple[float, float]
) -> tuple[float, float]:
    """The least and the largest fitted radius of which `Sphere.fall_m` lies in a range, metres."""
    bent = 2 * np.array(fall_m) / within_m**2 + 1 / radius_m
    largest, least = 1 / np.maximum(bent, 1e-3)
    return float(least), float(largest)


@dataclass(frozen=True)
class _Dome:
    """A dome whose radius is free: its highest point in the local frame."""

    apex: F64
    radius_m: float
    contact_m: float
    points: int
    good: bool


def _distinct(domes: list[_Dome]) -> list[_Dome]:
    """Each dome once, and no stray ones beside a good one; most points first."""
    found: list[_Dome] = []
    for dome in sorted(domes, key=lambda d: -d.points):
        apart = [np.hypot(*(dome.apex[:2] - d.apex[:2])) / d.radius_m for d in found]
        if not found or (min(apart) > 0.5 and dome.points >= _SECOND * found[0].points):
            found.append(dome)
    return found


def _frame(towards: F64) -> F64:
    """Rows: two directions along the surface and the one to the camera."""
    z = np.asarray(towards, np.float64) / np.linalg.norm(towards)
    x = np.eye(3)[np.argmin(np.abs(z))]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _below_apex(rho: F64, curvature: F64 | float) -> F64:
    """How far a sphere lies below its top at a distance from the axis."""
    return np.asarray(curvature * rho**2 / (1 + np.sqrt(np.maximum(1 - (curvature * rho) ** 2, 0))))


def _robust(local: F64, start: F64, radius_m: float, fixed: bool) -> F64:
    """Apex and curvature (x, y, z, 1/R) that most points agree on."""

    def residuals(p: F64) -> F64:
        rho = np.hypot(local[:, 0] - p[0], local[:, 1] - p[1])
        curvature = 1 / radius_m if fixed else p[3] / radius_m
        return (local[:, 2] - p[2] + _below_apex(rho, curvature)) / radius_m

    p = start[:3] if fixed else np.array([*start[:3], start[3] * radius_m])
    found = least_squares(residuals, p, loss="soft_l1", f_scale=0.01, x_scale=radius_m)
    if fixed:
        return np.array([*found.x, 1 / radius_m])
    return np.array([*found.x[:3], max(found.x[3], 0.05) / radius_m])


def _fit_dome(local: F64, place: F64, radius_m: float) -> _Dome:
    """Fit a dome of any radius near a place, and see how far it reaches."""
    p, reach = place, 0.5 * radius_m
    contact = 0.0
    for _ in range(_ROUNDS):
        near = np.hypot(local[:, 0] - p[0], local[:, 1] - p[1]) < reach
        if near.sum() < 10:
            break
        p = _robust(local[near], p, radius_m, fixed=False)
        own = 1 / p[3]
        contact = _contact(local, p, radius_m, own)
        reach = contact if contact > _LEAST_CONTACT * radius_m else 0.4 * radius_m
    rho = np.hypot(local[:, 0] - p[0], local[:, 1] - p[1])
    inside = rho < contact
    count = int(inside.sum())
    likely = _RADII[0] < 1 / (p[3] * radius_m) < _RADII[1]
    good = likely and count >= LEAST_IN_CONTACT and contact >= _LEAST_CONTACT / p[3]
    if good:
        miss = local[inside, 2] - p[2] + _below_apex(rho[inside], p[3])
        good = _round_all_over(local[inside, :2] - p[:2], miss, _LEAVES * radius_m)
    return _Dome(p[:3], 1 / float(p[3]), contact, count, bool(good))


def _inner_radius(local: F64, dome: _Dome, radius_m: float) -> tuple[float, float]:
    """A dome's radius by the points that the skin surely touches, and how far out they lie, m.

    Where the skin leaves it, it is flatter; `dome` reaches as far as that shows.
    """
    p, contact, within = np.array([*dome.apex, 1 / dome.radius_m]), dome.contact_m, dome.contact_m
    for _ in range(_ROUNDS):
        inner = contact - _RING * radius_m
        near = np.hypot(local[:, 0] - p[0], local[:, 1] - p[1]) < inner
        if near.sum() < LEAST_IN_CONTACT:
            break
        p, within = _robust(local[near], p, radius_m, fixed=False), inner
        own = 1 / float(p[3])
        found = _contact(local, p, own, own)
        contact = found if found > _LEAST_CONTACT * radius_m else contact
    return 1 / float(p[3]), within


def _round_all_over(place: F64, miss: F64, limit_m: float) -> bool:
    """Whether points lie on a dome, and on every side of it."""
    angle = np.arctan2(place[:, 1], place[:, 0])
    sector = ((angle / (2 * np.pi) + 0.5) * _SECTORS).astype(int) % _SECTORS
    sides = [miss[sector == k] for k in range(_SECTORS)]
    off = [abs(float(np.median(side))) for side in sides if len(side) >= 3]
    share = float((np.abs(miss) < limit_m).mean())
    return share >= _LEAST_SHARE and len(off) >= _LEAST_SECTORS and max(off) < limit_m


def _contact(local: F64, p: F64, radius_m: float, own_m: float) -> float:
    """Distance from the axis up to which points lie on the sphere."""
    rho = np.hypot(local[:, 0] - p[0], local[:, 1] - p[1])
    near = rho < _MOST_CONTACT * own_m
    miss = local[near, 2] - p[2] + _below_apex(rho[near], p[3])
    ring = _RING * radius_m
    number = (rho[near] / ring).astype(int)
    previous = (0.0, 0.0)
    last = 0.0
    for k in range(int(_MOST_CONTACT * own_m / ring) + 1):
        own = miss[number == k]
        if len(own) < _LEAST_IN_RING:
            continue
        middle, off = (k + 0.5) * ring, abs(float(np.median(own)))
        limit = _LEAVES * radius_m
        # About the top there is little to see, and a stray depth is no border.
        if off > limit and middle > _LEAST_CONTACT * min(radius_m, own_m):
            if not last:
                return 0.0
            share = (limit - previous[1]) / max(off - previous[1], 1e-12)
            return previous[0] + share * (middle - previous[0])
        previous, last = (middle, off), middle
    return last


def _with_radius(local: F64, dome: _Dome, radius_m: float, frame: F64) -> Sphere:
    """The dome with its stated radius."""
    p = np.array([*dome.apex, 1 / radius_m])
    contact = min(dome.contact_m, _MOST_CONTACT * radius_m)
    for _ in range(_ROUNDS):
        near = np.hypot(local[:, 0] - p[0], local[:, 1] - p[1]) < contact
        p = _robust(local[near], p, radius_m, fixed=True)
        found = _contact(local, p, radius_m, radius_m)
        contact = found if found > _LEAST_CONTACT * radius_m else contact
    # The skin leaves the sphere a little before that shows.
    contact -= _RING * radius_m
    rho = np.hypot(local[:, 0] - p[0], local[:, 1] - p[1])
    inside = rho < contact
    miss = np.abs(local[inside, 2] - p[2] + _below_apex(rho[inside], p[3]))
    centre = frame.T @ (p[:3] - [0, 0, radius_m])
    fitted_m, within_m = _inner_radius(local, dome, radius_m)
    return Sphere(
        centre,
        frame[2],
        radius_m,
        float(contact),
        fitted_m,
        within_m,
        float(np.median(miss)),
        int(inside.sum()),
    )
