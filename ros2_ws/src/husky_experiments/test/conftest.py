"""A short synthetic run whose figures are known in closed form."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_runtime import graph

# Import mode importlib finds neither by itself.
_TESTS = Path(__file__).resolve().parent
sys.path[:0] = [str(_TESTS), str(_TESTS.parents[1] / "husky_bringup/test")]

from bag_fixtures import (  # noqa: E402
    WRENCH,
    Messages,
    WriteBag,
    messages,
    profiles,
    typestore,
    write_bag,
)

__all__ = ["messages", "profiles", "typestore", "write_bag"]


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
    """Of the controller's commands [N]: sticks fly."""

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
                        kind=WRENCH,
                        force=messages.vector(self.unheeded),
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
                        collective_desired=thrust[0] / load_robot().fans.max_thrust,
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
    """Collect figures by name instead of drawing and saving them, which takes most of the time."""
    found: dict[str, Figure] = {}

    def keep(self: Figure, path: Path) -> None:
        found[path.stem] = self

    monkeypatch.setattr(Figure, "savefig", keep)
    return found
