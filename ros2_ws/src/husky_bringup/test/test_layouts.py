"""The layouts for Foxglove and RViz: what they show is there, and what is there they show."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from rosbags.typesys import Stores, get_typestore

from husky_description.robot import load_robot
from husky_description.urdf import build_urdf
from husky_runtime import graph

LAYOUTS = Path(__file__).resolve().parents[1] / "layouts"
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
}
"""Displays of rviz_default_plugins and what they subscribe to."""
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
    drawn = (graph.ROBOT_DESCRIPTION, graph.TERRAIN, graph.MARKERS)
    assert shown == {graph.absolute(topic) for topic in drawn}


def test_rviz_shows_topics_of_the_type_that_its_displays_take(rviz):
    types = {topic.name: topic.type for topic in graph.TOPICS}
    latched = {topic.name for topic in graph.TOPICS if topic.qos == "LATCHED"}
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    displays = rviz["Displays"]
    assert {display["Class"] for display in displays} == set(RVIZ_TYPES) | OTHERS
    for display in displays:
        wanted = RVIZ_TYPES.get(display["Class"])
        if wanted is not None:
            topic = display.get("Topic") or display["Description Topic"]
            assert types[topic["Value"]] == wanted and wanted in jazzy.fielddefs
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
    sources = Path(__file__).resolve().parents[2]
    text = "".join(p.read_text("utf-8") for p in sources.glob("husky_*/husky_*/nodes/*markers.py"))
    literals = set(re.findall(r'"([a-z_]+)"', text))
    assert literals >= NAMESPACES and not {n for n in literals if "plan_" in n} - NAMESPACES
