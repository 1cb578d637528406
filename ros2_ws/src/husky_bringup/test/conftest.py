"""A short synthetic run whose figures are known in closed form."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from rosbags.interfaces import (
    Nodetype,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from scipy.spatial.transform import Rotation

from husky_bringup.bag import BagWriter, make_typestore
from husky_description import graph
from husky_description.robot import JOINT_NAMES, load_robot

MESSAGES = Path(__file__).resolve().parents[2] / "husky_msgs" / "msg"
FOREVER = QosTime(9223372036, 854775807)
NONE, WRENCH = 0, 2
"""Kinds of a PropulsionCommand."""


def profile(reliability: QosReliability, depth: int) -> Qos:
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        reliability,
        QosDurability.VOLATILE,
        FOREVER,
        FOREVER,
        QosLiveliness.AUTOMATIC,
        FOREVER,
        False,
    )


@pytest.fixture(scope="session")
def typestore() -> Any:
    return make_typestore(MESSAGES)


@pytest.fixture(scope="session")
def profiles() -> dict[str, Qos]:
    reliable = profile(QosReliability.RELIABLE, 10)
    return {
        "CONTROL": profile(QosReliability.BEST_EFFORT, 16),
        "STATUS": reliable,
        "COMMAND": reliable,
        "LATCHED": reliable._replace(durability=QosDurability.TRANSIENT_LOCAL, depth=1),
        "CLOCK": profile(QosReliability.BEST_EFFORT, 1),
    }


class Messages:
    """Makes serialized messages."""

    def __init__(self, typestore: Any):
        self._store = typestore
        self._types = typestore.types

    def pack(self, kind: str, /, **fields: Any) -> bytes:
        """Serialize a message; fields that are not given are zero or empty."""
        data: bytes = bytes(self._store.serialize_cdr(self._fill(kind, fields), kind))
        return data

    def _fill(self, kind: str, fields: dict[str, Any]) -> Any:
        known = self._store.fielddefs[kind][1]
        return self._types[kind](
            **{name: self._zero(description) for name, description in known} | fields
        )

    def _zero(self, description: Any) -> Any:
        node, inner = description
        if node == Nodetype.NAME:
            return self._fill(inner, {})
        if node == Nodetype.BASE:
            return "" if inner[0] == "string" else np.zeros(1, inner[0])[0].item()
        (element_node, element), count = inner
        count = count if node == Nodetype.ARRAY else 0
        if element_node == Nodetype.BASE and element[0] != "string":
            return np.zeros(count, element[0])
        return [self._zero((element_node, element)) for _ in range(count)]

    def stamp(self, time_ns: int) -> Any:
        return self._types["builtin_interfaces/msg/Time"](*divmod(time_ns, 1_000_000_000))

    def header(self, time_ns: int, frame: str = "") -> Any:
        return self._types["std_msgs/msg/Header"](self.stamp(time_ns), frame)

    def _make(self, kind: str, values: Iterable[float]) -> Any:
        return self._types[f"geometry_msgs/msg/{kind}"](*map(float, values))

    def quaternion(self, turn: Rotation) -> Any:
        return self._make("Quaternion", turn.as_quat())

    def vector(self, values: Iterable[float]) -> Any:
        return self._make("Vector3", values)

    def wrench(self, force: Iterable[float], torque: Iterable[float]) -> Any:
        return self._types["geometry_msgs/msg/Wrench"](self.vector(force), self.vector(torque))

    def joint_states(self, time_ns: int, position: Any, velocity: Any, effort: Any) -> bytes:
        return self.pack(
            "sensor_msgs/msg/JointState",
            header=self.header(time_ns),
            name=list(JOINT_NAMES),
            position=np.asarray(position, float),
            velocity=np.asarray(velocity, float),
            effort=np.asarray(effort, float),
        )

    def joint_command(self, time_ns: int, mode: int, position: Any) -> bytes:
        return self.pack(
            "husky_msgs/msg/JointCommand",
            stamp=self.stamp(time_ns),
            mode_of_operation=mode,
            position=np.asarray(position, float),
        )

    def odometry(
        self, time_ns: int, position: Any, orientation: Any, velocity: Any, rate: Any
    ) -> bytes:
        make = self._types
        pose = make["geometry_msgs/msg/PoseWithCovariance"](
            make["geometry_msgs/msg/Pose"](
                self._make("Point", position), self._make("Quaternion", orientation)
            ),
            np.zeros(36),
        )
        twist = make["geometry_msgs/msg/TwistWithCovariance"](
            make["geometry_msgs/msg/Twist"](self.vector(velocity), self.vector(rate)),
            np.zeros(36),
        )
        return self.pack(
            "nav_msgs/msg/Odometry",
            header=self.header(time_ns, graph.FRAME_WORLD),
            child_frame_id=graph.FRAME_BASE,
            pose=pose,
            twist=twist,
        )

    def foot_contacts(self, time_ns: int, contact: Any, force: Any, position: Any) -> bytes:
        return self.pack(
            "husky_msgs/msg/FootContacts",
            stamp=self.stamp(time_ns),
            contact=np.asarray(contact, np.bool_),
            force=[self.vector(row) for row in force],
            position=[self._make("Point", row) for row in position],
        )

    def controller_state(self, time_ns: int, mode: str, **fields: Any) -> bytes:
        upright = {"orientation": np.array([0.0, 0.0, 0.0, 1.0])}
        return self.pack(
            "husky_msgs/msg/ControllerState",
            **({"stamp": self.stamp(time_ns), "mode": mode, "gait": "trot"} | upright | fields),
        )


@pytest.fixture(scope="session")
def messages(typestore: Any) -> Messages:
    return Messages(typestore)


WriteBag = Callable[[Path, Iterable[tuple[str, bytes]]], BagWriter]


@pytest.fixture(scope="session")
def write_bag(typestore: Any, profiles: dict[str, Qos]) -> WriteBag:
    """Write (topic, message) pairs to a bag and close it."""

    def write(path: Path, content: Iterable[tuple[str, bytes]]) -> BagWriter:
        writer = BagWriter(path, graph.TOPICS, profiles, typestore)
        channels = {channel.topic.name: channel for channel in writer.channels}
        for topic, message in content:
            writer.write(channels[topic], message)
        writer.close()
        return writer

    return write


class Walk:
    """The synthetic run: one second of standing, then two of walking along a heading.

    Attributes are the numbers that it was made of.
    """

    duration = 3.0
    walking_from = 1.0
    speed = 0.5
    yaw = 0.3
    roll_amplitude = np.radians(2.0)
    pitch = np.radians(1.0)
    height = 0.545
    height_offset = 0.004
    torque = (1.0, 3.0, 6.0)
    tracking_error = 0.01
    period = 0.4
    normal_force = 40.0
    tangential_force = 10.0
    estimate_offset = np.array([0.1, 0.0, 0.003])

    def travelled(self, time: float) -> float:
        return self.speed * max(0.0, time - self.walking_from)

    def joint_position(self, time: float) -> Any:
        return 0.2 * np.sin(2.0 * np.pi * time + np.arange(12))

    def base(self, time: float) -> tuple[Any, Any, Any]:
        """Position, orientation, velocity in base."""
        way = self.travelled(time)
        heading = np.array([np.cos(self.yaw), np.sin(self.yaw)])
        roll = self.roll_amplitude * np.sin(2.0 * np.pi * time)
        turn = Rotation.from_euler("ZYX", (self.yaw, self.pitch, roll))
        speed = self.speed if time >= self.walking_from else 0.0
        velocity = turn.inv().apply([*(speed * heading), 0.0])
        return np.array([*(way * heading), self.height]), turn.as_quat(), velocity

    def contact(self, time: float) -> Any:
        """Diagonal pairs take turns while walking; all stand before."""
        if time < self.walking_from - 1e-9:
            return np.ones(4, np.bool_)
        first = ((time - self.walking_from + 1e-9) % self.period) < self.period / 2.0
        return np.array([first, not first, not first, first])

    def content(self, messages: Messages) -> Iterable[tuple[str, bytes]]:
        ticks = round(self.duration / graph.TICK_PERIOD)
        for tick in range(ticks + 1):
            time_ns, time = tick * graph.TICK_PERIOD_NS, tick * graph.TICK_PERIOD
            torque = np.tile(self.torque, 4) * (1.0 if tick % 2 else -1.0)
            yield (
                graph.JOINT_STATES,
                messages.joint_states(time_ns, self.joint_position(time), np.zeros(12), torque),
            )
            target = self.joint_position(time + graph.TICK_PERIOD) + self.tracking_error
            yield graph.JOINT_COMMAND, messages.joint_command(time_ns, 8, target)
            position, orientation, velocity = self.base(time)
            if tick % 5 == 0:
                yield (
                    graph.GROUND_TRUTH,
                    messages.odometry(time_ns, position, orientation, velocity, np.zeros(3)),
                )
                contact = self.contact(time)
                force = np.outer(contact, (self.tangential_force, 0.0, self.normal_force))
                feet = np.zeros((4, 3))
                yield graph.FOOT_CONTACTS, messages.foot_contacts(time_ns, contact, force, feet)
            if tick % 10 == 0:
                walking = time >= self.walking_from
                wanted = np.array([0.0, 0.0, self.height + self.height_offset])
                yield (
                    graph.CONTROLLER_STATE,
                    messages.controller_state(
                        time_ns,
                        "walk" if walking else "stand",
                        desired_position=wanted,
                        phase=((time - 1.0) / self.period) % 1.0,
                        stance=self.contact(time),
                        static_margin=0.02 if walking else 0.1,
                    ),
                )
                yield (
                    graph.ODOMETRY,
                    messages.odometry(
                        time_ns, position + self.estimate_offset, orientation, velocity, np.zeros(3)
                    ),
                )


@pytest.fixture(scope="session")
def walk() -> Walk:
    return Walk()


@pytest.fixture(scope="session")
def walk_bag(
    tmp_path_factory: pytest.TempPathFactory, write_bag: WriteBag, messages: Messages, walk: Walk
) -> Path:
    path = tmp_path_factory.mktemp("walk") / "bag"
    write_bag(path, walk.content(messages))
    return path


class UnitFlight:
    """A synthetic flight of the propulsion unit: it hangs, spins up, flies, and pulls at a rope.

    Attributes are the numbers that it was made of.
    """

    duration = 6.0
    spin_up = 1.0
    taut = ((0.0, 1.5), (4.0, 4.5))
    compass = 0.03
    roll_slack, roll_taut = 0.01, 0.05
    yaw = 0.2
    current_idle, current_flying = 2.0, 20.0
    charge, charge_rate = 0.95, -0.002
    voltage_noise = 0.004
    thrust = 3.0
    force = 4 * thrust * np.array([np.sin(0.3), 0.0, np.cos(0.3)])
    """Of all fans in base, flying [N]: they push aside, so that no axis has it all."""
    unheeded = (0.0, 0.0, 7.0)
    """Of the commands of kind NONE, before the flight [N]."""

    def is_taut(self, time: float) -> bool:
        return any(start - 1e-9 <= time < end - 1e-9 for start, end in self.taut)

    def battery(self, time: float) -> tuple[float, float, float]:
        """Charge, current, voltage: 95 % is half way between 4.11 V and 4.20 V of a cell."""
        charge = self.charge + self.charge_rate * time
        current = self.current_flying if time >= self.spin_up - 1e-9 else self.current_idle
        unloaded = 6 * (4.11 + (charge - 0.9) / 0.1 * 0.09)
        return charge, current, unloaded - 0.012 * current

    def desired(self, time: float) -> Rotation:
        """In the autopilot's world, whose north is the compass's."""
        return Rotation.from_euler("ZYX", (self.yaw * np.sin(time) + self.compass, 0.0, 0.0))

    def attitude(self, time: float) -> Rotation:
        """Truth: rolled too far, and turned by the error of the compass."""
        roll = self.roll_taut if self.is_taut(time) else self.roll_slack
        level = Rotation.from_euler("z", -self.compass) * self.desired(time)
        return level * Rotation.from_euler("x", roll)

    def position(self, time: float) -> Any:
        return np.array([0.1 * time, 0.3 * np.sin(time), 1.0])

    def content(self, messages: Messages, mount: tuple[Any, Any]) -> Iterable[tuple[str, bytes]]:
        """Give all messages; `mount` is place and angles of the camera in base."""
        zeros = np.zeros(3)
        camera = Rotation.from_euler("xyz", mount[1])
        start, first = self.position(0.0), self.attitude(0.0)
        heading = Rotation.from_euler("z", -first.as_euler("ZYX")[0])
        for step in range(round(self.duration * 100) + 1):
            time, time_ns = step / 100, step * 10_000_000
            flying = time >= self.spin_up - 1e-9
            charge, current, voltage = self.battery(time)
            thrust = np.full(4, self.thrust * flying)
            truth, place = self.attitude(time), self.position(time)
            pack, stamp = messages.pack, messages.stamp(time_ns)
            yield (
                graph.FAN_STATE,
                pack(
                    "husky_msgs/msg/FanState",
                    stamp=stamp,
                    speed=500.0 * thrust,
                    thrust=thrust,
                    battery_voltage=voltage,
                    battery_current=current,
                    battery_charge=charge,
                    wrench=messages.wrench(self.force * flying, (0.1, 0.2, 0.3)),
                    rope_taut=np.array([self.is_taut(time), False]),
                ),
            )
            yield (
                graph.GROUND_TRUTH,
                messages.odometry(time_ns, place, truth.as_quat(), zeros, zeros),
            )
            seen = heading * truth * camera
            eye = heading.apply(place - start + truth.apply(mount[0]))
            yield (
                graph.T265_ODOMETRY,
                messages.odometry(time_ns, eye, seen.as_quat(), zeros, zeros),
            )
            if step % 10 == 0:
                yield (
                    graph.PROPULSION_COMMAND,
                    pack(
                        "husky_msgs/msg/PropulsionCommand",
                        stamp=stamp,
                        kind=WRENCH if flying else NONE,
                        force=messages.vector(self.force if flying else self.unheeded),
                    ),
                )
            if step % 2 == 0:
                north = Rotation.from_euler("z", self.compass)
                yield (
                    graph.PROPULSION_STATE,
                    pack(
                        "husky_msgs/msg/PropulsionState",
                        stamp=stamp,
                        armed=flying,
                        mode="STABILIZED",
                        attitude_desired=messages.quaternion(self.desired(time)),
                        attitude=messages.quaternion(north * truth),
                        collective_desired=0.15 * flying,
                        pwm=np.full(4, 1300 if flying else 1000, np.uint16),
                        voltage=voltage + self.voltage_noise * (-1) ** (step // 2),
                        current=current,
                    ),
                )


@pytest.fixture(scope="session")
def unit_flight() -> UnitFlight:
    return UnitFlight()


@pytest.fixture(scope="session")
def unit_bag(
    tmp_path_factory: pytest.TempPathFactory,
    write_bag: WriteBag,
    messages: Messages,
    unit_flight: UnitFlight,
) -> Path:
    path = tmp_path_factory.mktemp("unit") / "bag"
    camera = load_robot().t265
    write_bag(path, unit_flight.content(messages, (np.array(camera.position), camera.rpy.tolist())))
    return path


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> dict[str, Figure]:
    """Collect figures by name instead of saving them."""
    found: dict[str, Figure] = {}

    def keep(self: Figure, path: Path) -> None:
        found[path.stem] = self
        self.draw_without_rendering()

    monkeypatch.setattr(Figure, "savefig", keep)
    return found
