import numpy as np
import pytest

from roller_core.events import EventArray
from roller_sim.cell import Packet, Picture, PoseSample, VirtualCell
from roller_sim.motion import PACKET_LATENCY_US
from sim import virtual_twins as twins


def run(settings):
    cell = VirtualCell(settings)
    return cell, list(cell.run())


@pytest.fixture(scope="module")
def scan():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("roller_sim.cell._PACKET_EVENTS", 300)
        return run(twins.small("three_lines"))


def test_everything_comes_in_order_of_arrival(scan):
    cell, items = scan
    arrivals = [item.arrival_ns for item in items]
    assert arrivals == sorted(arrivals)
    kinds = {
        kind: sum(isinstance(i, kind) for i in items) for kind in (Packet, PoseSample, Picture)
    }
    assert kinds[PoseSample] == len(cell.poses.stamp_ns)
    assert kinds[Picture] == np.ceil(cell.duration_s * 25)
    assert sum(len(i.events) for i in items if isinstance(i, Packet)) == cell.event_count > 1000
    assert cell.progress == 1.0


def test_packets_are_short_small_and_stamped_on_arrival(scan):
    cell, items = scan
    packets = [i for i in items if isinstance(i, Packet)]
    assert [p.seq for p in packets] == list(range(len(packets)))
    rate = 1 + 15e-6
    delays = []
    for p in packets:
        t = p.events.t_ns
        assert 1 <= len(t) <= 300
        assert t[0] == p.time_base_ns
        assert t[-1] - t[0] < 1_000_000
        assert (np.diff(t) >= 0).all()
        assert p.events.x.max() < 80
        assert p.events.y.max() < 48
        true = cell.truth.start_ros_ns + (int(t[0]) - 3_700_000_000) / rate
        delays.append((p.stamp_ns - true) * 1e-3)
        assert p.stamp_ns <= p.arrival_ns
    assert min(delays) >= 149.0
    assert 200 < np.mean(delays) < 260
    times = np.concatenate([p.events.t_ns for p in packets])
    assert (np.diff(times) >= 0).all()


def test_pictures_show_what_is_there(scan):
    cell, items = scan
    pictures = [i for i in items if isinstance(i, Picture)]
    assert pictures[1].image.shape == (48, 80)
    assert pictures[1].image.dtype == np.uint8
    np.testing.assert_array_equal(pictures[1].image, cell.picture(pictures[1].stamp_ns))
    assert 60 < pictures[0].image.mean() < 220


def test_a_seed_decides_everything():
    settings = twins.small("three_lines", width=48, height=24)
    one, two = (run(settings)[1] for _ in range(2))
    other = run(settings.model_copy(update={"seed": 2}))[1]
    assert len(one) == len(two)
    for a, b in zip(one, two, strict=True):
        assert (type(a), a.stamp_ns, a.arrival_ns) == (type(b), b.stamp_ns, b.arrival_ns)
        if isinstance(a, Packet):
            np.testing.assert_array_equal(a.events.x, b.events.x)
            np.testing.assert_array_equal(a.events.t_ns, b.events.t_ns)
    count = [sum(len(i.events) for i in s if isinstance(i, Packet)) for s in (one, other)]
    assert count[0] != count[1]


def test_events_a_pixel_of_travel_do_not_depend_on_speed():
    counts = []
    for speed in (0.05, 0.5):
        cell = VirtualCell(
            twins.small("three_lines", width=64, height=24, sensor=twins.QUIET,
                        light={"speckle": 0.0},
                        motion={"speed": speed, "acceleration": 100.0, "vibration_um": 0.0})
        )  # fmt: skip
        counts.append(sum(len(e) for _, e in cell.raw_events()))
    assert counts[0] > 2000
    assert counts[1] == pytest.approx(counts[0], rel=0.01)


def test_events_are_sharp_at_the_true_depth_and_blurred_elsewhere():
    cell = VirtualCell(
        twins.small("stairs", width=640, height=24, sensor={"background_hz": 0.0},
                    motion={"start_mm": -12.0, "end_mm": 15.0})
    )  # fmt: skip
    events = EventArray.concatenate([e for _, e in cell.raw_events()])
    t = (cell.sensor_to_ros_ns(events.t_ns) - cell.truth.start_ros_ns) * 1e-9
    late = (cell.truth.event_delay_ns - PACKET_LATENCY_US * 1e3) * 1e-9
    x = cell.path.along(t - late)
    # The first riser goes from 45 mm, the plate's face, to 44.8 mm.
    edge = cell.scene.regions[0].x0
    fx, cx = cell.camera.fx, cell.camera.cx

    def sharpness(depth):
        place = x + (events.x - cx) / fx * depth
        near = np.abs(place - edge) < 0.6e-3
        count, _ = np.histogram(place[near], np.arange(edge - 0.6e-3, edge + 0.6e-3, 20e-6))
        return float((count.astype(float) ** 2).sum()) / max(near.sum(), 1) ** 2

    focus = {depth: sharpness(depth) for depth in (43.2e-3, 44.9e-3, 46.6e-3)}
    assert focus[44.9e-3] > 1.5 * max(focus[43.2e-3], focus[46.6e-3])


def test_a_distorted_camera_sees_through_its_lens():
    settings = twins.small("flat", camera={"distortion": [-0.2, 0.05, 0.0, 0.0, 0.0]})
    cell = VirtualCell(settings)
    assert cell.camera.is_distorted
    corner = cell.truth.seen_at(cell.truth.start_ros_ns, [[0.0, 0.0]])[0]
    assert corner[0] == pytest.approx(45e-3, abs=2e-5)
