"""A track of poses over time, interpolated and never guessed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .pose_errors import (
    NoPosesError,
    PoseError,
    PoseExtrapolationError,
    PoseGapError,
    PoseJumpError,
    PoseOrderError,
    PoseValueError,
)
from .timing_settings import DEFAULT_MAX_POSE_GAP_S
from .transforms import F64, pose_matrix, slerp

__all__ = [
    "FASTEST_M_S", "NoPosesError", "Pose", "PoseError", "PoseExtrapolationError", "PoseGapError",
    "PoseJumpError", "PoseOrderError", "PoseTrack", "PoseValueError", "unit_pose",
]  # fmt: skip

I64 = npt.NDArray[np.int64]

#: No arm moves its tool faster, m/s; what does comes from somewhere else.
FASTEST_M_S = 5.0
#: Places further from base than this are rounded to more than a micrometre, m.
_FARTHEST_M = 1e10


@dataclass(frozen=True, slots=True)
class Pose:
    """One rigid pose: metres, and a unit quaternion x, y, z, w."""

    position: F64
    quaternion: F64

    @property
    def matrix(self) -> F64:
        """The 4×4 matrix."""
        return pose_matrix(self.position, self.quaternion)


class PoseTrack:
    """Poses in order of time: linear in position, spherical in rotation.

    Parameters
    ----------
    max_gap_s : float
        Two neighbouring poses further apart than this leave a gap, in which no pose is given.
    """

    def __init__(self, max_gap_s: float = DEFAULT_MAX_POSE_GAP_S) -> None:
        self.max_gap_s = max_gap_s
        self._n = 0
        self._t = np.empty(64, np.int64)
        self._p = np.empty((64, 3))
        self._q = np.empty((64, 4))
        self._acc = np.empty(64)

    def __len__(self) -> int:
        return self._n

    @property
    def times_ns(self) -> I64:
        """Time stamps, int64, shape (n,)."""
        return self._t[: self._n]

    @property
    def positions(self) -> F64:
        """Positions in metres, shape (n, 3)."""
        return self._p[: self._n]

    @property
    def quaternions(self) -> F64:
        """Unit quaternions x, y, z, w, shape (n, 4)."""
        return self._q[: self._n]

    @property
    def start_ns(self) -> int:
        """Time of the first pose."""
        self._need_poses()
        return int(self._t[0])

    @property
    def end_ns(self) -> int:
        """Time of the last pose."""
        self._need_poses()
        return int(self._t[self._n - 1])

    def append(self, t_ns: int, position: npt.ArrayLike, quaternion: npt.ArrayLike) -> None:
        """Add a pose; one with the newest time stamp replaces that pose.

        Raises
        ------
        PoseOrderError
            If it is older than the newest pose.
        PoseValueError
            If it is not finite, lies beyond all robots or its quaternion is zero.
        """
        p = np.asarray(position, dtype=np.float64)
        q = unit_pose(t_ns, p, quaternion)
        if self._n and t_ns < self._t[self._n - 1]:
            raise PoseOrderError.between(t_ns, int(self._t[self._n - 1]))
        if self._n and t_ns == self._t[self._n - 1]:
            self._n -= 1
        elif self._n == len(self._t):
            self._t = np.concatenate([self._t, np.empty_like(self._t)])
            self._p = np.concatenate([self._p, np.empty_like(self._p)])
            self._q = np.concatenate([self._q, np.empty_like(self._q)])
            self._acc = np.concatenate([self._acc, np.empty_like(self._acc)])
        n = self._n
        self._t[n], self._p[n], self._q[n], self._acc[n] = t_ns, p, q, np.nan
        self._n += 1
        if n > 1:
            self._acc[n - 1] = self._acceleration(n - 1)

    def _acceleration(self, k: int) -> float:
        """Of the sensor at a pose between two others, m/s²."""
        before, after = ((self._t[k + j + 1] - self._t[k + j]) * 1e-9 for j in (-1, 0))
        p0, p1, p2 = self._p[k - 1 : k + 2].tolist()
        change = math.dist(
            [(b - a) / before for a, b in zip(p0, p1, strict=True)],
            [(b - a) / after for a, b in zip(p1, p2, strict=True)],
        )
        return 2 * change / float(before + after)

    def extend(
        self, t_ns: npt.ArrayLike, positions: npt.ArrayLike, quaternions: npt.ArrayLike
    ) -> None:
        """Add poses in order of time, see `append`.

        Parameters
        ----------
        t_ns : array_like of int, shape (n,)
            Times, ns.
        positions : array_like, shape (n, 3)
            Metres.
        quaternions : array_like, shape (n, 4)
            Rotations x, y, z, w.

        Raises
        ------
        PoseValueError
            If shapes don't fit, or times are no whole numbers; none is added. And as `append`, for
            a pose; those before it stay.
        PoseOrderError
            As `append`; those before it stay.
        """
        t, p, q = np.asarray(t_ns), np.asarray(positions), np.asarray(quaternions)
        if not (t.ndim == 1 and p.shape == (len(t), 3) and q.shape == (len(t), 4)):
            raise PoseValueError(
                f"times, positions and quaternions are of shapes {t.shape}, {p.shape} and "
                f"{q.shape}; expected (n,), (n, 3) and (n, 4)"
            )
        if t.dtype.kind not in "iuf" or (t.dtype.kind == "f" and (t != np.floor(t)).any()):
            raise PoseValueError(
                f"poses have the times {t[0]} to {t[-1]}; expected nanoseconds, whole numbers"
            )
        for each_ns, position, quaternion in zip(t.tolist(), p, q, strict=True):
            self.append(int(each_ns), position, quaternion)

    def assign(self, other: PoseTrack) -> None:
        """Take the poses of another track in place of one's own."""
        self._n = len(other)
        self._t, self._p, self._q = other._t.copy(), other._p.copy(), other._q.copy()
        self._acc = other._acc.copy()

    def clear(self) -> None:
        """Forget all poses."""
        self._n = 0

    def discard_before(self, t_ns: int) -> None:
        """Forget poses that no time from `t_ns` on needs; the one just before it stays."""
        first = max(int(np.searchsorted(self.times_ns, t_ns, side="right")) - 1, 0)
        if first:
            kept = slice(first, self._n)
            self._t[: self._n - first] = self._t[kept].copy()
            self._p[: self._n - first] = self._p[kept].copy()
            self._q[: self._n - first] = self._q[kept].copy()
            self._acc[: self._n - first] = self._acc[kept].copy()
            self._n -= first

    def bent(self, start_ns: int, end_ns: int, most_m: float) -> list[tuple[int, int]]:
        """Where the sensor accelerates too hard for straight lines between its poses.

        Parameters
        ----------
        start_ns, end_ns : int
            Span to look at. For its last step to be judged as it will be for good, another pose
            has to have followed.
        most_m : float
            Error of position that is let pass, metres.

        Returns
        -------
        list of (int, int)
            Times of neighbouring poses, in order.
        """
        first = max(int(np.searchsorted(self.times_ns, start_ns, side="right")), 1)
        last = min(int(np.searchsorted(self.times_ns, end_ns, side="left")) + 1, self._n)
        if last <= first:
            return []
        times, acc = self._t[first - 1 : last], self._acc[first - 1 : last]
        # A parabola is off its chord by an eighth of acceleration times time squared. A path that
        # bends within the step is off by no more than the time squared times the acceleration at
        # the end that tells of less; one that bends at a pose leaves both steps straight.
        low, high = np.fmin(acc[:-1], acc[1:]), np.fmax(acc[:-1], acc[1:])
        seconds = np.diff(times) * 1e-9
        off = np.minimum(8 * low, high) * seconds**2 / 8
        hard = (off > most_m) & (seconds <= self.max_gap_s)  # of a gap nothing is known
        return [(int(times[k]), int(times[k + 1])) for k in np.flatnonzero(hard)]

    def half_way(self, start_ns: int, end_ns: int) -> int:
        """Time at which the sensor has come half of its way through a span that poses cover."""
        times = self.times_ns
        inner = times[(times > start_ns) & (times < end_ns)]
        at = np.concatenate([[start_ns], inner, [end_ns]])
        way = np.cumsum(np.linalg.norm(np.diff(self.sample(at)[0], axis=0), axis=1))
        if not way[-1] > 0:
            return (start_ns + end_ns) // 2
        return start_ns + round(float(np.interp(way[-1] / 2, [0.0, *way], at - start_ns)))

    def covers(self, start_ns: int, end_ns: int) -> bool:
        """Whether every time of the closed interval has a pose."""
        try:
            self.check(start_ns, end_ns)
        except PoseError:
            return False
        return True

    def check(self, start_ns: int, end_ns: int) -> None:
        """Refuse an interval that poses don't cover.

        Raises
        ------
        NoPosesError, PoseExtrapolationError, PoseGapError
            With the reason.
        """
        self._need_poses()
        if start_ns < self._t[0] or end_ns > self._t[self._n - 1]:
            raise PoseExtrapolationError(
                f"no pose for {start_ns * 1e-9:.6f}–{end_ns * 1e-9:.6f} s: poses reach from "
                f"{self._t[0] * 1e-9:.6f} to {self._t[self._n - 1] * 1e-9:.6f} s"
            )
        first = max(int(np.searchsorted(self.times_ns, start_ns, side="right")) - 1, 0)
        last = int(np.searchsorted(self.times_ns, end_ns, side="left"))
        steps = np.diff(self._t[first : last + 1])
        if len(steps) and steps.max() > self.max_gap_s * 1e9:
            k = first + int(np.argmax(steps))
            raise PoseGapError(
                f"no pose from {self._t[k] * 1e-9:.6f} to {self._t[k + 1] * 1e-9:.6f} s: "
                f"a gap of {steps.max() * 1e-9:.3f} s, over the limit of {self.max_gap_s:g} s"
            )

    def sample(self, t_ns: npt.ArrayLike) -> tuple[F64, F64]:
        """Interpolated poses.

        Parameters
        ----------
        t_ns : array_like of int, shape (n,)
            Times in nanoseconds, in any order.

        Returns
        -------
        positions : ndarray, shape (n, 3)
            Metres.
        quaternions : ndarray, shape (n, 4)
            Unit quaternions x, y, z, w.

        Raises
        ------
        NoPosesError, PoseExtrapolationError, PoseGapError
            Where a time has no pose.
        """
        t = np.atleast_1d(np.asarray(t_ns, dtype=np.int64))
        if not len(t):
            return np.empty((0, 3)), np.empty((0, 4))
        self.check(int(t.min()), int(t.max()))
        if self._n == 1:
            return np.repeat(self.positions, len(t), 0), np.repeat(self.quaternions, len(t), 0)
        k = np.searchsorted(self._t[1 : self._n - 1], t, side="right")
        # Subtract in int64: epoch nanoseconds don't fit a float64 exactly.
        fraction = (t - self._t[k]) / (self._t[k + 1] - self._t[k])
        positions = self._p[k] + fraction[:, None] * (self._p[k + 1] - self._p[k])
        return positions, slerp(self._q[k], self._q[k + 1], fraction)

    def at(self, t_ns: int) -> Pose:
        """The pose at one time; see `sample`."""
        positions, quaternions = self.sample([t_ns])
        return Pose(positions[0], quaternions[0])

    def matrices(self, t_ns: npt.ArrayLike) -> F64:
        """Interpolated poses as 4×4 matrices, shape (n, 4, 4); see `sample`."""
        return pose_matrix(*self.sample(t_ns))

    def _need_poses(self) -> None:
        if not self._n:
            raise NoPosesError("no poses yet; is the robot's pose (base -> tool) published?")


def unit_pose(t_ns: int, position: F64, quaternion: npt.ArrayLike) -> F64:
    """The unit quaternion of a pose that can be used.

    Raises
    ------
    PoseValueError
        If the pose is not finite, lies beyond all robots or its quaternion is zero.
    """
    # In plain Python: this runs for every pose of every stage.
    if not all(map(math.isfinite, position)):
        raise PoseValueError(f"pose at {t_ns * 1e-9:.6f} s is not finite; it is left out")
    if not max(map(abs, position)) < _FARTHEST_M:
        raise PoseValueError(
            f"pose at {t_ns * 1e-9:.6f} s is {max(map(abs, position)):.3g} m away, farther than "
            "any robot; is it in metres? It is left out"
        )
    x, y, z, w = map(float, np.asarray(quaternion))
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not math.isfinite(length) or length < 1e-9:
        raise PoseValueError(
            f"pose at {t_ns * 1e-9:.6f} s: a quaternion is zero or not finite; expected x, y, z, w "
            "of a rotation; it is left out"
        )
    return np.array([x / length, y / length, z / length, w / length])
