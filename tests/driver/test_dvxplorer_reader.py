"""The reader: packets, biases while it streams, high rates; against the camera's model."""

import time

import numpy as np
import pytest

from driver.emulation.camera_model import CameraModel
from driver.emulation.camera_words import encode_words
from driver.emulation.running_reader import Running, same, scan
from roller_core.codecs import ENCODED_ENCODINGS, PacketDecoder, encode
from roller_core.events import EventArray
from roller_driver.dvxplorer import protocol as p
from roller_driver.dvxplorer.camera_settings import SensorSettings
from roller_driver.dvxplorer.errors import CameraControlError
from roller_driver.dvxplorer.packets import Packetiser
from roller_driver.dvxplorer.preview import Preview
from roller_driver.dvxplorer.reader import SEARCHING, SILENT, STREAMING


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
