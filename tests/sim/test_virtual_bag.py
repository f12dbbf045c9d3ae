import argparse

import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import Reader

from recording.bags import read_messages
from roller_core.bags import EVENT_PACKET
from roller_core.codecs import PacketDecoder
from roller_core.errors import SettingsError, UnwritableOutputError
from roller_core.sensor_pose import SensorFrames
from roller_sim.bag import write_bag
from roller_sim.cell import Packet, VirtualCell
from roller_sim.commands import simulate as command
from roller_sim.errors import TruthError
from roller_sim.truth_files import load_truth, save_truth
from sim import virtual_twins as twins


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags") / "scan"
    settings = twins.small("braille", height=240, scene={"text": "a1", "width_mm": 8.0})
    shares = []
    summary = write_bag(VirtualCell(settings), folder, shares.append)
    assert shares[-1] == 1.0
    return settings, folder, summary


def ns(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


def test_topics_types_and_qualities(written):
    _, folder, summary = written
    with Reader(folder) as reader:
        kinds = {c.topic: c.msgtype for c in reader.connections}
        counts = {c.topic: c.msgcount for c in reader.connections}
        offered = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    assert kinds == {
        "/event_camera/events": EVENT_PACKET,
        "/event_camera/camera_info": "sensor_msgs/msg/CameraInfo",
        "/event_camera/image_raw": "sensor_msgs/msg/Image",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/tf_static": "tf2_msgs/msg/TFMessage",
    }
    assert counts["/event_camera/events"] == summary.packets
    assert counts["/tf"] == summary.poses
    assert offered["/event_camera/events"].reliability.name == "BEST_EFFORT"
    assert offered["/event_camera/events"].depth == 1000
    assert offered["/tf_static"].durability.name == "TRANSIENT_LOCAL"
    metadata = yaml.safe_load((folder / "metadata.yaml").read_text())
    assert metadata["rosbag2_bagfile_information"]["storage_identifier"] == "mcap"


def test_events_come_back_as_they_were_simulated(written):
    settings, folder, summary = written
    again = [i for i in VirtualCell(settings).run() if isinstance(i, Packet)]
    decoder = PacketDecoder("libcaer_cmp", 80, 240)
    count = 0
    for (_, message), want in zip(
        read_messages(folder, "/event_camera/events"), again, strict=True
    ):
        assert message.encoding == "libcaer_cmp"
        assert message.header.frame_id == "event_camera_optical_frame"
        assert ns(message.header.stamp) == want.stamp_ns
        assert message.seq == want.seq
        events = decoder.decode(message.events, message.time_base).events
        for name in ("x", "y", "t_ns", "p"):
            np.testing.assert_array_equal(getattr(events, name), getattr(want.events, name))
        count += len(events)
    assert count == summary.events


def test_transforms_lead_from_base_to_the_camera(written):
    _, folder, _ = written
    truth = load_truth(folder)
    frames = SensorFrames()
    for topic, add in (("/tf_static", frames.add_static), ("/tf", None)):
        for _, message in read_messages(folder, topic):
            (item,) = message.transforms
            t, r = item.transform.translation, item.transform.rotation
            place = (t.x, t.y, t.z), (r.x, r.y, r.z, r.w)
            if add:
                add(item.header.frame_id, item.child_frame_id, *place)
            else:
                stamp = ns(item.header.stamp)
                assert frames.add(item.header.frame_id, item.child_frame_id, stamp, *place)
    when = truth.start_ros_ns + truth.duration_ns // 2
    pose = frames.track.at(when)
    np.testing.assert_allclose(pose.position, truth.camera_positions(when)[0], atol=5e-5)
    np.testing.assert_allclose(pose.matrix[:3, :3], np.diag([1, -1, -1]), atol=1e-4)


def test_camera_info_and_images(written):
    _, folder, summary = written
    ((_, info),) = read_messages(folder, "/event_camera/camera_info")
    assert (info.width, info.height, info.distortion_model) == (80, 240, "plumb_bob")
    np.testing.assert_allclose(info.k, [1066, 0, 39.5, 0, 1066, 119.5, 0, 0, 1])
    images = [m for _, m in read_messages(folder, "/event_camera/image_raw")]
    assert len(images) == summary.images
    assert (images[0].encoding, images[0].step, len(images[0].data)) == ("mono8", 80, 80 * 240)


def test_truth_comes_back(written):
    settings, folder, _ = written
    cell, truth = VirtualCell(settings), load_truth(folder)
    assert truth.text == "a1"
    assert [m.mask for m in truth.marks] == [1, 0b111100, 1]
    assert list(truth.objects) == ["braille"]
    np.testing.assert_array_equal(truth.skin.height, cell.skin.height)
    when = truth.start_ros_ns + truth.duration_ns // 3
    np.testing.assert_array_equal(truth.seen_images(when)[0], cell.truth.seen_images(when)[0])
    np.testing.assert_array_equal(truth.seen_images(when)[1], cell.truth.seen_images(when)[1])
    mark = truth.marks[0]
    dot = mark.x - 1.17e-3, mark.y + 2.34e-3
    on_plate = np.subtract(dot, truth.origin_m[:2])
    assert truth.relief.sample(*on_plate) == pytest.approx(0.48e-3, abs=1e-6)
    assert truth.height_at(*dot) == pytest.approx(0.48e-3, abs=2e-5)
    later = truth.starting_at(truth.start_ros_ns + 10**9)
    np.testing.assert_array_equal(
        later.camera_positions(when + 10**9), truth.camera_positions(when)
    )


def test_defects_come_back_with_the_depth_the_skin_reaches(tmp_path):
    truth = VirtualCell(twins.small("defects", scene={"step_mm": 0.06, "width_mm": 23.0})).truth
    save_truth(truth, tmp_path)
    again = load_truth(tmp_path)
    assert again.defects == truth.defects
    for mark in again.defects:
        assert 0 < mark.skin_depth / mark.depth < 1.01


def test_a_bag_without_truth_says_so(tmp_path):
    with pytest.raises(TruthError, match="only simulated recordings have a truth"):
        load_truth(tmp_path)
    (tmp_path / "truth.yaml").write_text("version: 1\n")
    with pytest.raises(TruthError, match="can't be read"):
        load_truth(tmp_path)


def test_an_existing_folder_is_left_alone(written):
    settings, folder, _ = written
    with pytest.raises(UnwritableOutputError, match="there already"):
        write_bag(VirtualCell(settings), folder)


def parse(*words):
    parser = argparse.ArgumentParser()
    command.add_parser(parser.add_subparsers())
    return parser.parse_args(["simulate", *words])


def test_command_takes_options_over_the_parameter_file(tmp_path):
    file = tmp_path / "cell.yaml"
    file.write_text(
        "virtual_cell: {ros__parameters: {rate: 2.0, motion: {speed: 0.1, hold_s: 0.02}, seed: 9}}"
    )
    args = parse("stairs", "--output", "x", "--speed", "0.4", "--params", str(file),
                 "--set", "light.speckle=0", "--encoding", "mono")  # fmt: skip
    settings = command.settings_from(args)
    assert (settings.motion.speed, settings.motion.hold_s, settings.seed) == (0.4, 0.02, 9)
    assert (settings.scene.name, settings.light.speckle) == ("stairs", 0.0)
    assert settings.packets.encoding == "mono"
    with pytest.raises(SettingsError, match=r"unknown entry 'light\.colour'"):
        command.settings_from(parse("stairs", "--output", "x", "--set", "light.colour=1"))
    huge = "scene.seed=" + "9" * 5000
    for entry in ("scene.name=[1", "scene.name={a: *b}", "scene.name=" + "[" * 5000, huge):
        with pytest.raises(SettingsError, match="can't be read as YAML"):
            command.settings_from(parse("stairs", "--output", "x", "--set", entry))
    with pytest.raises(SettingsError, match="--text: is empty"):
        command.settings_from(parse("braille", "--output", "x", "--text", ""))
    with pytest.raises(SettingsError, match="speed"):
        command.settings_from(parse("stairs", "--output", "x", "--speed", "9"))


def test_command_writes_a_bag(tmp_path, capsys):
    args = parse("flat", "-o", str(tmp_path / "bag"), "--set", "camera.width=32",
                 "--set", "camera.height=16", "--set", "scene.margin_mm=1",
                 "--set", "motion.end_mm=3", "--set", "scene.width_mm=4")  # fmt: skip
    assert args.run(args) == 0
    assert "events in" in capsys.readouterr().out
    assert (tmp_path / "bag" / "truth.yaml").is_file()
