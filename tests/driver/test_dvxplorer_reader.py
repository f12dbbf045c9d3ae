"""The reader: packets, faults of the stream, unplugging; against the camera's model."""

import time

import numpy as np
import pytest

from driver.emulation.camera_model import CameraModel, Fault
from driver.emulation.camera_words import encode_words, in_order, is_reference
from driver.emulation.usb_backend import EmulatedBackend
from roller_core.codecs import ENCODED_ENCODINGS, PacketDecoder, encode
from roller_core.events import EventArray
from roller_driver.dvxplorer import protocol as p
from roller_driver.dvxplorer.camera_settings import SensorSettings
from roller_driver.dvxplorer.device import CameraDevice
from roller_driver.dvxplorer.discovery import open_camera
from roller_driver.dvxplorer.errors import CameraControlError
from roller_driver.dvxplorer.packets import Packetiser
from roller_driver.dvxplorer.preview import Preview
from roller_driver.dvxplorer.reader import (
    SEARCHING,
    SILENT,
    STREAMING,
    CameraReader,
    ReaderSettings,
)
from waiting import wait_until


def scan(n=20_000, frames=300, seed=1, start_us=1_000_000):
    """Events on distinct pixels of read-out frames 200 µs apart."""
    rng = np.random.default_rng(seed)
    pixels = np.concatenate([rng.choice(640 * 480, n // frames, replace=False)
                             for _ in range(frames)])  # fmt: skip
    t = np.repeat(np.arange(frames) * 200 + start_us, n // frames)
    events = EventArray.from_arrays(
        pixels % 640, pixels // 640, t * 1000, rng.integers(0, 2, len(t))
    )
    return in_order(events)


class Running:
    """A reader on a model, and what it handed out."""

    def __init__(self, model, sensor=None, on_failure=None, **settings):
        self.backend, self.sensor = EmulatedBackend(model), sensor or SensorSettings()
        self.packets, self.changes = [], []
        self.reader = CameraReader(
            self._connect, self.packets.append,
            on_change=lambda state, fault: self.changes.append((state, fault)),
            on_failure=on_failure, settings=ReaderSettings(retry_s=0.05, **settings),
        )  # fmt: skip

    def _connect(self):
        camera = open_camera(self.backend)
        camera.configure(self.sensor)
        self.ignored = camera.ignored
        return camera

    def __enter__(self):
        self.reader.start()
        return self

    def __exit__(self, *_):
        self.reader.stop()

    @property
    def events(self):
        return EventArray.concatenate([part.events for part in self.packets])

    def wait(self, condition, timeout_s=10.0):
        wait_until(condition, lambda: (self.reader.status, self.changes), timeout_s)

    def wait_for(self, n):
        self.wait(lambda: sum(len(part.events) for part in self.packets) >= n)


@pytest.mark.parametrize("firmware", [8, 10])
def test_biases_are_set_while_it_streams(firmware):
    model = CameraModel(encode_words(scan()).tobytes(), firmware, bytes_per_s=50_000)
    with Running(model) as running:
        running.wait_for(100)
        running.reader.set_biases(SensorSettings(bias_sensitivity=4))
        registers = {(p.MODULE_DVS, p.DVS_THRESHOLD_ON): p.THRESHOLDS[4]} if firmware >= 10 else {
            (p.MODULE_SENSOR, register): values[4] for register, values in p.SENSITIVITY.items()
        }  # fmt: skip
        assert registers.items() <= model.values.items()
        one = SensorSettings(contrast_threshold_on=3)
        if firmware >= 10:
            running.reader.set_biases(one)
            assert model.values[p.MODULE_DVS, p.DVS_THRESHOLD_ON] == 3
        else:
            with pytest.raises(CameraControlError, match="firmware 8 has no contrast_threshold"):
                running.reader.set_biases(one)
        assert running.reader.status.state == STREAMING
        model.unplug()
        running.wait(lambda: running.reader.status.state == SEARCHING)
        running.reader.set_biases(one)  # kept for the next


@pytest.mark.parametrize("where", ["packet", "read", "run"])
def test_a_fault_of_ours_is_handed_on_and_not_a_reader_that_stands_still(where, monkeypatch):
    failed, broken = [], RuntimeError("broken")

    def fail(*_):
        raise broken

    if where != "packet":
        monkeypatch.setattr(CameraDevice, where, fail)
    with Running(CameraModel(encode_words(scan()).tobytes()), None, failed.append) as running:
        if where == "packet":
            running.reader._on_packet = fail
        running.wait(lambda: failed)
    assert failed == [broken]


def test_thresholds_that_an_old_camera_lacks_are_told_and_block_nothing():
    model = CameraModel(encode_words(scan()).tobytes(), 9, bytes_per_s=50_000)
    settings = SensorSettings(contrast_threshold_on=3)
    with Running(model, settings) as running:
        running.wait_for(100)
        assert running.ignored.startswith("firmware 9 has no contrast_threshold_on")
        wanted = settings.changed({"bias_sensitivity": 4})
        running.reader.set_biases(wanted)  # what is changed is there
        values = {(p.MODULE_SENSOR, r): v[4] for r, v in p.SENSITIVITY.items()}
        assert values.items() <= model.values.items()
        for _ in range(2):
            with pytest.raises(CameraControlError, match="9 has no contrast_threshold_on and _off"):
                running.reader.set_biases(wanted.changed({"contrast_threshold_off": 5}))
        running.reader.set_biases(wanted)


def same(a, b):
    a, b = in_order(a), in_order(b)
    return all(np.array_equal(getattr(a, f), getattr(b, f)) for f in ("x", "y", "t_ns", "p"))


@pytest.mark.parametrize("firmware", [8, 10])
def test_all_events_come_in_packets_of_bounded_time(firmware):
    events = scan()
    with Running(CameraModel(encode_words(events).tobytes(), firmware)) as running:
        running.wait_for(len(events))
        assert running.reader.status.state == STREAMING
    assert same(running.events, events)
    for part in running.packets:
        assert 0 <= part.events.t_ns[-1] - part.events.t_ns[0] < 1_000_000
        assert part.time_base_ns == part.events.t_ns[0]
        assert abs(part.arrival_ns - time.time_ns()) < 20e9
    status = running.reader.status
    assert (status.state, status.connects, status.decoder.errors) == ("stopped", 1, 0)
    assert status.packets == len(running.packets)
    assert status.usb.bytes == len(encode_words(events)) * 4


def test_packets_go_through_every_encoding():
    events = scan(6000, 100)
    with Running(CameraModel(encode_words(events).tobytes())) as running:
        running.wait_for(len(events))
    for encoding in ENCODED_ENCODINGS:
        decoder = PacketDecoder(encoding, 640, 480)
        back = [decoder.decode(encode(encoding, part.events, part.time_base_ns),
                               part.time_base_ns).events for part in running.packets]  # fmt: skip
        assert same(EventArray.concatenate(back), events), encoding


def test_short_transfers_stalls_and_odd_lengths_lose_nothing():
    events = scan()
    raw = encode_words(events).tobytes()
    faults = [Fault(1001, "short"), Fault(20_000, "stall"), Fault(30_003, "short"),
              Fault(40_000, "stall")]  # fmt: skip
    with Running(CameraModel(raw, faults=faults), transfer_bytes=16384) as running:
        running.wait_for(len(events))
        assert running.reader.status.usb.stalls == 2
    assert same(running.events, events)
    assert running.reader.status.connects == 1


def test_an_endpoint_that_stays_halted_is_given_up_and_connected_again():
    events = scan(3000, 100)
    model = CameraModel(encode_words(events).tobytes(), faults=[Fault(4000, "stall")])
    model.clear_halt = lambda: None
    with Running(model) as running:
        running.wait(lambda: running.reader.status.connects >= 2)
    assert any("stalled 11 times in a row" in fault for _, fault in running.changes)


def test_unplugged_and_plugged_in_again():
    first, second = scan(seed=1), scan(seed=2, start_us=3_000)
    raw = encode_words(first).tobytes()
    model = CameraModel(raw, faults=[Fault(len(raw) // 2, "unplug")])
    with Running(model) as running:
        running.wait(lambda: not model.plugged)
        running.wait(lambda: "no DVXplorer Mini" in running.reader.status.fault)
        assert running.reader.status.state == SEARCHING
        got = len(running.events)
        assert 0.4 * len(first) < got < 0.6 * len(first)
        model.plug(encode_words(second).tobytes())
        running.wait_for(got + len(second))
    assert same(running.events[got:], second)
    assert running.reader.status.connects == 2
    states = [state for state, _ in running.changes]
    assert states == [SEARCHING, STREAMING, SEARCHING, SEARCHING, STREAMING, "stopped"]


def test_it_waits_for_a_camera():
    events = scan(3000, 100)
    model = CameraModel(encode_words(events).tobytes())
    model.plugged = False
    with Running(model) as running:
        running.wait(lambda: running.reader.status.fault.startswith("no DVXplorer Mini"))
        model.plug()
        running.wait_for(len(events))


def test_lost_references_and_corrupt_words_are_counted():
    events = scan()
    words = encode_words(events)
    lost = np.flatnonzero(is_reference(words))[[7, 30]]
    words = np.insert(np.delete(words, lost), 500, 0x10000000)
    keep = ~np.isin(events.t_ns // 1_000_000, (encode_words(events)[lost] & 0x3FFFFF))
    with Running(CameraModel(words.tobytes())) as running:
        running.wait_for(int(keep.sum()))
    assert same(running.events, events[keep])
    counts = running.reader.status.decoder
    assert (counts.lost_references, counts.bad_words) == (2, 1)


def test_silence_is_reported(monkeypatch):
    monkeypatch.setattr("roller_driver.dvxplorer.reader._SILENT_S", 0.2)
    events = scan(3000, 100)
    raw = encode_words(events).tobytes()
    faults = [Fault(len(raw) // 2, "silence", seconds=0.6)]
    with Running(CameraModel(raw, faults=faults)) as running:
        running.wait_for(len(events))
    states = [state for state, _ in running.changes]
    assert states == [SEARCHING, STREAMING, SILENT, STREAMING, "stopped"]


def test_time_goes_on_over_the_overflow_of_the_reference():
    events = scan(start_us=(2**22 - 20) * 1000)
    with Running(CameraModel(encode_words(events).tobytes())) as running:
        running.wait_for(len(events))
    assert same(running.events, events)


def test_a_packet_holds_no_more_events_than_it_may():
    parts = []
    packetiser = Packetiser(1_000_000, 100, parts.append)
    events = scan(3000, 100)
    packetiser.add(events, 0)
    packetiser.flush()
    assert max(len(part.events) for part in parts) == 100
    assert same(EventArray.concatenate([part.events for part in parts]), events)


def test_a_packet_ends_where_time_steps_back_or_it_gets_old():
    parts = []
    packetiser = Packetiser(1_000_000, 10_000, parts.append)
    early = EventArray.from_arrays([1], [2], [5_000], [1])
    late = EventArray.from_arrays([1, 1], [2, 2], [9_000_000, 9_100_000], [1, 0])
    packetiser.add(EventArray.concatenate([late, early]), 10)
    assert [len(part.events) for part in parts] == [2]
    packetiser.tick(1_000_000)
    assert len(parts) == 1
    packetiser.tick(1_000_010)
    assert [part.time_base_ns for part in parts] == [9_000_000, 5_000]
    assert [part.arrival_ns for part in parts] == [10, 10]


def test_the_preview_shows_both_polarities():
    preview = Preview()
    preview.add(EventArray.from_arrays([3, 3, 5], [4, 4, 6], [0, 0, 0], [1, 1, 0]))
    picture = preview.take()
    assert (picture[4, 3], picture[6, 5], picture[0, 0]) == (224, 80, 128)
    assert np.all(preview.take() == 128)


@pytest.mark.scan
def test_nothing_is_lost_at_thirty_megabytes_a_second():
    events = scan(1_200_000, 2000)
    raw = encode_words(events).tobytes()
    with Running(CameraModel(raw, bytes_per_s=30e6)) as running:
        running.wait(lambda: running.reader.status.usb.bytes >= len(raw), 30)
        running.wait_for(len(events))
    assert same(running.events, events)
    assert running.reader.status.usb.overruns == 0


def test_many_short_transfers_wait_as_well_as_few_long_ones():
    """A decoder that is held up for a while loses nothing, however little a transfer holds."""
    events = scan(60_000, 600)
    raw = encode_words(events).tobytes()
    held = []

    def hold(part):
        if not held:
            held.append(time.sleep(0.5))
        running.packets.append(part)

    # A kilobyte a transfer at most, all of them while the decoder stands.
    running = Running(CameraModel(raw, bytes_per_s=4 * len(raw)), transfer_bytes=1024)
    running.reader._on_packet = hold
    with running:
        running.wait_for(len(events))
        assert running.reader.status.usb.transfers > 100
        assert running.reader.status.usb.overruns == 0
    assert same(running.events, events)


def test_what_comes_too_fast_is_counted_and_the_rest_keeps_its_times(monkeypatch):
    events = scan(200_000, 500)
    raw = encode_words(events).tobytes()
    running = Running(CameraModel(raw, bytes_per_s=5e6), transfer_bytes=4096)

    def slowly(part):
        time.sleep(0.02)
        running.packets.append(part)

    running.reader._on_packet = slowly
    monkeypatch.setattr("roller_driver.dvxplorer.reader._MOST_BYTES", 200_000)
    monkeypatch.setattr("roller_driver.dvxplorer.reader._SILENT_S", 0.2)
    with running:
        running.wait(lambda: running.reader.status.state == SILENT, 30)
        assert running.reader.status.usb.bytes == len(raw)
        assert running.reader.status.usb.overruns > 0
    # What is left has its own times.
    known = set(zip(*(v.tolist() for v in (events.t_ns, events.x, events.y)), strict=True))
    got = running.events
    assert 0 < len(got) < len(events)
    assert set(zip(*(v.tolist() for v in (got.t_ns, got.x, got.y)), strict=True)) <= known


def make_wrong(backend, what):
    """Something that keeps the camera from streaming; returns what undoes it."""
    model = backend.models[0]
    if what == "forbidden" or what == "held":
        setattr(backend, what, True)
        return lambda: setattr(backend, what, False)
    values = {
        "another model": ("model", 0), "firmware too old": ("firmware", 7),
        "no endpoint": ("endpoint_delay_s", 1e9),
    }  # fmt: skip
    name, wrong = values[what]
    right = getattr(model, name)
    setattr(model, name, wrong)
    return lambda: setattr(model, name, right)


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("another model", "is not a DVXplorer Mini"),
        ("held", "another program holds it; stop that program first"),
        ("forbidden", "no permission to open it; install the rule"),
        ("firmware too old", "firmware 7 is not known"),
        ("no endpoint", "it has no endpoint 0x82 for events"),
    ],
)
def test_what_keeps_it_from_streaming_is_reported_until_it_is_gone(what, says, monkeypatch):
    monkeypatch.setattr("roller_driver.dvxplorer.discovery._ENDPOINT_WAIT_S", 0.1)
    events = scan(3000, 100)
    running = Running(CameraModel(encode_words(events).tobytes()))
    undo = make_wrong(running.backend, what)
    with running:
        running.wait(lambda: says in running.reader.status.fault)
        assert running.reader.status.state == SEARCHING
        assert running.reader.status.connects == 0
        assert not running.packets
        undo()
        running.wait_for(len(events))
        assert (running.reader.status.state, running.reader.status.fault) == (STREAMING, "")
    assert same(running.events, events)


def test_a_clock_that_goes_back_is_counted_and_followed():
    """The words of a later scan of lower time, as when another program sets the clock."""
    first, second = scan(3000, 100, start_us=90_000_000), scan(3000, 100, start_us=1_000_000)
    words = np.concatenate([encode_words(first), encode_words(second)])
    with Running(CameraModel(words.tobytes())) as running:
        # The frames before the second reference of the new clock have a time nobody knows.
        running.wait(lambda: running.reader.status.decoder.time_steps == 1)
        running.wait_for(len(first) + len(second) * 9 // 10)
    bases = np.array([part.time_base_ns for part in running.packets])
    assert np.sum(np.diff(bases) < 0) == 1
    assert running.reader.status.connects == 1
    for part in running.packets:
        assert np.all(np.diff(part.events.t_ns) >= 0)
