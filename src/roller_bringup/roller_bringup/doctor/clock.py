"""The host's clock: is it set by NTP, and does it run evenly."""

from __future__ import annotations

import ctypes
import time
from dataclasses import dataclass

from .result import Result, fault, ok, warning

_STA_UNSYNC = 0x0040
_TIME_ERROR = 5
#: A clock that is pulled faster than this is being set right; the clock maps lag behind it.
_MOST_PPM = 150.0
_STEP_S = 1e-3
#: A clock that shows an earlier one has lost the time: an empty battery.
_LEAST_YEAR = 2024


class _Timex(ctypes.Structure):
    """`struct timex` of adjtimex(2)."""

    _fields_ = [
        ("modes", ctypes.c_uint), ("offset", ctypes.c_long), ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long), ("esterror", ctypes.c_long), ("status", ctypes.c_int),
        ("constant", ctypes.c_long), ("precision", ctypes.c_long), ("tolerance", ctypes.c_long),
        ("time_s", ctypes.c_long), ("time_us", ctypes.c_long), ("rest", ctypes.c_char * 200),
    ]  # fmt: skip


@dataclass(frozen=True)
class Reading:
    """The host's clocks at one moment, ns."""

    realtime_ns: int
    monotonic_ns: int
    raw_ns: int

    @classmethod
    def take(cls) -> Reading:
        """Read them, one right after the other."""
        return cls(
            time.clock_gettime_ns(time.CLOCK_REALTIME),
            time.clock_gettime_ns(time.CLOCK_MONOTONIC),
            time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW),
        )


@dataclass(frozen=True)
class ClockFacts:
    """What was found of the host's clock."""

    #: Whether the kernel says that NTP or PTP sets it; None: it doesn't say.
    synchronised: bool | None
    #: The kernel's bound of its error, s.
    max_error_s: float
    #: How much faster it runs than the hardware's counter.
    rate_ppm: float
    #: By how much it jumped while it was watched, s.
    step_s: float
    #: The year that it shows.
    year: int = _LEAST_YEAR


def find_clock(before: Reading, after: Reading) -> ClockFacts:
    """Ask the kernel, and compare two readings that lie a second or more apart."""
    elapsed = max(after.raw_ns - before.raw_ns, 1)
    monotonic = after.monotonic_ns - before.monotonic_ns
    step = (after.realtime_ns - before.realtime_ns) - monotonic
    synchronised, max_error_s = _ask_kernel()
    rate_ppm = (monotonic / elapsed - 1) * 1e6
    year = time.gmtime(after.realtime_ns * 1e-9).tm_year
    return ClockFacts(synchronised, max_error_s, rate_ppm, step * 1e-9, year)


def judge_clock(facts: ClockFacts) -> Result:
    """Whether stamps can be trusted."""
    name = "clock"
    rate = f"{facts.rate_ppm:+.1f} ppm against the hardware's"
    if abs(facts.step_s) > _STEP_S:
        return fault(
            name,
            f"it jumped by {facts.step_s:.3f} s while it was watched",
            "see who sets it (timedatectl; date); let chrony or systemd-timesyncd do it "
            "alone, and not while a scan runs",
        )
    if abs(facts.rate_ppm) > _MOST_PPM:
        return warning(
            name,
            f"it is being pulled: {rate}",
            "wait until NTP has set it right: stamps of events and poses lag meanwhile",
        )
    if facts.year < _LEAST_YEAR:
        return fault(
            name,
            f"it shows the year {facts.year}; {rate}",
            "set it (timedatectl set-time), and see to the machine's battery: recordings, "
            "calibrations and reports carry its date",
        )
    if facts.synchronised is None:
        return ok(name, f"{rate}; the kernel says no more")
    if not facts.synchronised:
        return warning(
            name,
            f"not set by NTP or PTP; {rate}",
            "fine on one machine; for bags of several, install chrony or switch on "
            "systemd-timesyncd (timedatectl set-ntp true)",
        )
    return ok(name, f"set by NTP or PTP, error below {facts.max_error_s * 1e3:.1f} ms; {rate}")


def _ask_kernel() -> tuple[bool | None, float]:
    timex = _Timex()
    try:
        state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(timex))
    except (OSError, AttributeError):
        return None, 0.0
    if state < 0:
        return None, 0.0
    synchronised = state != _TIME_ERROR and not timex.status & _STA_UNSYNC
    return synchronised, timex.maxerror * 1e-6
