"""A recorded run as a few numpy tables, read from its bag when they are first asked for."""

from __future__ import annotations

from dataclasses import fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from husky_bringup.cdr_table import Columns, decode
from husky_bringup.tables import (
    Array,
    Base,
    Battery,
    Contacts,
    ControllerStates,
    Drives,
    EstimateErrors,
    Fans,
    Imu,
    JointCommands,
    Joints,
    Propulsion,
    PropulsionCommands,
)
from husky_description import graph


class MissingTopicError(LookupError):
    """A recording holds no message of a topic."""


class Recording:
    """A bag, read when a topic is first asked for and decoded topic by topic.

    Attributes:
        path: the bag.
        counts: messages by topic.
        start, end: first and last log time [s].
    """

    def __init__(self, path: Path | str):
        """Open a bag.

        Raises:
            FileNotFoundError: there is none.
            rosbags.highlevel.AnyReaderError: it cannot be read.
        """
        self.path = Path(path)
        with AnyReader([self.path]) as reader:
            self.counts = {name: info.msgcount for name, info in reader.topics.items()}
            empty = reader.message_count == 0
            self.start = 0.0 if empty else reader.start_time / 1e9
            self.end = 0.0 if empty else (reader.end_time - 1) / 1e9  # it ends after the last
        self._columns: dict[str, tuple[Array, Columns]] = {}

    def has(self, topic: str) -> bool:
        """Return whether there is any message of a topic."""
        return self.counts.get(topic, 0) > 0

    def columns(self, topic: str, *, alike: bool = False) -> tuple[Array, Columns]:
        """Return log times [s] (n,) and all fields of a topic, see `cdr_table.decode`.

        Args:
            topic: full name.
            alike: leave out messages that are not as long as the last one, because a sequence in
                them was still empty, say.

        Raises:
            MissingTopicError: there is no message of the topic.
        """
        if not self.has(topic):
            raise MissingTopicError(f"{self.path} has no messages of {topic}")
        if topic not in self._columns:
            times, messages, message_type = self._messages.pop(topic)
            if alike:
                keep = [i for i, m in enumerate(messages) if len(m) == len(messages[-1])]
                times, messages = [times[i] for i in keep], [messages[i] for i in keep]
            decoded = decode(messages, self._typestore, message_type)
            self._columns[topic] = np.array(times, np.float64) / 1e9, decoded
        return self._columns[topic]

    @cached_property
    def _messages(self) -> dict[str, tuple[list[int], list[bytes], str]]:
        """Log times [ns], messages and their type, by topic: one pass over the whole bag."""
        found: dict[str, tuple[list[int], list[bytes], str]] = {}
        with AnyReader([self.path]) as reader:
            self._typestore: Any = reader.typestore
            for connection in reader.connections:
                found.setdefault(connection.topic, ([], [], connection.msgtype))
            for connection, time, message in reader.messages():
                times, messages, _ = found[connection.topic]
                times.append(time)
                messages.append(message)
        return found

    @cached_property
    def joints(self) -> Joints:
        """Measured joint states, 500 Hz."""
        time, column = self.columns(graph.JOINT_STATES)
        return Joints(time, column["position"], column["velocity"], column["effort"])

    @cached_property
    def commands(self) -> JointCommands:
        """Commands to the joints, 500 Hz."""
        time, column = self.columns(graph.JOINT_COMMAND)
        return JointCommands(
            time,
            column["mode_of_operation"],
            column["position"],
            column["velocity"],
            column["effort"],
        )

    @cached_property
    def base(self) -> Base:
        """True motion of the base, 100 Hz."""
        return self._odometry(graph.GROUND_TRUTH)

    @cached_property
    def estimate(self) -> Base:
        """Estimated motion of the base, 50 Hz."""
        return self._odometry(graph.ODOMETRY)

    def _odometry(self, topic: str) -> Base:
        """Read an Odometry; its linear velocity is in base axes (REP-105) and turned to world."""
        time, column = self.columns(topic)
        orientation = column["pose.pose.orientation"]
        velocity = Rotation.from_quat(orientation).apply(column["twist.twist.linear"])
        return Base(
            time, column["pose.pose.position"], orientation, velocity, column["twist.twist.angular"]
        )

    @cached_property
    def contacts(self) -> Contacts:
        """True forces of the ground on the feet, 100 Hz."""
        time, column = self.columns(graph.FOOT_CONTACTS)
        return Contacts(time, column["contact"], column["force"], column["position"])

    @cached_property
    def controller(self) -> ControllerStates:
        """State of the controller, 50 Hz."""
        time, column = self.columns(graph.CONTROLLER_STATE)
        names = [field.name for field in fields(ControllerStates) if field.name != "time"]
        return ControllerStates(time, **{name: column[name] for name in names})

    @cached_property
    def estimate_error(self) -> EstimateErrors:
        """Estimate minus truth, 50 Hz."""
        time, column = self.columns(graph.ESTIMATE_ERROR)
        return EstimateErrors(time, column["position"], column["velocity"], column["attitude"])

    @cached_property
    def imu(self) -> Imu:
        """IMU samples, 800 Hz."""
        time, column = self.columns(graph.IMU)
        return Imu(
            time,
            column["orientation"],
            column["angular_velocity"],
            column["linear_acceleration"],
        )

    @cached_property
    def drives(self) -> Drives:
        """State of the drives, 10 Hz."""
        time, column = self.columns(graph.DRIVES_STATUS)

        def each(field: str) -> NDArray[Any]:
            return np.stack([column[f"drives[{i}].{field}"] for i in range(12)], axis=1)

        return Drives(
            time,
            column["operational"],
            column["emergency_stop"],
            each("state"),
            each("error_code"),
            each("bus_voltage"),
            each("current"),
            each("following_error"),
        )

    # The propulsion unit ------------------------------------------------------------------------
    @cached_property
    def fans(self) -> Fans:
        """The truth about fans, battery and ropes, 100 Hz."""
        time, column = self.columns(graph.FAN_STATE)
        names = [field.name for field in fields(Fans)]
        same = {name: column[name] for name in names if name in column}
        return Fans(time, force=column["wrench.force"], moment=column["wrench.torque"], **same)

    @cached_property
    def propulsion(self) -> Propulsion:
        """State of the propulsion unit as its autopilot reports it, 50 Hz."""
        time, column = self.columns(graph.PROPULSION_STATE)
        names = [field.name for field in fields(Propulsion) if field.name != "time"]
        return Propulsion(time, **{name: column[name] for name in names})

    @cached_property
    def propulsion_commands(self) -> PropulsionCommands:
        """Commands to the propulsion unit, 100 Hz."""
        time, column = self.columns(graph.PROPULSION_COMMAND)
        return PropulsionCommands(
            time, column["kind"], column["attitude"], column["force"], column["moment"]
        )

    @cached_property
    def battery(self) -> Battery:
        """The battery as the bridge tells it, 10 Hz, once it knows the cells."""
        time, column = self.columns(graph.BATTERY, alike=True)
        voltage, current, share = (
            column[name].astype(np.float64) for name in ("voltage", "current", "percentage")
        )
        return Battery(time, voltage, current, share)

    @cached_property
    def t265(self) -> Base:
        """Motion of the camera `t265_link` in its own world `t265_odom`, 200 Hz."""
        return self._odometry(graph.T265_ODOMETRY)
