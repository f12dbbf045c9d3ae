"""Events as a structure of arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import RollerError

_DTYPES = tuple(np.dtype(kind) for kind in (np.uint16, np.uint16, np.int64, np.uint8))


class EventArrayError(RollerError):
    """Arrays that don't make up one list of events."""


@dataclass(frozen=True, slots=True)
class EventArray:
    """Events of one sensor, one array a field."""

    #: Pixel column and row. Shape (n,).
    x: npt.NDArray[np.uint16]
    y: npt.NDArray[np.uint16]
    #: Time in nanoseconds; of which clock is the owner's business. Shape (n,).
    t_ns: npt.NDArray[np.int64]
    #: Polarity, 1 = ON (brighter), 0 = OFF. Shape (n,).
    p: npt.NDArray[np.uint8]

    def __post_init__(self) -> None:
        x, y, t_ns, p = self.x, self.y, self.t_ns, self.p
        # One look, as there are thousands of them a second.
        same = x.shape == y.shape == t_ns.shape == p.shape and x.ndim == 1
        if not (same and (x.dtype, y.dtype, t_ns.dtype, p.dtype) == _DTYPES):
            self._refuse()

    def _refuse(self) -> None:
        n = len(self.x)
        for name, dtype in zip(("x", "y", "t_ns", "p"), _DTYPES, strict=True):
            array = getattr(self, name)
            if array.dtype != dtype or array.ndim != 1 or len(array) != n:
                raise EventArrayError(
                    f"event field '{name}' is {array.dtype} of shape {array.shape}; "
                    f"expected {dtype} of shape ({n},)"
                )

    @classmethod
    def empty(cls) -> EventArray:
        """No events."""
        return cls.from_arrays([], [], [], [])

    @classmethod
    def from_arrays(
        cls, x: npt.ArrayLike, y: npt.ArrayLike, t_ns: npt.ArrayLike, p: npt.ArrayLike
    ) -> EventArray:
        """Build from anything array-like, converted to the field types.

        Raises
        ------
        EventArrayError
            If the arrays differ in length or have more than one dimension, or a value is no number
            or doesn't fit its field; polarities are 0 and 1.
        """
        return cls(
            _whole("x", x, np.uint16), _whole("y", y, np.uint16), _whole("t_ns", t_ns, np.int64),
            _whole("p", p, np.uint8, 1, "0 for OFF and 1 for ON"),
        )  # fmt: skip

    @classmethod
    def concatenate(cls, parts: Sequence[EventArray]) -> EventArray:
        """Join lists of events in the order given."""
        if len(parts) == 1:
            return parts[0]
        if not parts:
            return cls.empty()
        return cls(
            np.concatenate([e.x for e in parts]),
            np.concatenate([e.y for e in parts]),
            np.concatenate([e.t_ns for e in parts]),
            np.concatenate([e.p for e in parts]),
        )

    def __len__(self) -> int:
        return len(self.x)

    def __getitem__(self, index: slice | npt.NDArray[np.generic]) -> EventArray:
        return EventArray(self.x[index], self.y[index], self.t_ns[index], self.p[index])

    def check_inside(self, width: int, height: int) -> None:
        """Refuse events outside an image.

        Raises
        ------
        EventArrayError
            Naming the first such pixel.
        """
        if len(self) and (self.x.max() >= width or self.y.max() >= height):
            k = int(np.argmax((self.x >= width) | (self.y >= height)))
            raise EventArrayError(
                f"event at pixel ({self.x[k]}, {self.y[k]}) lies outside the image of "
                f"{width}×{height}: is this the camera's calibration?"
            )

    def check_order(self) -> None:
        """Refuse events that aren't in order of time.

        Raises
        ------
        EventArrayError
            Naming the first that is older than the one before it.
        """
        before, after = self.t_ns[:-1], self.t_ns[1:]
        if not bool(np.all(after >= before)):
            k = int(np.argmax(after < before))
            raise EventArrayError(
                f"event {k + 1} is {(before[k] - after[k]) * 1e-9:.6f} s older than the one before "
                "it; expected events in order of time: see EventArray.sorted_by_time"
            )

    def shifted(self, offset_ns: int) -> EventArray:
        """The same events, `offset_ns` later."""
        return EventArray(self.x, self.y, self.t_ns + np.int64(offset_ns), self.p)

    def compensate_delay(self, delay_s: float) -> EventArray:
        """The same events at the time of what they show, `delay_s` before their stamps."""
        return self.shifted(-round(delay_s * 1e9)) if delay_s else self

    def with_times(self, t_ns: npt.NDArray[np.int64]) -> EventArray:
        """The same events with other time stamps."""
        return EventArray(self.x, self.y, t_ns, self.p)

    def sorted_by_time(self) -> EventArray:
        """The same events in order of time; events of one time keep their order."""
        if len(self) < 2 or bool(np.all(self.t_ns[1:] >= self.t_ns[:-1])):
            return self
        return self[np.argsort(self.t_ns, kind="stable")]


def _whole(
    name: str,
    values: npt.ArrayLike,
    dtype: type[np.integer],
    most_allowed: int | None = None,
    wanted: str = "",
) -> npt.NDArray[Any]:
    """Values as a field's type; numpy would make some pixel or time of NaN, -1 or 70,000.

    A field may hold less than its type, which `wanted` then says.
    """
    array = np.asarray(values)
    low, high = np.iinfo(dtype).min, most_allowed or np.iinfo(dtype).max
    if array.size and (most_allowed or not np.can_cast(array.dtype, dtype)):
        wanted = wanted or f"whole numbers from {low} to {high}"
        if array.dtype.kind not in "buif":
            raise EventArrayError(f"event field '{name}' is {array.dtype}; expected {wanted}")
        least, most = array.min(), array.max()
        # Written so that NaN fails it; the upper limit of int64 is none that a float64 can hold.
        fits = least >= low and most <= high
        if not fits or (array.dtype.kind == "f" and most >= 2.0**63):
            raise EventArrayError(
                f"event field '{name}' holds values from {least} to {most}; expected {wanted}"
            )
        if array.dtype.kind == "f" and (broken := array != np.floor(array)).any():
            raise EventArrayError(
                f"event field '{name}' holds {array[broken][0]:g}; expected {wanted}"
            )
    return np.ascontiguousarray(array, dtype=dtype)


@dataclass(frozen=True, slots=True)
class TriggerArray:
    """Edges on the sensor's trigger inputs."""

    #: Input channel. Shape (n,).
    id: npt.NDArray[np.uint16]
    #: Time in nanoseconds. Shape (n,).
    t_ns: npt.NDArray[np.int64]
    #: 1 = rising, 0 = falling. Shape (n,).
    edge: npt.NDArray[np.uint8]

    @classmethod
    def empty(cls) -> TriggerArray:
        """No edges."""
        return cls(np.empty(0, np.uint16), np.empty(0, np.int64), np.empty(0, np.uint8))

    def __len__(self) -> int:
        return len(self.id)
