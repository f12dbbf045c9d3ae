"""Camera and robot mapped to the host's clock together: drift, jitter, jams and jumps."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import pytest

from roller_core.clock import SensorClock

I64 = npt.NDArray[np.int64]
F64 = npt.NDArray[np.float64]
START_ROS_NS = 1_790_000_000_000_000_000
#: How long nothing arrives; then all that waited comes at once.
JAMS_S = (0.03, 0.1, 0.3, 0.8, 2.5)


@dataclass
class Device:
    """A device that stamps what it sends, and the way to the host."""

    period_ns: int
    drift_ppm: float
    first_ns: int
    least_delay_ns: int
    jitter_ns: Callable[[np.random.Generator, int], F64]
    clock: SensorClock = field(default_factory=SensorClock)

    def run(self, duration_s: float, seed: int, jams: bool = True) -> tuple[I64, I64, I64]:
        """Device times, true times and arrivals."""
        rng = np.random.default_rng(seed)
        true = np.arange(round(duration_s * 1e9 / self.period_ns)) * self.period_ns
        device = self.first_ns + np.rint(true * (1 + self.drift_ppm * 1e-6)).astype(np.int64)
        arrival = true + self.least_delay_ns + self.jitter_ns(rng, len(true))
        begin = 3e9  # one soon after the start
        while jams and begin < true[-1]:
            length = rng.choice(JAMS_S) * 1e9
            first, last = np.searchsorted(true, [begin, begin + length])
            released = begin + length + 20_000.0 * np.arange(last - first)
            arrival[first:last] = np.maximum(arrival[first:last], released)
            begin += length + rng.exponential(20e9)
        arrival = np.rint(np.maximum.accumulate(arrival)).astype(np.int64)
        return device, START_ROS_NS + true, START_ROS_NS + arrival

    def follow(self, device: I64, arrival: I64) -> I64:
        """Each stamp mapped as it came, ROS time."""
        stamps = np.empty(len(device), np.int64)
        for k, (d, a) in enumerate(zip(device.tolist(), arrival.tolist(), strict=True)):
            self.clock.observe(d, a)
            stamps[k] = self.clock.to_ros_ns(d)
        return stamps


def camera(drift_ppm: float) -> Device:
    """Packets whose first event lies anywhere within a millisecond's transfer."""
    return Device(
        4_000_000, drift_ppm, 3_700_000_000, 150_000,
        lambda rng, n: rng.uniform(0, 1e6, n) + rng.exponential(80e3, n),
    )  # fmt: skip


def robot(drift_ppm: float) -> Device:
    """A CB3 controller over TCP, polled every 200 µs."""
    return Device(
        8_000_000, drift_ppm, 1_234_000_000_000, 300_000,
        lambda rng, n: np.abs(rng.normal(0, 320e3, n)) + rng.uniform(0, 200e3, n),
    )  # fmt: skip


@pytest.mark.parametrize("drift_ppm", [50.0, -50.0])
def test_both_drift_and_jam_for_minutes(drift_ppm):
    """After ten seconds within 100 µs of the truth, but for the least delay, and soon 50."""
    for part, (device, seed) in {
        "camera": (camera(drift_ppm), 1), "robot": (robot(-drift_ppm), 2),
    }.items():  # fmt: skip
        times, true, arrival = device.run(300.0, seed)
        error = device.follow(times, arrival) - true - device.least_delay_ns
        since_s = (true - START_ROS_NS) * 1e-9
        assert np.abs(error[since_s > 2.0]).max() < 150_000, part
        assert np.abs(error[since_s > 10.0]).max() < 100_000, part
        assert np.abs(error[since_s > 60.0]).max() < 50_000, part
        # The rate over 0.2 s, a window at 0.1 m/s: 20 ppm are 1 µm of depth.
        step = 200_000_000 // device.period_ns
        rate = (error[step:] - error[:-step]) / (true[step:] - true[:-step])
        assert np.abs(rate[since_s[step:] > 20.0]).max() < 20e-6, part
        assert device.clock.steps == 0, part
        drift = device.drift_ppm * 1e-6
        assert device.clock.skew == pytest.approx(-drift, abs=1e-6), part
        assert 0 < device.clock.scatter_s < 100e-6, part


def test_a_start_within_a_jam_is_recovered():
    """All of the first 1.5 s comes at once, then on time."""
    device = robot(50.0)
    times, true, arrival = device.run(20.0, 3, jams=False)
    first = int(np.searchsorted(true, START_ROS_NS + 1_500_000_000))
    arrival[:first] = np.maximum(arrival[:first], true[first] + 10_000 * np.arange(first))
    error = device.follow(times, arrival) - true - device.least_delay_ns
    later = true - START_ROS_NS > 5_000_000_000
    assert np.abs(error[later]).max() < 150_000


@pytest.mark.parametrize("jump_s", [-3600.0, -0.02, 0.02, 3.0, 3600.0])
def test_the_hosts_clock_is_set(jump_s):
    """A jump of all arrivals at 20 s: the map follows it within 7 s, and once."""
    device = camera(50.0)
    times, true, arrival = device.run(40.0, 4, jams=False)
    jump = round(jump_s * 1e9)
    after = true - START_ROS_NS >= 20_000_000_000
    arrival[after] += jump
    error = device.follow(times, arrival) - true - jump * after - device.least_delay_ns
    settled = (true - START_ROS_NS > 27_000_000_000) | (~after & (true - START_ROS_NS > 1e9))
    assert np.abs(error[settled]).max() < 150_000
    assert device.clock.steps == 1


@pytest.mark.parametrize("jump_s", [-100.0, -1.0, 1.0, 100.0])
def test_the_devices_clock_is_set(jump_s):
    """As when the camera starts anew: at once where time goes back or ahead."""
    device = robot(-50.0)
    times, true, arrival = device.run(40.0, 5, jams=False)
    after = true - START_ROS_NS >= 20_000_000_000
    times[after] += round(jump_s * 1e9)
    error = device.follow(times, arrival) - true - device.least_delay_ns
    assert np.abs(error[true - START_ROS_NS > 22_000_000_000]).max() < 150_000
    assert device.clock.steps == 1


def test_what_comes_late_does_not_start_the_map_anew():
    """Four seconds of nothing, then all of it."""
    device = camera(0.0)
    times, true, arrival = device.run(30.0, 6, jams=False)
    held = (true - START_ROS_NS > 15e9) & (true - START_ROS_NS < 19e9)
    arrival[held] = START_ROS_NS + 19_000_000_000
    stamps = device.follow(times, arrival)
    assert np.abs(stamps - true - device.least_delay_ns)[true - START_ROS_NS > 2e9].max() < 150_000
    assert device.clock.steps == 0


def test_a_device_that_is_started_again_is_no_jump():
    """As when the camera is plugged in again: its time begins at zero, the map with it."""
    device = camera(50.0)
    times, true, arrival = device.run(20.0, 7, jams=False)
    half = len(times) // 2
    before = device.follow(times[:half], arrival[:half])
    device.clock.restart()
    after = device.follow(times[half:] - times[half], arrival[half:])
    error = np.concatenate([before, after]) - true - device.least_delay_ns
    assert np.abs(error[true - true[half] > 2e9]).max() < 150_000
    # The first packet's stamp stands for the map until there are more.
    assert np.abs(error[half:]).max() < 2_000_000
    assert device.clock.steps == 0


def test_many_times_are_mapped_as_few_are():
    clock = SensorClock()
    for k in range(4000):
        clock.observe(10**15 + k * 1_000_000, START_ROS_NS + k * 1_000_050 + k * 7919 % 30_000)
    assert clock.skew != 0.0
    times = 10**15 + np.random.default_rng(1).integers(-(10**9), 10**10, 5000)
    few = [clock.to_ros_ns(part) for part in np.array_split(times, 50)]
    np.testing.assert_array_equal(clock.to_ros_ns(times), np.concatenate(few))


def test_times_given_never_go_back_where_the_first_messages_were_held_up() -> None:
    """The map follows at once in its first second; what it stamped too late stays so."""
    clock, given = SensorClock(), []
    for k in range(100):
        device_ns = k * 8_000_000
        held_ns = 190_000_000 if k < 10 else 0
        clock.observe(device_ns, 1_000_000_000 + device_ns + held_ns)
        given.append(clock.stamp(device_ns))
    assert given[9] == 1_000_000_000 + 9 * 8_000_000 + 190_000_000
    assert given[10] is None
    kept = [stamp for stamp in given if stamp is not None]
    assert (np.diff(kept) > 0).all()
    assert kept[-1] == 1_000_000_000 + 99 * 8_000_000
    assert given.count(None) == 23  # 190 ms of poses
    # A clock that was set again begins anew, earlier or not.
    clock.observe(99 * 8_000_000 - 3_000_000_000, 500_000_000)
    assert clock.steps == 1
    assert clock.stamp(99 * 8_000_000 - 3_000_000_000) == 500_000_000


def test_stamps_never_go_back_by_what_messages_were_held_up() -> None:
    """All messages of the first second and a half come 0.3 s late, then none does."""
    clock, given = SensorClock(), []
    for k in range(500):
        device_ns = k * 8_000_000
        clock.observe(
            device_ns, device_ns + (300_000_000 if device_ns < 1_500_000_000 else 200_000)
        )
        given.append(clock.stamp(device_ns))
    assert clock.steps == 1
    told = [t for t in given if t is not None]
    assert (np.diff(told) > 0).all()
    # Those of the time that was told already are left out, and no others.
    assert len(given) - len(told) == pytest.approx(300 / 8, abs=2)
