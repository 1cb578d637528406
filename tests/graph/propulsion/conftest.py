"""A robot that its fans help, to break."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from pymavlink.dialects.v20 import common as mavlink
from rclpy.node import Node
from seen_robot import SETTINGS
from std_srvs.srv import SetBool

from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot
from husky_experiments.scripts import stop_walking
from husky_msgs.msg import FanState, PropulsionCommand
from husky_pu.autopilot.mavlink_ports import default_port
from husky_pu.mavlink.frames import signing_time
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

GRACE = 2.0
"""Wall time after which the nodes give up a silent peer in these tests [s]."""
COMMAND_PERIOD = 0.01
"""Between two commands [s]."""
SHARE = 0.4
"""Of the weight, on the fans."""
WEIGHT = float(load_robot().mass) * GRAVITY
LOW_PULSES = 1.2
"""The speed controllers want to see a second of low pulses [s]."""
_SLEW, _QUICK_SLEW = 0.4, 1.0
"""How fast the share changes by default, and while it rises to where a test begins: more would meet
the bridge's limit [1/s]."""
THRUST_PERIOD = 2.0
"""After a loss all fans are at rest by then [s]."""
NO_THRUST = 0.01 * WEIGHT
"""Of all fans, that counts as none [N]."""
REST = 0.4
"""After the last thrust it is watched so long that none comes back [s]."""
RISE = 0.02 * WEIGHT
"""By how much the thrust of all fans may rise above its lowest since a loss [N]."""


def is_told(session: Any) -> bool:
    """Whether the bridge has the unit, and tells of it as it is now."""
    p = session.propulsion
    age = session.time - stamps.to_ns(p.stamp) / 1e9 if p is not None else 0.0
    return p is not None and bool(p.connected) and age < 0.2


class Fans:
    """The propulsion unit as a test sees it, with the robot or the graph that carries it."""

    def __init__(self, robot: Any):
        self.robot = robot
        self.session = robot.session
        self._states = robot.tap(FanState, graph.FAN_STATE)
        self._truths = robot.tap(Odometry, graph.GROUND_TRUTH)
        self._before = 0.0
        self._spinning = 0.0  # time from which on the speed controllers obey

    # What is seen ---------------------------------------------------------------------------
    def watch(self) -> float:
        """Look at the fans (and the joints) from now on; return the time now [s]."""
        self._states.clear()
        self._truths.clear()
        self._before = self.lift()
        return float(self.robot.watch())

    def thrusts(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] and the thrust of each fan (n, 4) [N], since `watch`."""
        messages = self._states.drain()
        times = np.array([stamps.to_ns(m.stamp) / 1e9 for m in messages])
        return times, np.array([m.thrust for m in messages]).reshape(-1, 4)

    def heights(self) -> tuple[float, float]:
        """Return the base's lowest and highest height since `watch` [m]."""
        heights = [m.pose.pose.position.z for m in self._truths.drain()]
        assert len(heights) > 10, "the tap heard too little"
        return min(heights), max(heights)

    def trots_on(self) -> tuple[float, float]:
        """Return the heights since `watch`; the robot trots as if nothing had happened."""
        low, high = self.heights()
        assert self.robot.mode == "walk" and low > 0.5 and high < 0.6, (low, high, self.seen)
        return low, high

    def is_told(self) -> bool:
        """Whether the bridge has the unit, and tells of it as it is now."""
        return is_told(self.session)

    def lift(self) -> float:
        """Return the thrust of all fans now [N]."""
        fans = self.session.fans
        return float(sum(fans.thrust)) if fans is not None else 0.0

    @property
    def rests(self) -> bool:
        """Whether no fan makes thrust."""
        return self.lift() < NO_THRUST

    @property
    def seen(self) -> str:
        """What was seen last, for failures."""
        p = self.session.propulsion
        unit = "silent"
        if p is not None:
            at = stamps.to_ns(p.stamp) / 1e9
            unit = f"at {at:.3f} s armed {p.armed}, {p.mode}, {p.failsafe!r}, {p.reason!r}"
        return f"{self.robot.seen}; unit {unit}, thrust {self.lift():.2f} N"

    def rise(self, since: float) -> float:
        """Return by how much the thrust has risen above its lowest since a fault [N]."""
        times, thrusts = self.thrusts()
        total = thrusts.sum(axis=1)[times >= since]
        return float((total - np.minimum.accumulate(total)).max())

    def helps(self, since: float) -> bool:
        """Return whether the fans have carried their share all the time since [s]."""
        times, thrusts = self.thrusts()
        total = thrusts.sum(axis=1)[times >= since] / (SHARE * WEIGHT)
        return bool(0.9 < total.min() and total.max() < 1.1)

    def thrust_ends(self, since: float, settled: float = 0.0) -> float:
        """Wait until the fans are at rest; return how long after a loss the last thrust acted [s].

        That is at most `THRUST_PERIOD`. On its way there it never rises, or while it settles [s]
        not above what it was.
        """
        s = self.session
        while not self.rests and s.time < since + THRUST_PERIOD:
            s.advance(0.1)
        s.advance(REST)
        times, thrusts = self.thrusts()
        total = thrusts.sum(axis=1)
        assert len(times) > 30 and times[-1] > s.time - 0.1, "the tap heard too little"
        rise = self.rise(since + settled)
        assert rise <= RISE, f"thrust rises by {rise:.2f} N"
        assert total.max() <= self._before + RISE, f"thrust rises to {total.max():.2f} N"
        acting = times[(total > NO_THRUST) & (times > since)]
        ends = float(acting[-1] - since) if len(acting) else 0.0
        assert ends <= THRUST_PERIOD, f"thrust {ends:.2f} s after a loss; {self.seen}"
        return ends

    # What is done ---------------------------------------------------------------------------
    def heal(self) -> None:
        """Heal every device of the unit."""
        for target in (*(f"{leg}_fan" for leg in load_robot().legs), "battery", "t265"):
            self.session.inject(graph.PLANT_INJECT_FAULT, target, "")

    def share(self, share: float) -> None:
        """Ask the fans for a share of the weight."""
        self.session.set_parameter(graph.LOW_LEVEL_CONTROLLER, "assist.share", float(share))

    def arm(self) -> None:
        """Hand the fans to the controller; it asks nothing of them yet."""
        s = self.session
        self.robot.until(self.is_told, "news of the unit", within=3.0, step=0.1)
        if s.propulsion.armed:
            return
        self.share(0.0)
        s.set_flight_mode("OFFBOARD")
        # Once it has been still for a while, and has heard commands of no thrust.
        self.robot.until(self._may_arm, f"arming, now {self.seen}", within=2.0, step=0.1)
        self._spinning = s.time + LOW_PULSES
        s.advance(0.2)
        assert self.is_told() and s.propulsion.armed, self.seen
        assert s.propulsion.mode == "OFFBOARD", self.seen

    def _may_arm(self) -> bool:
        return bool(self.session.call(graph.PROPULSION_ARM, SetBool.Request(data=True)).success)

    def stand(self) -> None:
        """Arm where the robot sits in a fresh world, and stand up meanwhile."""
        self.robot.enable()
        self.arm()
        self.robot.stand()

    def assist(self) -> None:
        """Arm, and wait until the fans of the standing robot carry their share."""
        s = self.session
        self.arm()
        s.advance(max(0.0, self._spinning - s.time))
        s.set_parameter(graph.LOW_LEVEL_CONTROLLER, "assist.slew", _QUICK_SLEW)
        self.share(SHARE)
        self.robot.until(
            lambda: self.lift() > 0.97 * SHARE * WEIGHT,
            f"{SHARE} of the weight on the fans, now {self.seen}",
            within=4.0,
            step=0.1,
        )
        s.set_parameter(graph.LOW_LEVEL_CONTROLLER, "assist.slew", _SLEW)

    def arming_refused(self) -> str:
        """Try to arm; return why that is refused."""
        answer = self.session.call(graph.PROPULSION_ARM, SetBool.Request(data=True))
        assert not answer.success, self.seen
        return str(answer.message)

    @property
    def carries(self) -> bool:
        """Whether the fans carry their share."""
        p = self.session.propulsion
        share = self.lift() / (SHARE * WEIGHT)
        return self.is_told() and bool(p.armed) and not p.failsafe and 0.9 < share < 1.1

    def trot(self) -> None:
        """Stand up, arm, assist and trot, as far as that is not so already."""
        robot = self.robot
        if robot.trots and self.carries:
            robot.trot()
            return
        if not robot.stands:
            self.share(0.0)
            self.heal()
            robot.start_again()
            self.stand()
        self.assist()
        robot.trot()

    def recover(self) -> None:
        """The way back from a fault: the robot stands, and its fans carry their share again."""
        self.heal()
        if self.robot.mode == "walk":
            stop_walking(self.session)
        if not self.robot.stands:
            self.share(0.0)
            self.robot.enable()
            self.robot.start_again()
            self.stand()
        self.assist()
        assert self.robot.stands and self.robot.height > 0.5, self.seen


class Stranger:
    """Somebody on the UDP port of the flight controller."""

    def __init__(self, system: int, component: int, domain: int, key: bytes = b""):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._address = ("127.0.0.1", default_port(domain))
        self._codec = mavlink.MAVLink(None, system, component)
        if key:
            self._codec.signing.secret_key = key
            self._codec.signing.sign_outgoing = True
            self._codec.signing.timestamp = signing_time(time.time())

    def pack(self, message: Any) -> bytes:
        """Return the next frame with a message."""
        frame = bytes(message.pack(self._codec))
        self._codec.seq = (self._codec.seq + 1) % 256
        return frame

    def say(self, *messages: Any) -> None:
        """Send messages, each in a datagram."""
        for message in messages:
            self.send(self.pack(message))

    def send(self, data: bytes) -> None:
        """Send bytes as they are."""
        self._socket.sendto(data, self._address)

    def hear(self, kind: str, patience: float = 5.0) -> None:
        """Wait until a message of a type comes, for a while of wall time [s]."""
        self._socket.settimeout(patience)
        heard: set[str] = set()
        while kind not in heard:
            try:
                data = self._socket.recv(2048)
            except TimeoutError:
                pytest.fail(f"no {kind} is heard, only {sorted(heard)}")
            heard.update(m.get_type() for m in self._codec.parse_buffer(data) or ())

    def close(self) -> None:
        """Fall silent."""
        self._socket.close()


class Commanding:
    """Commands a force at 100 Hz, and sees what is made of it."""

    def __init__(self, robot: Any):
        self.robot, self.session = robot, robot.session
        self._node = Node("commanding", context=self.session.context)
        self._publisher = self._node.create_publisher(
            PropulsionCommand, graph.PROPULSION_COMMAND, qos.CONTROL
        )
        self._fans = robot.tap(FanState, graph.FAN_STATE)

    def ask(self, force: Any, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """Command a force in base [N] for a while; return times and the forces made."""
        s = self.session
        self._fans.clear()
        command = PropulsionCommand(kind=PropulsionCommand.WRENCH)
        command.force.x, command.force.y, command.force.z = map(float, force)
        for _ in range(round(seconds / COMMAND_PERIOD)):
            stamps.fill(command.stamp, round(s.time * 1e9))
            self._publisher.publish(command)
            s.advance(COMMAND_PERIOD)
        return self.made()

    def made(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] and the forces made in base (n, 3) [N], since the last command."""
        messages = self._fans.drain()
        forces = [m.wrench.force for m in messages]
        times = np.array([stamps.to_ns(m.stamp) / 1e9 for m in messages])
        return times, np.array([(f.x, f.y, f.z) for f in forces]).reshape(-1, 3)

    def silence(self, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """Command nothing for a while; return times and forces."""
        self._fans.clear()
        self.session.advance(seconds)
        return self.made()

    def arm(self) -> None:
        """From a fresh world to an armed unit without thrust."""
        s = self.session
        s.inject(graph.PLANT_INJECT_FAULT, "front_left_fan", "")
        s.reset(seed=1)
        s.wait_for(self._is_told, "news of the unit")  # which may have to open its line again
        self.ask((0, 0, 0), 1.0)  # until it has heard commands of no thrust, and is still
        s.set_flight_mode("OFFBOARD")
        s.arm()
        self.ask((0, 0, 0), 1.2)  # the speed controllers want to see a second of low pulses
        assert s.propulsion.armed, s.propulsion

    def close(self) -> None:
        """Command no more."""
        self._node.destroy_node()

    def _is_told(self) -> bool:
        self.ask((0, 0, 0), 0.1)
        return is_told(self.session)

    def told(self) -> np.ndarray:
        """Return the force that /propulsion/state tells [N] (3,)."""
        force = self.session.propulsion.force
        return np.array((force.x, force.y, force.z))

    def pushes(self, force: Any, seconds: float = 2.0) -> np.ndarray:
        """Command a force; it is made and told. Return the forces made."""
        times, made = self.ask(force, seconds)
        settled = made[times > times[-1] - 0.3].mean(axis=0)
        # Pulses of 1 us: 0.02 N a fan, 0.3 deg of the axis; the voltage is measured with noise.
        slack = 0.02 * float(np.linalg.norm(force)) + 0.3
        np.testing.assert_allclose(settled, force, atol=slack)
        np.testing.assert_allclose(self.told(), settled, atol=slack)
        return made


@pytest.fixture(scope="module")
def fans_of_module(graphs: Any) -> Fans:
    """The fans of a walking robot with its unit, in lockstep."""
    settings = {
        graph.PLANT: {"grace": GRACE, "seed": 1, "body": "robot_with_unit"},
        graph.DRIVE_BRIDGE: {"grace": GRACE},
        graph.LOW_LEVEL_CONTROLLER: SETTINGS[graph.LOW_LEVEL_CONTROLLER],
        graph.FLIGHT_CONTROLLER: {"grace": GRACE},
    }
    return Fans(graphs.shared(**settings))


@pytest.fixture(scope="module")
def vectoring_of_module(graphs: Any, held_unit: Any) -> Iterator[Commanding]:
    """Who commands a unit with vectoring fans that is held in the air."""
    commanding = Commanding(graphs.shared(**held_unit(mounting="vectoring", seed=1)))
    yield commanding
    commanding.close()


@pytest.fixture(scope="module")
def unit_of_module(new_graph: Any) -> Iterator[Fans]:
    """The unit alone and a remote control, in lockstep."""
    settings = {
        graph.PLANT: {"grace": GRACE, "seed": 1, "body": "unit", "keyframe": "stand"},
        graph.FLIGHT_CONTROLLER: {"grace": GRACE},
    }
    with new_graph(remote=True, **settings) as robot:
        yield Fans(robot)


@pytest.fixture(scope="session")
def commanding() -> type[Commanding]:
    """Makes one who commands forces."""
    return Commanding


@pytest.fixture(scope="session")
def held_unit() -> Any:
    """Settings of a graph with the unit alone, held in the air, by parameters of the plant."""

    def settings(**plant: Any) -> dict[str, dict[str, Any]]:
        held = {"body": "unit", "keyframe": "stand", "start_height": 0.5, "start_held": True}
        return {
            graph.PLANT: {"grace": GRACE, **held, **plant},
            graph.FLIGHT_CONTROLLER: {"grace": GRACE, "parameters": "CA_FAILURE_MODE=1"},
        }

    return settings


@pytest.fixture(scope="session")
def trotting_fans() -> Any:
    """Lets a robot of any graph trot with its fans' help."""
    return lambda robot: Fans(robot).trot()


@pytest.fixture
def assisted(fans_of_module: Fans) -> Fans:
    """A trotting robot with its fans' help, all well."""
    fans_of_module.trot()
    return fans_of_module


@pytest.fixture
def stranger(domain: int) -> Iterator[Any]:
    """Makes a stranger: system, component, key."""
    made: list[Stranger] = []

    def make(system: int, component: int, key: bytes = b"") -> Stranger:
        made.append(Stranger(system, component, domain, key))
        return made[-1]

    yield make
    for one in made:
        one.close()
