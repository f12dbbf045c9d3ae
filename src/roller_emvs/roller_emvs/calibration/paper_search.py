"""Grid search over the paper's parameters: threshold C, median size G_f, weights of the views.

A window's votes are made once, the threshold's margins once a view. A choice of C is a comparison,
G_f a median over a part of the image, and all weights share the views' warped depths. What comes
out is what `DepthPipeline` would give with those parameters, over the contact circle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt
from numba import njit

from roller_core.camera import Camera
from roller_core.errors import SettingsError
from roller_core.transforms import F64, inverse_pose
from roller_emvs.detection import margins
from roller_emvs.fusion import Box, warp_view
from roller_emvs.paper import ViewVotes, masked_depth, view_votes
from roller_emvs.settings import DepthSettings
from roller_emvs.threads import share

from .contact import ContactWindow
from .error_table import I64

#: How far weights may be off a sum of one.
SIMPLEX_TOLERANCE = 1e-3


@dataclass(frozen=True)
class PaperGrid:
    """Choices that are tried, each with each.

    Attributes
    ----------
    thresholds : tuple of float
        C, whole numbers, in 1/255.
    medians_px : tuple of int
        G_f, odd, px.
    weights : ndarray of float64, shape (n, views)
        On the simplex.
    """

    thresholds: tuple[float, ...]
    medians_px: tuple[int, ...]
    weights: F64

    @classmethod
    def of_paper(cls, views: int = 3, parts: int = 18) -> PaperGrid:
        """C 5–20, G_f 11–91 odd, weights in so many parts (18 hold the paper's 8, 6 and 4)."""
        return cls(
            tuple(float(c) for c in range(5, 21)), tuple(range(11, 92, 2)), simplex(views, parts)
        )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of thresholds, medians and weights."""
        return len(self.thresholds), len(self.medians_px), len(self.weights)

    @property
    def size(self) -> int:
        """Number of choices."""
        return int(np.prod(self.shape))

    def values(self, choice: int) -> dict[str, float | int | list[float]]:
        """Parameters of a choice, by their names in `DepthSettings`."""
        c, g, w = np.unravel_index(choice, self.shape)
        return {
            "threshold_c": self.thresholds[c],
            "median_px": self.medians_px[g],
            "weights": [round(float(v), 6) for v in self.weights[w]],
        }

    def at_border(self, choice: int) -> list[str]:
        """Parameters of a choice that lie at an end of their range, by name."""
        c, g, _ = np.unravel_index(choice, self.shape)
        ends = {"threshold_c": (c, self.shape[0]), "median_px": (g, self.shape[1])}
        return [name for name, (k, n) in ends.items() if n > 2 and k in (0, n - 1)]


def simplex(count: int, parts: int) -> F64:
    """All weights that are whole multiples of 1 / parts and sum up to one, shape (n, count)."""
    bars = np.array(list(combinations(range(parts + count - 1), count - 1)), np.int64)
    bars = bars.reshape(len(bars), count - 1)
    padded = np.pad(bars, ((0, 0), (1, 1)), constant_values=((0, 0), (-1, parts + count - 1)))
    return np.asarray((np.diff(padded, axis=1) - 1) / parts, np.float64)


def check_weights(settings: DepthSettings) -> None:
    """Refuse settings whose weights can't be calibrated.

    Raises
    ------
    SettingsError
        If the weights are off the simplex or aren't fixed.
    """
    total = sum(settings.weights)
    if abs(total - 1) > SIMPLEX_TOLERANCE:
        raise SettingsError(
            f"weights {list(settings.weights)} sum up to {total:g}, not 1: they must lie on the "
            "simplex"
        )
    if settings.weight_rule != "fixed":
        raise SettingsError(
            f"weights are calibrated for weight_rule: fixed, not {settings.weight_rule}"
        )


def window_errors(
    window: ContactWindow,
    camera: Camera,
    settings: DepthSettings,
    grid: PaperGrid,
    tell: Callable[[float], None] = lambda _share: None,
) -> tuple[F64, I64]:
    """Errors of all choices of the grid over one window's contact circle.

    Parameters
    ----------
    window : ContactWindow
        Events, poses and the truth.
    camera : Camera
        Intrinsics.
    settings : DepthSettings
        Method `bma`; everything that the grid doesn't hold.
    grid : PaperGrid
        Choices.
    tell : callable
        Told the share done.

    Returns
    -------
    errors_m : ndarray of float64, shape (grid.size,)
        Sums of absolute errors, metres.
    points : ndarray of int64, shape (grid.size,)
        Measured pixels.
    """
    prepared, s = window.prepared, settings
    bounds = (s.depth_min_m, s.depth_max_m)
    voted = view_votes(prepared.packets, camera, prepared.poses, prepared.target, bounds, s)
    parts = [
        _ViewPart.cut(voted, k, camera, window, s, max(grid.medians_px) // 2)
        for k in range(len(voted.poses))
    ]
    truth = window.view.depth_m[window.view.mask]
    weights = np.ascontiguousarray(grid.weights.T)
    errors = np.zeros(grid.shape)
    points = np.zeros(grid.shape, np.int64)
    done: list[int] = []

    def run(c: int) -> None:
        masks = [part.margins > grid.thresholds[c] for part in parts]
        for g, size in enumerate(grid.medians_px):
            depth = np.stack(
                [
                    part.warped(mask, size, prepared.target, window, camera, s)
                    for part, mask in zip(parts, masks, strict=True)
                ]
            )
            _tally(depth, truth, weights, errors[c, g], points[c, g])
        done.append(c)
        tell(len(done) / len(grid.thresholds))

    share(s.threads, len(grid.thresholds), run)
    return errors.reshape(-1), points.reshape(-1)


@dataclass(frozen=True)
class _ViewPart:
    """The part of a reference view's votes that can end up in the contact circle."""

    votes: npt.NDArray[np.float32]
    index: npt.NDArray[np.uint16]
    margins: npt.NDArray[np.float32]
    corner: tuple[int, int]
    planes: F64
    pose: F64

    @classmethod
    def cut(
        cls,
        voted: ViewVotes,
        k: int,
        camera: Camera,
        window: ContactWindow,
        s: DepthSettings,
        margin_px: int,
    ) -> _ViewPart:
        """Cut a view, with what the largest median reaches."""
        box, pose = window.view.box, voted.poses[k]
        relative = inverse_pose(pose) @ window.prepared.target
        u, v = np.meshgrid(
            [box.left - 1.0, box.left + box.width], [box.top - 1.0, box.top + box.height]
        )
        rays = camera.rays(np.stack([u, v], axis=-1).reshape(-1, 2))
        points = np.concatenate([rays * z for z in (s.depth_min_m, s.depth_max_m)])
        seen = points @ relative[:3, :3].T + relative[:3, 3]
        at_u = camera.fx * seen[:, 0] / seen[:, 2] + camera.cx
        at_v = camera.fy * seen[:, 1] / seen[:, 2] + camera.cy
        left = int(np.clip(np.floor(at_u.min()) - 1 - margin_px, 0, camera.width))
        top = int(np.clip(np.floor(at_v.min()) - 1 - margin_px, 0, camera.height))
        right = int(np.clip(np.ceil(at_u.max()) + 2 + margin_px, left, camera.width))
        bottom = int(np.clip(np.ceil(at_v.max()) + 2 + margin_px, top, camera.height))
        own = (slice(top, bottom), slice(left, right))
        stand_out = margins(voted.votes[k], s.threshold_kernel_px, s.full_scale_votes)
        return cls(
            np.ascontiguousarray(voted.votes[k][own]),
            np.ascontiguousarray(voted.index[k][own]),
            np.ascontiguousarray(stand_out[own]),
            (left, top),
            voted.planes,
            pose,
        )

    def warped(
        self,
        mask: npt.NDArray[np.bool_],
        median_px: int,
        target: F64,
        window: ContactWindow,
        camera: Camera,
        s: DepthSettings,
    ) -> npt.NDArray[np.float32]:
        """Depths in the middle view within the contact circle, NaN where there are none."""
        if not mask.any():
            return np.full(window.view.pixels, np.nan, np.float32)
        changed = s.model_copy(update={"median_px": median_px})
        bounds = (s.depth_min_m, s.depth_max_m)
        view = masked_depth(
            self.votes, self.index, mask.copy(), self.planes, bounds, self.pose, 1.0, changed
        )
        box: Box = window.view.box
        depth, _, _ = warp_view(view, target, camera, self.corner, box)
        return depth[window.view.mask]


@njit(cache=True, nogil=True)
def _tally(depth, truth, weights, errors, points):  # type: ignore[no-untyped-def]
    """Errors of the weighted means of all weights, as `fuse_views` makes them."""
    views, count = depth.shape
    choices = weights.shape[1]
    total = np.empty(choices)
    mean = np.empty(choices)
    for i in range(count):
        seen = False
        for j in range(choices):
            total[j] = 0.0
            mean[j] = 0.0
        for k in range(views):
            # Relative to the truth, so that the sums lose nothing.
            z = depth[k, i] - truth[i]
            if np.isnan(z):
                continue
            seen = True
            for j in range(choices):
                total[j] += weights[k, j]
                mean[j] += weights[k, j] * z
        if seen:
            for j in range(choices):
                if total[j] > 0:
                    errors[j] += abs(mean[j]) / total[j]
                    points[j] += 1
