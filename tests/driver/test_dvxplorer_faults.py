"""Faults of the stream, unplugging and what keeps the camera from streaming; against its model."""

import numpy as np
import pytest

from driver.emulation.camera_model import CameraModel, Fault
from driver.emulation.camera_words import encode_words, is_reference
from driver.emulation.running_reader import Running, same, scan
from roller_driver.dvxplorer.device import CameraDevice
from roller_driver.dvxplorer.reader import SEARCHING, SILENT, STREAMING


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
