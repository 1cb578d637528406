"""What messages become on the page, read back from a real server."""

from __future__ import annotations

import re
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from console_bench import grid_map
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState, JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from husky_bringup.console.description import read_description
from husky_bringup.console.page import _SLOWER, PARAMETER_EVENTS, SOURCES, Page
from husky_bringup.console.server import PageServer
from husky_description.robot import ROBOTS, load_robot
from husky_description.urdf import build_urdf
from husky_msgs.msg import (
    ControllerState,
    DriveStatus,
    DriveStatusArray,
    NavigatorState,
    PropulsionState,
)
from husky_runtime import graph


class Seen(Page):
    """A page that is read."""

    def tell(self, topic: str, message: Any, wall_time: float = 0.0) -> None:
        self.take(topic, message, wall_time)

    def show(self, now: float, wall_time: float = 0.0) -> None:
        for _ in range(_SLOWER):
            self.draw(now, wall_time)

    def facts(self) -> dict[str, str]:
        """What stands behind each word."""
        rows = re.findall(r"<tr><td[^>]*>(.*?)</td><td>(.*?)</td></tr>", self._facts._html.content)
        return dict(rows)

    def legend(self, title: str) -> dict[str, float]:
        """The newest value of each curve."""
        html = self._plots[title]._html.content
        return {n: float(v) for n, v in re.findall(r"&#9632;</span> ([^<>]+) <b>(.+?)</b>", html)}


@pytest.fixture
def page(server: PageServer) -> Seen:
    server.scene.reset()
    server.gui.reset()
    return Seen(server, "")


def at(seconds: int) -> Time:
    return Time(sec=seconds)


def test_every_topic_of_the_page_is_one_of_the_graph() -> None:
    assert set(SOURCES) - {PARAMETER_EVENTS} <= {topic.relative for topic in graph.TOPICS}


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_robot_has_its_name_its_links_and_its_ratings(page: Seen, robot: str) -> None:
    numbers = load_robot(robot)
    page.tell(graph.ROBOT_DESCRIPTION, String(data=build_urdf(numbers)))
    ratings = page._robot.ratings
    assert set(ratings) == set(numbers.joint_names) and min(ratings.values()) > 1.0
    assert page._robot.name == f"husky {robot}" and page.skipped == []


def test_torques_are_shares_of_what_each_joint_is_rated_for(page: Seen) -> None:
    urdf = build_urdf(load_robot())
    rated = read_description(urdf).ratings
    names = list(rated)
    page.tell(graph.ROBOT_DESCRIPTION, String(data=urdf))
    effort = [0.01 * index * rated[name] for index, name in enumerate(names)]
    state = JointState(name=names, position=[0.5] * len(names), effort=effort)
    state.header.stamp = at(10)
    page.tell(graph.JOINT_STATES, state)
    page.show(10.0)
    shares = page.legend("joint torques [% of the rating]")
    assert list(shares.values()) == pytest.approx(range(len(names)), abs=1e-6)
    assert set(page.legend("joint angles [deg]").values()) == {28.65}
    page._joints.value = "*_left_*"
    state.header.stamp = at(11)
    page.tell(graph.JOINT_STATES, state)
    page.show(11.0)
    left = [name for name in names if "_left_" in name]
    assert list(page.legend("joint angles [deg]")) == left and 0 < len(left) < len(names)


def test_joints_of_a_robot_that_has_told_no_ratings_have_angles_alone(page: Seen) -> None:
    odd = '<robot name="odd"><joint name="a"><limit effort="much"/></joint></robot>'
    page.tell(graph.ROBOT_DESCRIPTION, String(data=odd))
    page.tell(graph.JOINT_STATES, JointState(name=["a", "b"], position=[1.0], effort=[1.0]))
    page.show(1.0)
    assert list(page.legend("joint angles [deg]")) == ["a"]
    assert page._plots["joint torques [% of the rating]"]._html.content == ""


def test_the_state_in_words(page: Seen) -> None:
    told = ControllerState(mode="walk", gait="trot", reason="velocity command")
    told.commanded_velocity = [0.25, -0.5, 1.0]
    page.tell(graph.CONTROLLER_STATE, told)
    battery = BatteryState(voltage=25.2, percentage=0.5, current=-3.0)
    page.tell(graph.BATTERY, battery)
    fans = PropulsionState(connected=True, armed=True, mode="OFFBOARD", failsafe="link")
    page.tell(graph.PROPULSION_STATE, fans)
    page.show(1.0)
    facts = page.facts()
    assert list(facts)[:3] == ["mode", "why", "gait"] and facts["mode"] == "walk"
    assert facts["command"] == "+0.25 m/s ahead, -0.50 m/s to the left, +1.00 rad/s"
    assert facts["battery"] == "25.2 V, 50 %" and page.legend("battery [V, A]")["current"] == 3.0
    assert facts["fans"] == "armed, OFFBOARD" and facts["fail-safe"] == "link"


def test_drives_in_words(page: Seen) -> None:
    for message, word in (
        (DriveStatusArray(reason="not yet"), "not enabled: not yet"),
        (DriveStatusArray(operational=True), "enabled"),
        (DriveStatusArray(operational=True, emergency_stop=True), "EMERGENCY STOP"),
    ):
        message.drives = [DriveStatus(joint="knee", error="too hot")]
        page.tell(graph.DRIVES_STATUS, message)
        page.show(1.0)
        assert page.facts()["joints"] == word and page.facts()["error"] == "knee: too hot"


def test_the_navigator_in_words(page: Seen) -> None:
    """Nothing of a robot that has none; and no way that is left where it goes nowhere."""
    page.show(1.0)
    assert list(page.facts()) == ["time"]
    told = NavigatorState(phase="following", leg="climb", goals_left=1, refusal="wair: no fans")
    told.distance_left, told.time_left, told.energy_left = 3.25, 12.4, 1449.0
    page.tell(graph.NAVIGATOR_STATE, told)
    page.show(1.0)
    facts = page.facts()
    assert facts["navigator"] == "following, climb" and facts["way left"] == "3.2 m, 12 s, 1.4 kJ"
    assert facts["refused to it"] == "wair: no fans" and "last navigation" not in facts
    page.tell(graph.NAVIGATOR_STATE, NavigatorState(phase="idle", outcome="the goal is reached"))
    page.show(1.0)
    facts = page.facts()
    assert facts["navigator"] == "idle" and facts["last navigation"] == "the goal is reached"
    assert not {"way left", "refused to it"} & set(facts)


def test_a_route_takes_the_place_of_the_last_and_of_nothing_else(page: Seen) -> None:
    """As the navigator tells it; it has a switch of its own."""
    clear = Marker(action=Marker.DELETEALL, ns="route")
    line = Marker(type=Marker.LINE_STRIP, ns="route", points=[Point(), Point(x=1.0)])
    text = Marker(type=Marker.TEXT_VIEW_FACING, ns="route", id=1, text="walk 0.1 kJ")
    force = Marker(type=Marker.ARROW, ns="force")
    for each in (line, text, force):
        each.header.frame_id, each.color.a, each.scale.x = "map", 1.0, 0.1
    page.tell(graph.MARKERS, MarkerArray(markers=[force]))
    page.tell(graph.ROUTE, MarkerArray(markers=[clear, line, text]))
    page.show(1.0)
    names = [f"/scene/map/route/{what}_route" for what in ("lines", "texts")]
    handles = [page._server.scene.get_handle_by_name(name) for name in names]
    assert all(each is not None and each.visible for each in handles)
    page._scene._layers["route"].value = False
    page.show(1.0)
    assert not any(each is not None and each.visible for each in handles)
    page.tell(graph.ROUTE, MarkerArray(markers=[clear]))
    page.show(1.0)
    assert page._scene._route.namespaces() == [] and page.skipped == []
    assert page._scene._drawings.namespaces() == ["force"]


def test_attitude_in_degrees(page: Seen) -> None:
    told = Odometry()
    told.header.stamp = at(10)
    told.pose.pose.orientation.z = told.pose.pose.orientation.w = 0.5**0.5
    page.tell(graph.ODOM, told)
    page.show(10.0)
    assert page.legend("heading [deg]") == {"yaw": 90.0}
    assert page.legend("attitude [deg]") == pytest.approx({"roll": 0.0, "pitch": 0.0}, abs=1e-9)


def test_a_robot_that_says_nothing_any_more_is_silent(page: Seen) -> None:
    page.show(0.0, wall_time=99.0)
    assert page.facts()["time"] == "0.0 s, nothing heard"
    page.tell(graph.CONTROLLER_STATE, ControllerState(), wall_time=100.0)
    page.show(5.0, wall_time=101.0)
    assert page.facts()["time"] == "5.0 s"
    page.tell(graph.DIAGNOSTICS, DiagnosticArray(), wall_time=104.0)
    page.show(5.0, wall_time=104.0)
    assert page.facts()["time"] == "5.0 s, silent for 4 s"


def test_what_was_drawn_goes_when_time_starts_again_and_the_ground_stays(page: Seen) -> None:
    for topic in (graph.MARKERS, graph.TERRAIN):
        marker = Marker(type=Marker.CUBE, ns=topic)
        marker.header.frame_id, marker.color.a = "odom", 1.0
        page.tell(topic, MarkerArray(markers=[marker]))
    page.show(9.0)
    assert page._scene._drawings.namespaces() == [graph.MARKERS]
    assert not page._scene._grid.visible, "the ground is drawn in its place"
    page.show(0.5)
    assert page._scene._drawings.namespaces() == []
    assert page._scene._ground.namespaces() == [graph.TERRAIN]
    assert set(page._scene._layers) == {graph.MARKERS, graph.TERRAIN}


def test_a_namespace_is_switched_on_the_page(page: Seen) -> None:
    marker = Marker(type=Marker.CUBE, ns="mine")
    marker.header.frame_id, marker.color.a = "odom", 1.0
    page.tell(graph.MARKERS, MarkerArray(markers=[marker]))
    page.show(1.0)
    (drawing,) = page._scene._drawings._drawings.values()
    for shown in (False, True):
        page._scene._layers["mine"].value = shown
        page.show(1.0)
        assert drawing.handle.visible == shown


def test_a_map_is_drawn_as_its_switch_says_until_time_starts_again(page: Seen) -> None:
    def drawn() -> list[bool]:
        return [handle.visible for handle in page._scene._map._handles.values()]

    page.show(1.0)
    assert graph.ELEVATION_MAP not in page._scene._layers and drawn() == []
    page.tell(graph.ELEVATION_MAP, grid_map((3, 3), elevation=lambda x, y: x))
    page.show(1.0)
    switch = page._scene._layers[graph.ELEVATION_MAP]
    assert switch.label == "elevation map" and drawn() == [True]
    for shown in (False, True):
        switch.value = shown
        page.show(1.0)
        assert drawn() == [shown]
    page.show(0.5)
    assert drawn() == [False]


def test_the_frame_of_a_map_is_placed(page: Seen) -> None:
    moved = TransformStamped(child_frame_id="odom")
    moved.header.frame_id, moved.transform.translation.z = "world", 2.0
    page.tell(graph.TF, TFMessage(transforms=[moved]))
    page._scene._origin.value = "world"
    page.show(1.0)
    assert "odom" not in page._scene._frames
    page.tell(graph.ELEVATION_MAP, grid_map((3, 3), elevation=lambda x, y: x))
    page.show(1.0)
    frame = page._scene._frames["odom"]
    assert frame.visible and tuple(frame.position) == (0.0, 0.0, 2.0)
