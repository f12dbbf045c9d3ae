"""RViz shows what the graph publishes: displays, topics, types and QoS, without RViz."""

from pathlib import Path

import pytest
import yaml

pytest.importorskip("rclpy")

from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy

from roller_ros import qos

ROOT = Path(__file__).parents[2]
PLUGINS = "rviz_default_plugins/"

#: What the built-in displays subscribe to.
TYPES = {
    "Image": "sensor_msgs/msg/Image",
    "PointCloud2": "sensor_msgs/msg/PointCloud2",
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
}
WITHOUT_TOPIC = {"Grid", "TF"}
#: What the nodes publish: the topic's type and the quality of service they use.
CONTRACTS = {
    "roller/depth/image": ("sensor_msgs/msg/Image", qos.DEPTH),
    "event_camera/image_raw": ("sensor_msgs/msg/Image", qos.PREVIEW),
    "roller/surface/points": ("sensor_msgs/msg/PointCloud2", qos.SURFACE),
    "roller/surface/map": ("sensor_msgs/msg/PointCloud2", qos.LATCHED),
    "roller/inspection/markers": ("visualization_msgs/msg/MarkerArray", qos.LATCHED),
    "roller/inspection/deviation": ("sensor_msgs/msg/PointCloud2", qos.SURFACE),
    "roller/braille/markers": ("visualization_msgs/msg/MarkerArray", qos.MARKERS),
}
RELIABILITY = {
    "Reliable": ReliabilityPolicy.RELIABLE,
    "Best Effort": ReliabilityPolicy.BEST_EFFORT,
}
DURABILITY = {
    "Transient Local": DurabilityPolicy.TRANSIENT_LOCAL,
    "Volatile": DurabilityPolicy.VOLATILE,
}


@pytest.fixture(scope="module")
def manager():
    content = yaml.safe_load((ROOT / "config" / "roller.rviz").read_text())
    return content["Visualization Manager"]


@pytest.fixture(scope="module")
def displays(manager):
    return {
        display["Topic"]["Value"]: display for display in manager["Displays"] if "Topic" in display
    }


def test_every_display_is_one_of_rviz(manager):
    for display in manager["Displays"]:
        assert display["Class"].startswith(PLUGINS)
        kind = display["Class"].removeprefix(PLUGINS)
        assert kind in WITHOUT_TOPIC | TYPES.keys()
        assert ("Topic" in display) == (kind in TYPES)
        assert display["Enabled"] is True
        assert display["Value"] is True
    names = [display["Name"] for display in manager["Displays"]]
    assert len(names) == len(set(names))


def test_all_that_people_look_at_is_shown(displays):
    assert displays.keys() == CONTRACTS.keys()


@pytest.mark.parametrize("topic", CONTRACTS)
def test_types_and_qualities_of_service_fit(displays, topic):
    wanted_type, published = CONTRACTS[topic]
    display = displays[topic]
    assert TYPES[display["Class"].removeprefix(PLUGINS)] == wanted_type
    asked = display["Topic"]
    assert asked["History Policy"] == "Keep Last"
    assert published.history == HistoryPolicy.KEEP_LAST
    assert asked["Depth"] >= 1
    # Asking for what is offered: asking for more connects nothing, for less loses something.
    assert RELIABILITY[asked["Reliability Policy"]] == published.reliability
    assert DURABILITY[asked["Durability Policy"]] == published.durability


def test_depth_has_the_range_of_the_skin(displays):
    depth = displays["roller/depth/image"]
    assert depth["Normalize Range"] is False
    assert (depth["Min Value"], depth["Max Value"]) == (0.043, 0.047)


def test_the_surface_is_coloured_by_a_field_it_has(displays):
    surface = displays["roller/surface/points"]
    assert surface["Color Transformer"] == "Intensity"
    assert surface["Channel Name"] in {"height", "confidence"}


def test_the_fixed_frame_is_base(manager):
    assert manager["Global Options"]["Fixed Frame"] == "base"
    assert manager["Views"]["Current"]["Target Frame"] == "base"


def test_launch_files_start_it(request):
    text = (ROOT / "launch" / "processing.launch.xml").read_text()
    assert "share roller_bringup)/config/roller.rviz" in text
