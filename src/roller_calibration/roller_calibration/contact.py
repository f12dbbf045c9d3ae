"""What a depth map ought to show of a sphere: true depth within the contact circle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import F64
from roller_emvs.depth_map import DepthMap, back_project
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.pipeline import DepthPipeline, PreparedWindow
from roller_emvs.windows import RefusedWindow

from .recordings import Scan
from .sphere import Sphere, SphereError

#: Windows by which the sphere is found overlap by this share.
_OVERLAP = 0.5


class Box(NamedTuple):
    """A part of an image: its first column and row and its size, px."""

    left: int
    top: int
    width: int
    height: int

    def of(self, image: np.ndarray) -> np.ndarray:
        """That part."""
        rows = slice(self.top, self.top + self.height)
        return image[rows, self.left : self.left + self.width]


@dataclass(frozen=True)
class TrueDepth:
    """What is known of a part of a camera's image, in ideal pinhole pixels."""

    #: The part.
    box: Box
    #: True depth, metres; NaN where it isn't known. Shape (box height, box width).
    depth_m: F64
    #: What counts; the depth there is known. Shape (box height, box width).
    mask: npt.NDArray[np.bool_]

    @property
    def pixels(self) -> int:
        """Pixels that count."""
        return int(np.count_nonzero(self.mask))


@dataclass(frozen=True)
class ContactView(TrueDepth):
    """The contact circle in a camera's image: what counts is within it."""

    #: Middle of the circle, u and v.
    centre_px: tuple[float, float]
    #: Of the circle.
    radius_px: float
    #: Depth of the circle's plane, metres.
    plane_m: float


@dataclass(frozen=True)
class KnownWindow:
    """A window, and the truth in its middle view."""

    name: str
    prepared: PreparedWindow
    view: TrueDepth


@dataclass(frozen=True)
class ContactWindow(KnownWindow):
    """A window in whose middle view the contact circle lies whole."""

    view: ContactView


def contact_view(sphere: Sphere, camera: Camera, pose: F64) -> ContactView | None:
    """The contact circle as a camera sees it; None where the image doesn't hold it whole.

    Parameters
    ----------
    sphere : Sphere
        Where it is.
    camera : Camera
        Intrinsics.
    pose : ndarray of float64, shape (4, 4)
        Camera in base.
    """
    rotation = pose[:3, :3]
    centre = rotation.T @ (sphere.centre_m - pose[:3, 3])
    towards = rotation.T @ sphere.towards
    middle = centre + sphere.contact_plane_m * towards
    across = np.linalg.svd(towards[None, :])[2][1:]
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    circle = middle + sphere.contact_radius_m * (
        np.cos(angle)[:, None] * across[0] + np.sin(angle)[:, None] * across[1]
    )
    if (circle[:, 2] <= 0).any():
        return None
    # The top bulges towards the camera; it may hide some of the circle's edge, never pass it far.
    shown = np.concatenate([circle, (centre + sphere.radius_m * towards)[None, :]])
    u = camera.fx * shown[:, 0] / shown[:, 2] + camera.cx
    v = camera.fy * shown[:, 1] / shown[:, 2] + camera.cy
    left, top = int(np.floor(u.min())) - 2, int(np.floor(v.min())) - 2
    right, bottom = int(np.ceil(u.max())) + 3, int(np.ceil(v.max())) + 3
    if left < 0 or top < 0 or right > camera.width or bottom > camera.height:
        return None
    box = Box(left, top, right - left, bottom - top)
    grid = np.stack(np.meshgrid(np.arange(left, right), np.arange(top, bottom)), axis=-1)
    rays = camera.rays(grid.reshape(-1, 2))
    # |z·d - c|² = R², the nearer root.
    dd, dc = np.einsum("ij,ij->i", rays, rays), rays @ centre
    rest = dc**2 - dd * (centre @ centre - sphere.radius_m**2)
    depth = np.where(rest >= 0, (dc - np.sqrt(np.maximum(rest, 0))) / dd, np.nan)
    arm = rays * depth[:, None] - centre
    along = arm @ towards
    with np.errstate(invalid="ignore"):
        off_axis = np.einsum("ij,ij->i", arm, arm) - along**2
        mask = (off_axis < sphere.contact_radius_m**2) & (along > 0)
    shape = (box.height, box.width)
    return ContactView(
        box,
        depth.reshape(shape),
        mask.reshape(shape),
        (
            float(camera.fx * middle[0] / middle[2] + camera.cx),
            float(camera.fy * middle[1] / middle[2] + camera.cy),
        ),
        float(0.25 * (np.ptp(u[:-1]) + np.ptp(v[:-1]))),
        float(middle[2]),
    )


def pass_points(scan: Scan, settings: DepthSettings) -> tuple[F64, F64]:
    """Points of all depth maps of a pass, by method `focus`, whichever is calibrated.

    Parameters
    ----------
    scan : Scan
        The pass.
    settings : DepthSettings
        Depth range, delay and the parameters of `focus`.

    Returns
    -------
    points : ndarray of float64, shape (n, 3)
        In base, metres; none where no window gives depth.
    towards : ndarray of float64, shape (3,)
        Direction in base from the surface to the camera.
    """
    changes = {"method": "focus", "window.rule": "auto", "window.overlap": _OVERLAP}
    pipeline = DepthPipeline(settings.changed(changes), scan.camera, scan.track)
    pipeline.add_events(scan.events)
    parts, towards = [np.empty((0, 3))], np.zeros(3)
    for found in pipeline.results(flush=True):
        if isinstance(found, DepthMap):
            points, _ = back_project(found.depth, scan.camera)
            parts.append(points @ found.pose[:3, :3].T + found.pose[:3, 3])
            towards -= found.pose[:3, 2]
    length = float(np.linalg.norm(towards))
    return np.concatenate(parts), towards / length if length else np.array([0.0, 0.0, 1.0])


def contact_windows(scan: Scan, settings: DepthSettings, sphere: Sphere) -> list[ContactWindow]:
    """Windows of a method in whose middle view the whole contact circle is in the patch.

    Raises
    ------
    SphereError
        If there are none: the sphere lies beside the path, or the pass stops short of it.
    """
    camera, found = scan.camera, []
    for prepared in prepared_windows(scan.camera, scan.track, scan.events, settings):
        view = contact_view(sphere, camera, prepared.target)
        if view is not None and _on_patch(view, camera, settings.patch_half_length_m):
            found.append(ContactWindow(scan.name, prepared, view))
    if not found:
        raise SphereError(
            f"{scan.name}: the contact circle ({sphere.contact_radius_m * 1e3:.1f} mm radius) "
            "lies whole on the contact patch in no window: roll so that the sphere passes the "
            "middle of the image"
        )
    return found


def prepared_windows(
    camera: Camera, track: PoseTrack, events: EventArray, settings: DepthSettings
) -> Iterator[PreparedWindow]:
    """Windows of a scan that have parallax, as a replay cuts them."""
    pipeline = DepthPipeline(settings, camera, track)
    pipeline.add_events(events)
    for window in pipeline.windows(flush=True):
        if isinstance(window, RefusedWindow):
            continue
        try:
            yield pipeline.prepare(window)
        except RollerError:
            continue  # standstill and gaps of the poses give no depth in a replay either


def _on_patch(view: ContactView, camera: Camera, half_length_m: float) -> bool:
    if not half_length_m:
        return True
    reach = half_length_m * camera.fx / view.plane_m
    return abs(view.centre_px[0] - camera.cx) + view.radius_px <= reach
