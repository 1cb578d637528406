"""The page: what each topic of the robot becomes on it.

Nothing here is of one robot: links come from its description, joints and fans from the names and
lengths in its messages, drawings from its markers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fnmatch import fnmatchcase
from typing import Any

from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState, JointState
from std_msgs.msg import String
from viser import ViserServer

from husky_bringup.console.description import Description, read_description
from husky_bringup.console.drawings import seconds
from husky_bringup.console.frame_tree import Pose
from husky_bringup.console.panels import (
    Facts,
    Reports,
    drives_in_words,
    fans_in_words,
    navigation_in_words,
)
from husky_bringup.console.parameter_panel import ParameterPanel, ParameterSource
from husky_bringup.console.plots import Plot
from husky_bringup.console.scene import Scene
from husky_bringup.robot_state import SILENT
from husky_description.arrays import Array
from husky_description.rotation import to_roll_pitch_yaw
from husky_msgs.msg import ControllerState, DriveStatusArray, NavigatorState, PropulsionState
from husky_runtime import graph

PARAMETER_EVENTS = "/parameter_events"
"""The topic on which every node of ROS tells of its parameters."""
_SLOWER = 8
"""Drawings of the picture to one of plots and words."""


class Page:
    """Takes messages, and draws them when it is told to."""

    def __init__(self, server: ViserServer, title: str, parameters: ParameterSource | None = None):
        """Make the page; it is empty until messages come.

        Args:
            server: of the page.
            title: stands behind the robot's name.
            parameters: that can be read and set; none of a robot that is a record.
        """
        server.gui.configure_theme(
            control_width="large",
            show_logo=False,
            show_share_button=False,
            brand_color=_BRAND,
        )
        server.gui.main_panel.dock_right()
        self._server, self._title = server, title
        self._robot = Description(title or "no robot yet", {}, {}, ())
        server.gui.set_panel_label(self._robot.name)
        self._time, self._turn = 0.0, 0
        self._heard: float | None = None
        tabs = server.gui.add_tab_group()
        with tabs.add_tab("Robot"):
            self._facts = Facts(server.gui, _FACTS)
            self._scene: Scene = Scene(server)
        with tabs.add_tab("Plots"):
            self._joints = server.gui.add_text(
                "joints", "*", hint="names of those that are plotted; * stands for any text"
            )
            self._plots = {title: Plot(server.gui, title) for title in _PLOTS}
        with tabs.add_tab("Diagnostics"):
            self._reports = Reports(server.gui)
        self._parameters: ParameterPanel | None = None
        if parameters is not None:
            with tabs.add_tab("Parameters"):
                self._parameters = ParameterPanel(server.gui, parameters)

    @property
    def skipped(self) -> list[str]:
        """What the robot tells and the page does not draw."""
        return [*self._robot.missing, *self._scene.skipped]

    def take(self, topic: str, message: Any, wall_time: float) -> None:
        """Take a message.

        Args:
            topic: one of `SOURCES`.
            message: of its type.
            wall_time: when it came [s].

        Raises:
            ValueError: there is no sense in it.
        """
        if topic == graph.DIAGNOSTICS:  # which any node tells, also that of the page
            self._reports.tell(message, wall_time)
        elif topic == PARAMETER_EVENTS:  # likewise
            if self._parameters is not None:
                self._parameters.take_event(message)
        else:
            self._heard = wall_time
            _TAKERS[topic](self, message)

    def draw(self, now: float, wall_time: float) -> None:
        """Bring the picture up to date, and now and then plots and words.

        Args:
            now: time of the robot [s]; when it goes back, it has started again.
            wall_time: of now [s].
        """
        if now < self._time:
            self._scene.restart()
        self._time = now
        self._scene.draw(now)
        self._turn = (self._turn + 1) % _SLOWER
        if self._turn == 0:
            self._facts.tell(graph.CLOCK, [("time", f"{now:.1f} s{self._silence(wall_time)}")])
            self._facts.draw()
            self._reports.draw(wall_time)
        elif self._turn == _SLOWER // 2:
            for plot in self._plots.values():
                plot.draw()
            if self._parameters is not None:
                self._parameters.draw(wall_time)

    def _silence(self, wall_time: float) -> str:
        """Return the words for a robot that has said nothing for a while."""
        if self._heard is None:
            return ", nothing heard"
        silent = wall_time - self._heard
        return f", silent for {silent:.0f} s" if silent > SILENT else ""

    def forget(self) -> None:
        """Forget what the robot has told but what it looks like and the ground.

        What comes now is of another time of a record.
        """
        self._time, self._heard = 0.0, None
        self._scene.forget()
        self._facts.clear()
        self._reports.clear()
        for plot in self._plots.values():
            plot.clear()

    def pick(self, origin: Array, direction: Array) -> Pose:
        """Return the goal that a ray of the picture hits; raises ValueError, as `Scene.pick`."""
        return self._scene.pick(origin, direction)

    def close(self) -> None:
        """Ask the robot nothing any more."""
        if self._parameters is not None:
            self._parameters.close()

    # A topic each -----------------------------------------------------------------------------
    def _on_description(self, message: String) -> None:
        self._robot = read_description(message.data)
        self._scene.take_looks(self._robot.looks)
        self._server.gui.set_panel_label(f"{self._robot.name} {self._title}".strip())

    def _on_controller(self, message: ControllerState) -> None:
        x, y, yaw = message.commanded_velocity
        rows = [
            ("mode", message.mode),
            ("why", message.reason),
            ("gait", message.gait),
            ("command", f"{x:+.2f} m/s ahead, {y:+.2f} m/s to the left, {yaw:+.2f} rad/s"),
            ("position in odom", " ".join(f"{value:+.2f}" for value in message.position) + " m"),
        ]
        self._facts.tell(graph.CONTROLLER_STATE, rows)

    def _on_odometry(self, message: Odometry) -> None:
        q, v = message.pose.pose.orientation, message.twist.twist.linear
        roll, pitch, yaw = map(math.degrees, to_roll_pitch_yaw((q.x, q.y, q.z, q.w)))
        now = seconds(message.header.stamp)
        self._plots[_ATTITUDE].add(now, {"roll": roll, "pitch": pitch})
        self._plots[_HEADING].add(now, {"yaw": yaw})
        self._plots[_SPEED].add(now, {"ahead": v.x, "left": v.y, "up": v.z})

    def _on_joints(self, message: JointState) -> None:
        now = seconds(message.header.stamp)
        wanted = str(self._joints.value).strip()  # whatever a client has sent
        angles = zip(message.name, message.position, strict=False)  # either may be left out
        torques = zip(message.name, message.effort, strict=False)
        shown = {name: math.degrees(angle) for name, angle in angles if fnmatchcase(name, wanted)}
        self._plots[_ANGLES].add(now, shown)
        rated = self._robot.ratings
        shares = {
            n: 100.0 * torque / rated[n] for n, torque in torques if n in rated and n in shown
        }
        self._plots[_TORQUES].add(now, shares)

    def _on_drives(self, message: DriveStatusArray) -> None:
        errors = [f"{drive.joint}: {drive.error}" for drive in message.drives if drive.error]
        rows = [("joints", drives_in_words(message)), *(("error", text) for text in errors)]
        self._facts.tell(graph.DRIVES_STATUS, rows)

    def _on_propulsion(self, message: PropulsionState) -> None:
        rows = [("fans", fans_in_words(message))]
        rows += [("fail-safe", message.failsafe)] if message.failsafe else []
        rows += [("autopilot", message.reason)] if message.reason else []
        self._facts.tell(graph.PROPULSION_STATE, rows)
        now, force = seconds(message.stamp), message.force
        values = {"x": force.x, "y": force.y, "z": force.z, "most": message.thrust_limit}
        self._plots[_THRUST].add(now, values)
        speeds = {
            f"fan {index + 1}": speed * 30.0 / math.pi / 1000.0
            for index, speed in enumerate(message.fan_speed)
        }
        self._plots[_FANS].add(now, speeds)

    def _on_battery(self, message: BatteryState) -> None:
        now = seconds(message.header.stamp)
        self._plots[_BATTERY].add(now, {"voltage": message.voltage, "current": -message.current})
        charge = f", {100.0 * message.percentage:.0f} %" if message.percentage >= 0.0 else ""
        self._facts.tell(graph.BATTERY, [("battery", f"{message.voltage:.1f} V{charge}")])

    def _on_navigator(self, message: NavigatorState) -> None:
        self._facts.tell(graph.NAVIGATOR_STATE, navigation_in_words(message))


_FACTS = (
    graph.CONTROLLER_STATE,
    graph.DRIVES_STATUS,
    graph.PROPULSION_STATE,
    graph.BATTERY,
    graph.NAVIGATOR_STATE,
    graph.CLOCK,
)
_BRAND = (176, 32, 48)
_ATTITUDE, _HEADING, _SPEED = "attitude [deg]", "heading [deg]", "speed of the base [m/s]"
_ANGLES, _TORQUES = "joint angles [deg]", "joint torques [% of the rating]"
_THRUST, _FANS, _BATTERY = "thrust in base [N]", "fans [1000/min]", "battery [V, A]"
_PLOTS = (_ATTITUDE, _HEADING, _SPEED, _ANGLES, _TORQUES, _THRUST, _FANS, _BATTERY)

_TAKERS: dict[str, Callable[[Page, Any], None]] = {
    graph.ROBOT_DESCRIPTION: Page._on_description,
    graph.TF_STATIC: lambda page, message: page._scene.take_transforms(message),
    graph.TF: lambda page, message: page._scene.take_transforms(message),
    graph.TERRAIN: lambda page, message: page._scene.take_ground(message),
    graph.MARKERS: lambda page, message: page._scene.take_markers(message),
    graph.ROUTE: lambda page, message: page._scene.take_route(message),
    graph.ELEVATION_MAP: lambda page, message: page._scene.take_map(message),
    graph.CONTROLLER_STATE: Page._on_controller,
    graph.ODOM: Page._on_odometry,
    graph.JOINT_STATES: Page._on_joints,
    graph.DRIVES_STATUS: Page._on_drives,
    graph.PROPULSION_STATE: Page._on_propulsion,
    graph.BATTERY: Page._on_battery,
    graph.NAVIGATOR_STATE: Page._on_navigator,
}
SOURCES = (*_TAKERS, graph.DIAGNOSTICS, PARAMETER_EVENTS)
"""Topics that the page is drawn from."""
PLOTTED = (graph.ODOM, graph.JOINT_STATES, graph.PROPULSION_STATE, graph.BATTERY)
"""Those of which it shows the last seconds (`plots.SPAN`)."""
