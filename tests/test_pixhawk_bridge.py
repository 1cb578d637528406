"""The process `pixhawk_bridge` against a scripted autopilot on a pseudo-terminal and on UDP."""

import socket
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from node_bench import DeviceBench, assert_refused, every, shared_bench
from pymavlink.dialects.v20 import common as mavlink
from scripted_autopilot import ScriptedAutopilot
from sensor_msgs.msg import BatteryState
from std_srvs.srv import SetBool, Trigger

from husky_description.robot import load_robot
from husky_msgs.msg import PropulsionCommand, PropulsionState
from husky_msgs.srv import SetFlightMode
from husky_pu.autopilot.mixer import Mixer
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

pytestmark = pytest.mark.graph

MODULE = "husky_pu.nodes.pixhawk_bridge"
MIXER = Mixer(load_robot())


class Bench(DeviceBench):
    """An autopilot with a bundle of telemetry each 20 ms, the bridge, and a node that commands."""

    def __init__(self, domain, directory, exchange=None, **parameters):
        self.autopilot = ScriptedAutopilot()
        self.telling = True
        self.centi_amperes = 1000
        self.ticks = 0
        self.exchange = exchange or (lambda autopilot: self.port.service(autopilot))
        super().__init__(domain, directory, MODULE, 0.02, self._tick)
        self.states, self.batteries = [], []
        subscribe = self.node.create_subscription
        subscribe(PropulsionState, graph.PROPULSION_STATE, self.states.append, qos.STATUS)
        subscribe(BatteryState, graph.BATTERY, self.batteries.append, qos.STATUS)
        self.publisher = self.node.create_publisher(
            PropulsionCommand, graph.PROPULSION_COMMAND, qos.CONTROL
        )
        self.stamp = 0
        self.start(**{"connection": f"serial:{self.port.path}:921600", **parameters})

    def _tick(self, number):
        if self.telling:
            self.ticks += 1
            if self.ticks % 10 == 0:
                self.autopilot.heartbeat()
                self.autopilot.battery([22000], self.centi_amperes)
            self.autopilot.telemetry(20 * self.ticks)
        self.exchange(self.autopilot)

    def command(self, kind=PropulsionCommand.WRENCH, thrust=0.0, moment=0.0):
        self.stamp += 10_000_000
        message = PropulsionCommand(kind=kind)
        stamps.fill(message.stamp, self.stamp)
        message.force.z, message.moment.x = thrust, moment
        self.publisher.publish(message)

    def wait_for_state(self, condition, what):
        self.states.clear()
        self.wait(lambda: any(map(condition, self.states)), what)

    def connect(self):
        self.wait_for_state(lambda state: state.connected, "a connected autopilot")
        self.wait(lambda: len(self.autopilot.of("COMMAND_LONG")) >= 7, "requests for telemetry")
        return self

    def thrusts(self):
        with self.held():
            heard = self.autopilot.of("SET_ACTUATOR_CONTROL_TARGET")
        return np.array([message.controls[3] for message in heard])


@pytest.fixture
def bench(domain, tmp_path, request):
    bench = Bench(domain, tmp_path, **getattr(request, "param", {"time": "realtime"}))
    yield bench
    bench.close()


def test_arm_fly_kill(bench):
    bench.connect()
    half = 0.5 * MIXER.max_collective

    def command():
        bench.command(thrust=half, moment=0.1 * float(MIXER.moment_scale[0]))

    bench.wait(lambda: len(bench.thrusts()) > 20, "setpoints", command)
    assert not bench.thrusts().any()  # nothing is armed yet
    for mode, number in (("OFFBOARD", 6), ("STABILIZED", 7), ("OFFBOARD", 6)):
        assert bench.call(SetFlightMode, graph.PROPULSION_SET_MODE, mode=mode).success
        assert bench.autopilot.mode == number
    assert "one of" in bench.call(SetFlightMode, graph.PROPULSION_SET_MODE, mode="LOITER").message
    assert bench.call(SetBool, graph.PROPULSION_ARM, data=True).success
    assert bench.autopilot.armed
    bench.wait(lambda: bench.thrusts().max() > 0.499, "half the thrust", command)
    thrusts = bench.thrusts()
    # 80 N/s by stamps, of which the longest gap that counts is 0.1 s.
    assert np.diff(thrusts).max() <= 8.0 / MIXER.max_collective + 1e-6
    with bench.held():
        last = bench.autopilot.of("SET_ACTUATOR_CONTROL_TARGET")[-1]
    assert last.controls[:4] == pytest.approx([0.1, 0, 0, 0.5], abs=1e-6)
    assert 0 < last.time_usec <= bench.stamp // 1000
    assert last.time_usec % 10_000 == 0
    bench.wait_for_state(lambda s: s.armed and s.mode == "OFFBOARD", "an armed state")
    state = bench.states[-1]
    assert list(state.pwm) == [1100, 1200, 1300, 1400]
    assert state.voltage == 22.0
    assert stamps.to_ns(state.stamp) % 20_000_000 == 0

    assert bench.call(Trigger, graph.PROPULSION_KILL).success
    killed = [m for m in bench.autopilot.of("COMMAND_LONG") if m.command == 400][-1]
    assert (killed.param1, killed.param2) == (0.0, 21196.0)
    count = len(bench.thrusts())
    bench.wait(lambda: len(bench.thrusts()) > count + 10, "setpoints", command)
    assert not bench.thrusts()[count:].any()


def test_refusals_have_reasons(bench):
    bench.connect()
    with bench.held():
        bench.autopilot.parameters["COM_OF_LOSS_T"] = 60.0
        bench.autopilot.tell("COM_OF_LOSS_T")
    bench.wait_for_report(
        lambda s: s.level == DiagnosticStatus.ERROR and "COM_OF_LOSS_T is 60" in s.message,
        "the parameter that is unsafe",
    )
    answer = bench.call(SetBool, graph.PROPULSION_ARM, data=True)
    assert not answer.success and "COM_OF_LOSS_T is 60, allowed 0.1 to 1" in answer.message
    assert not any(m.command == 400 for m in bench.autopilot.of("COMMAND_LONG"))
    with bench.held():
        bench.autopilot.parameters["COM_OF_LOSS_T"] = 1.0
        bench.autopilot.tell("COM_OF_LOSS_T")
    bench.wait_for_report(lambda s: s.values and "not to be armed" not in s.message, "its end")
    with bench.held():
        bench.autopilot.results[400] = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        bench.autopilot.refusal = "Arming denied: no battery"
    answer = bench.call(SetBool, graph.PROPULSION_ARM, data=True)
    assert not answer.success
    assert answer.message == "temporarily rejected: Arming denied: no battery"
    with bench.held():
        bench.autopilot.deaf = 3
    answer = bench.call(SetBool, graph.PROPULSION_ARM, data=True)
    assert answer.message == "no answer to command 400 after 3 attempts"
    report = bench.wait_for_report(
        lambda r: r.level == DiagnosticStatus.WARN and "refused" in r.message,
        "a report of refused commands",
        lambda: bench.command(thrust=float("nan")),
    )
    assert report["refusal"] == "not finite"
    assert len(bench.thrusts()) == 0


def test_a_bridge_whose_fans_push_stays_active(bench):
    """Neither deactivation nor a shutdown takes the thrust away; without thrust it may leave."""
    bench.connect()
    assert bench.call(SetBool, graph.PROPULSION_ARM, data=True).success
    bench.wait_for_state(lambda state: state.armed, "an armed state")
    push = every(0.01, lambda: bench.command(thrust=10.0))
    bench.wait(lambda: bench.thrusts().max(initial=0.0) > 0.0, "thrust", push)
    for leave in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVE_SHUTDOWN):
        assert not bench.change_state(leave)
    assert bench.lifecycle_state() == State.PRIMARY_STATE_ACTIVE
    rest = every(0.01, bench.command)
    bench.wait(lambda: bench.thrusts()[-1] == 0.0, "no thrust", rest)
    assert bench.change_state(Transition.TRANSITION_DEACTIVATE)


@pytest.mark.parametrize("bench", [{"time": "lockstep"}], indirect=True)
def test_a_standing_lockstep_world_is_no_loss(bench):
    bench.connect()
    with bench.held():
        bench.telling = False
    asked = len(bench.autopilot.of("COMMAND_LONG"))
    bench.wait(lambda: len(bench.autopilot.of("COMMAND_LONG")) > asked + 3, "requests for a sign")
    assert all(state.connected for state in bench.states)
    assert bench.call(SetBool, graph.PROPULSION_ARM, data=True).success


def test_udp(domain, tmp_path):
    server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    server.bind(("127.0.0.1", 0))
    server.setblocking(False)
    peers = []

    def exchange(autopilot):
        try:
            while True:
                data, peer = server.recvfrom(65536)
                peers[:] = [peer]
                autopilot.feed(data)
        except BlockingIOError:
            pass
        output = autopilot.take_output()
        if peers and output:
            server.sendto(output, peers[0])

    connection = f"udpout:127.0.0.1:{server.getsockname()[1]}"
    bench = Bench(domain, tmp_path, exchange, connection=connection, time="hardware")
    try:
        bench.connect()
        beat = bench.autopilot.of("HEARTBEAT")[0]
        assert beat.get_srcComponent() == 191
        assert bench.call(SetBool, graph.PROPULSION_ARM, data=True).success
        # The stamps are this machine's time.
        assert abs(stamps.to_ns(bench.states[-1].stamp) - time.time_ns()) < 30 * 10**9
    finally:
        bench.close()
        server.close()


def test_bad_parameters_end_it_with_a_sentence(domain, tmp_path):
    key = tmp_path / "key"
    key.write_text("short")
    for parameters, words in (
        ({"connection": "tcp:1"}, "connection is 'tcp:1', it must be serial:<path>:<baud>"),
        ({"signing_key": key}, "a signing key has 64 hexadecimal digits"),
        ({"time": "sundial"}, "parameter time is 'sundial'"),
    ):
        assert_refused(MODULE, words, **parameters)


plain_bench = shared_bench(Bench, time="realtime")
"""Nobody arms it."""


def test_a_full_current_field_is_told_as_such(plain_bench):
    bench = plain_bench
    with bench.held():
        bench.centi_amperes = 32767
    report = bench.wait_for_report(lambda r: "327.67 A" in r.message, "a report of the current")
    assert report["current"] == "327.67 A or more"
    bench.batteries.clear()
    bench.wait(lambda: bench.batteries, "the battery")
    assert bench.batteries[-1].current == pytest.approx(-327.67)
    assert bench.batteries[-1].voltage == 22.0
    with bench.held():
        bench.centi_amperes = 1000


def test_a_lost_and_returning_line_and_autopilot(plain_bench):
    bench = plain_bench
    bench.connect()
    with bench.held():
        bench.telling = False
    bench.wait_for_state(lambda state: not state.connected, "a state that says so")
    assert not bench.call(SetBool, graph.PROPULSION_ARM, data=True).success
    with bench.held():
        bench.telling = True
    bench.wait_for_state(lambda state: state.connected, "the autopilot again")
    with bench.held():
        bench.port.unplug()
    bench.wait_for_report(lambda r: r.message.startswith("no port"), "a report of the lost port")
    with bench.held():
        bench.port.replug()
    bench.wait_for_state(lambda state: state.connected, "the autopilot on the new port")
    with bench.held():
        bench.port.write(b"\xfd\x09garbage" + bytes(range(256)), 921600)
    report = bench.wait_for_report(lambda r: "damaged" in r.message, "a report of damage")
    assert int(report["garbage_bytes"]) > 0
    bench.wait_for_report(lambda r: r.level == DiagnosticStatus.OK, "a good report")


def test_a_deactivated_bridge_gives_the_port_back(plain_bench):
    bench = plain_bench
    bench.connect()
    assert bench.change_state(Transition.TRANSITION_DEACTIVATE)
    bench.wait(lambda: not bench.port.connected, "the port to be closed")
    assert not bench.call(SetBool, graph.PROPULSION_ARM, data=True).success
    assert bench.change_state(Transition.TRANSITION_ACTIVATE)
    bench.wait_for_state(lambda state: state.connected, "the autopilot")
    bench.end()
