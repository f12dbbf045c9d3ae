"""Of two cameras that send at once one is recorded, and what is recorded can be processed."""

from dataclasses import replace

from recording.bags import Recipe, raw_messages
from roller_core.codecs import RawPacket
from roller_recording.raw_message import RawMessage
from roller_recording.writing import Losses
from roller_recording.writing.one_camera import OneCamera

EVENTS, CAMERA_INFO = "/event_camera/events", "/event_camera/camera_info"
#: Publishers; the first twelve bytes are the process's.
OURS, OUR_INFO = b"process ours" + b"0001", b"process ours" + b"0002"
THEIRS, THEIR_INFO = b"other's proc" + b"0001", b"other's proc" + b"0002"


def packet(t_ms: int, sender: bytes) -> RawMessage:
    return RawMessage(t_ms * 10**6, EVENTS, b"packet", sender=sender)


def info(t_ms: int, sender: bytes, said: bytes) -> RawMessage:
    return RawMessage(t_ms * 10**6, CAMERA_INFO, said, sender=sender)


def two_cameras() -> list[RawMessage]:
    """Two processes that send the same scan, one 3 ms after the other."""
    scan = raw_messages(Recipe())
    ours = [replace(m, sender=OUR_INFO if m.topic == CAMERA_INFO else OURS) for m in scan]
    theirs = [
        replace(m, t_ns=m.t_ns + 3 * 10**6, sender=THEIR_INFO if m.topic == CAMERA_INFO else THEIRS)
        for m in scan
        if m.topic in (EVENTS, CAMERA_INFO)
    ]
    return sorted([*ours, *theirs])


def test_the_first_is_recorded_and_packets_of_the_other_are_counted() -> None:
    sent, losses = two_cameras(), Losses()
    camera = OneCamera(EVENTS, CAMERA_INFO, losses)
    kept = [m for k in range(0, len(sent), 7) for m in camera.keep(sent[k : k + 7])]
    assert kept == [m for m in sent if m.sender not in (THEIRS, THEIR_INFO)]
    numbers = [RawPacket.parse(m.data).seq for m in kept if m.topic == EVENTS]
    assert numbers == list(range(len(numbers)))
    assert losses.foreign_packets == len(numbers) > 10
    assert losses.total == 0  # of the one that is recorded nothing is missing
    (line,) = losses.lines(sent[0].t_ns)
    assert line.startswith("another camera sent at the same time (stop all but one), not written: ")
    assert losses.notes()["event_packets_of_other_cameras"] == str(losses.foreign_packets)


def test_after_a_silence_the_other_is_recorded_with_what_it_said() -> None:
    camera = OneCamera(EVENTS, CAMERA_INFO, Losses())
    sent = [info(0, OUR_INFO, b"ours"), info(1, THEIR_INFO, b"theirs")]
    sent += [packet(10, OURS), packet(20, THEIRS), packet(700, THEIRS), packet(710, OURS)]
    kept = camera.keep(sent)
    said = info(700, THEIR_INFO, b"theirs")  # when it begins to hold
    assert kept == [sent[0], sent[2], said, sent[4]]


def test_a_calibration_of_the_wrong_process_gives_way_to_that_of_the_events() -> None:
    camera = OneCamera(EVENTS, CAMERA_INFO, Losses())
    sent = [info(0, THEIR_INFO, b"theirs"), info(1, OUR_INFO, b"ours"), packet(2, OURS)]
    assert camera.keep(sent) == [sent[0], info(2, OUR_INFO, b"ours"), sent[2]]


def test_the_calibration_of_one_that_is_gone_gives_way() -> None:
    """The node that says it need not be the one that sends events."""
    camera = OneCamera(EVENTS, CAMERA_INFO, Losses())
    first, second = info(0, b"a publisher, one", b"first"), info(1, b"a publisher, two", b"second")
    assert camera.keep([first, second, packet(2, OURS)]) == [first, packet(2, OURS)]
    camera.see_publishers({first.sender, second.sender})
    assert camera.keep([packet(3, OURS)]) == [packet(3, OURS)]
    camera.see_publishers({second.sender})
    assert camera.keep([packet(4, OURS)]) == [replace(second, t_ns=4 * 10**6), packet(4, OURS)]


def test_senders_that_are_not_told_are_all_recorded() -> None:
    sent = [replace(m, sender=b"") for m in two_cameras()]
    assert OneCamera(EVENTS, CAMERA_INFO, Losses()).keep(sent) == sent
