"""The layouts for Foxglove and RViz: what they show is there, and what is there they show."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from husky_description.robot import load_robot
from husky_description.urdf import build_urdf
from husky_runtime import graph

SOURCES = Path(__file__).resolve().parents[2]
LAYOUTS = SOURCES / "husky_bringup" / "layouts"
FRAMES = {
    graph.FRAME_ODOM,
    graph.FRAME_WORLD,
    graph.FRAME_FOOTPRINT,
    graph.FRAME_T265_ODOM,
    *(
        link.get("name")
        for link in ElementTree.fromstring(build_urdf(load_robot())).findall("link")
    ),
}
RVIZ_TYPES = {
    "rviz_default_plugins/RobotModel": "std_msgs/msg/String",
    "rviz_default_plugins/MarkerArray": "visualization_msgs/msg/MarkerArray",
    "rviz_default_plugins/Odometry": "nav_msgs/msg/Odometry",
    "rviz_default_plugins/Map": "nav_msgs/msg/OccupancyGrid",
    "grid_map_rviz_plugin/GridMap": "grid_map_msgs/msg/GridMap",
}
"""Displays and what they subscribe to."""
OTHERS = {"rviz_default_plugins/Grid", "rviz_default_plugins/TF"}
NAMESPACES = {
    "foot_force",
    "foothold",
    "way",
    "thrust",
    "fan_thrust",
    "plan_way",
    "plan_foothold",
    "plan_thrust",
    "plan_force",
}


@pytest.fixture(scope="module")
def foxglove():
    return json.loads((LAYOUTS / "husky.foxglove.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def rviz():
    return yaml.safe_load((LAYOUTS / "husky.rviz").read_text("utf-8"))["Visualization Manager"]


def panels(layout):
    """Panels of a Foxglove mosaic, from its tree."""
    if isinstance(layout, str):
        return [layout]
    assert layout["direction"] in ("row", "column")
    return [*panels(layout["first"]), *panels(layout["second"])]


def test_foxglove_shows_each_panel_once(foxglove):
    shown = panels(foxglove["layout"])
    assert sorted(shown) == sorted(foxglove["configById"])
    assert all(re.fullmatch(r"(3D|Plot|StateTransitions|DiagnosticSummary)!\w+", p) for p in shown)


def test_foxglove_plots_fields_that_there_are(foxglove, typestore):
    """A path is a topic and fields of its type, with indices where the field is an array."""
    types = {topic.name: topic.type for topic in graph.TOPICS}
    paths = [p["value"] for c in foxglove["configById"].values() for p in c.get("paths", ())]
    assert len(paths) > 8
    for path in paths:
        topic, *fields = path.split(".")
        kind = types[topic]
        for field in fields:
            name, index = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", field).groups()
            described = dict(typestore.fielddefs[kind][1])[name]
            assert (index is not None) == (described[0].name in ("ARRAY", "SEQUENCE")), path
            element = described[1][0] if index is not None else described
            kind = element[1] if element[0].name == "NAME" else None
        assert kind is None, f"{path} is no number and no text"


def test_foxglove_shows_the_robot_in_frames_that_there_are(foxglove):
    scene = foxglove["configById"]["3D!robot"]
    assert scene["followTf"] in FRAMES
    assert {name.removeprefix("frame:") for name in scene["transforms"]} == FRAMES
    assert {layer["frameId"] for layer in scene["layers"].values()} <= FRAMES
    shown = {name for name, value in scene["topics"].items() if value["visible"]}
    drawn = (graph.ROBOT_DESCRIPTION, graph.TERRAIN, graph.MARKERS, graph.OCCUPANCY)
    assert shown == {graph.absolute(topic) for topic in drawn}


def test_foxglove_hides_ground_that_was_not_seen(foxglove):
    """A colour is #rrggbbaa; the grid is drawn over the whole map, as high as odom's origin."""
    costs = foxglove["configById"]["3D!robot"]["topics"][graph.absolute(graph.OCCUPANCY)]
    assert costs["colorMode"] == "custom", "the others have colours of their own"
    colours = [costs[f"{which}Color"] for which in ("unknown", "min", "max")]
    assert all(re.fullmatch("#[0-9a-f]{8}", colour) for colour in colours)
    assert [colour.endswith("00") for colour in colours] == [True, False, False]


def test_rviz_shows_what_it_has_a_display_for_by_itself(rviz):
    """A display of a plug-in that is not there would be an error; it waits to be switched on."""
    for display in rviz["Displays"]:
        assert display["Enabled"] == display["Value"]
        assert display["Enabled"] == display["Class"].startswith("rviz_default_plugins/")


def test_rviz_draws_layers_that_the_map_has(rviz):
    """Names in the node's source; importing it takes longer than all of these tests."""
    (drawn,) = (d for d in rviz["Displays"] if d["Class"] == "grid_map_rviz_plugin/GridMap")
    messages = SOURCES / "husky_navigation/husky_navigation/nodes/map_messages.py"
    layers = set(re.findall(r'"(\w+)": (?:ground|surface)\.', messages.read_text("utf-8")))
    assert {drawn["Height Layer"], drawn["Color Layer"]} <= layers


def test_rviz_shows_topics_of_the_type_that_its_displays_take(rviz, typestore):
    types = {topic.name: topic.type for topic in graph.TOPICS}
    latched = {topic.name for topic in graph.TOPICS if topic.qos == "LATCHED"}
    displays = rviz["Displays"]
    assert {display["Class"] for display in displays} == set(RVIZ_TYPES) | OTHERS
    for display in displays:
        wanted = RVIZ_TYPES.get(display["Class"])
        if wanted is not None:
            topic = display.get("Topic") or display["Description Topic"]
            assert types[topic["Value"]] == wanted and wanted in typestore.fielddefs
            durability = "Transient Local" if topic["Value"] in latched else "Volatile"
            assert topic["Durability Policy"] == durability, topic["Value"]
    named = {display["Name"]: display for display in displays}
    assert set(named["Markers"]["Namespaces"]) == NAMESPACES
    assert rviz["Global Options"]["Fixed Frame"] in FRAMES
    (transforms,) = (d for d in displays if d["Class"] == "rviz_default_plugins/TF")
    shown = transforms["Filter (whitelist)"]
    assert {frame for frame in FRAMES if re.search(shown, frame)} == {
        "odom",
        "world",
        "t265_odom",
        "base_footprint",
    }


def test_every_drawing_has_a_name_that_the_layouts_know():
    """Namespaces in the nodes' sources."""
    text = "".join(p.read_text("utf-8") for p in SOURCES.glob("husky_*/husky_*/nodes/*markers.py"))
    literals = set(re.findall(r'"([a-z_]+)"', text))
    assert literals >= NAMESPACES and not {n for n in literals if "plan_" in n} - NAMESPACES
