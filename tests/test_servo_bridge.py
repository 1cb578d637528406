"""The process `servo_bridge` against emulated servos on a pseudo-terminal."""

import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticStatus
from node_bench import DeviceBench, assert_refused, every
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from husky_description.robot import load_robot
from husky_msgs.msg import DriveStatusArray, JointCommand
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_sim.devices.bus_servos.bus import EmulatedServoBus
from husky_sim.devices.bus_servos.motors import BusServoMotors

pytestmark = pytest.mark.graph

MODULE = "husky_drivers.nodes.servo_bridge"
ROBOT = load_robot("beta")
STEP = 0.0005
JOINT = ROBOT.joint_names[4]
LEAD = 5 * graph.TICK_PERIOD_NS
"""How far time goes on before the joints of a tick are answered [ns]; 30 ms are a silence."""
PATIENCE = 500
"""For so many of its own steps, a second or more, then it goes on all the same."""
INERTIA = ROBOT.bus_servo.armature + 0.01
"""What each servo turns here: its rotor and a light limb [kg m^2]."""


class Bench(DeviceBench):
    """Servos that turn free limbs at about their own pace, their bridge, and who commands it.

    Attributes:
        target: commanded joint positions [rad] (12,), None for no commands.
        mode: of the commands while the servos follow.
        lands: it goes on so when they do not; else it damps, as the controller does on the ground.
        lag: wall time by which the servos' answers are late [s].
        joints: the newest joint states.
        status: the newest status.
    """

    def __init__(self, domain, directory):
        self.motors = BusServoMotors(ROBOT.bus_servo, 12, STEP)
        self.bus = EmulatedServoBus(ROBOT.bus_servo, ROBOT.joint_names, self.motors)
        self.position, self.velocity = np.array(ROBOT.stand_joint_position), np.zeros(12)
        self.target, self.mode = np.array(ROBOT.stand_joint_position), 8
        self.lands, self.lag = False, 0.0
        self.time_ns = self.answered_ns = self.held_up = 0
        self.joints, self.status = None, None
        self.clock, self.now = None, Clock()
        super().__init__(domain, directory, MODULE, 0.002, self._tick)
        self.clock = self.node.create_publisher(Clock, graph.CLOCK, qos.CLOCK_OFFERED)
        self.commands = self.node.create_publisher(
            JointCommand, graph.JOINT_COMMAND, qos.CONTROL_OFFERED
        )
        listen = self.node.create_subscription
        listen(JointState, graph.JOINT_STATES, self._on_joints, qos.CONTROL)
        listen(DriveStatusArray, graph.DRIVES_STATUS, self._on_status, qos.STATUS)
        # These servos answer when they get a processor.
        self.start(time="realtime", port=self.port.path, command_timeout=0.03, answer_patience=0.5)

    def _tick(self, number):
        self.port.service(self.bus)
        if self.clock is None or number % 2 or self._waits():
            return  # the servos answer between two ticks too
        for _ in range(4):
            torque = self.motors.step(self.position, self.velocity)
            self.velocity += torque / INERTIA * STEP
            self.position += self.velocity * STEP
        self.motors.update_state(self.position)
        self.bus.advance(graph.TICK_PERIOD)
        self.time_ns += graph.TICK_PERIOD_NS
        stamps.fill(self.now.clock, self.time_ns)
        self.clock.publish(self.now)
        time.sleep(self.lag)
        self.port.service(self.bus)

    def _waits(self):
        """Whether time stands still: on a busy machine no command shall be late of itself."""
        if self.target is None or self.time_ns - self.answered_ns < LEAD:
            self.held_up = 0
        else:
            self.held_up += 1
        return 0 < self.held_up < PATIENCE

    def _on_joints(self, joints):
        self.joints, self.answered_ns = joints, stamps.to_ns(joints.header.stamp)
        if self.target is not None:
            operational = self.status is not None and self.status.operational
            mode = self.mode if operational or self.lands else 9
            command = JointCommand(stamp=joints.header.stamp, mode_of_operation=mode)
            command.position = self.target
            self.commands.publish(command)

    def _on_status(self, status):
        self.status = status

    def trigger(self, name):
        """Call a service of the bridge; return what it says against it."""
        return self.call(Trigger, name).message

    def enable(self):
        """Enable the servos, again where one has answered too late, as a busy machine makes it."""

        def operational():
            return self.status is not None and self.status.operational

        ask = every(0.5, lambda: operational() or self.trigger(graph.DRIVES_ENABLE))
        self.wait(operational, "torque on all servos", ask)
        after = self.time_ns + 100_000_000
        self.wait(lambda: self.answered_ns > after, "commands that know of it")

    def inject(self, joint, fault):
        """Make a servo fail, or heal it."""
        with self.held():
            self.bus.inject(joint, fault)


@pytest.fixture(scope="module")
def bench(domain, tmp_path_factory):
    bench = Bench(domain, tmp_path_factory.mktemp("bench"))
    yield bench
    bench.close()


@pytest.fixture
def enabled(bench):
    """All servos healthy and enabled."""
    for joint in ROBOT.joint_names:
        bench.inject(joint, "")
    bench.target, bench.mode = np.array(ROBOT.stand_joint_position), 8
    bench.lands = False
    with bench.held():
        bench.position[:], bench.velocity[:] = ROBOT.stand_joint_position, 0.0
    if not (bench.status and bench.status.operational):
        bench.wait(lambda: bench.joints is not None, "joint states")
        bench.wait(lambda: bench.trigger(graph.DRIVES_RESET_FAULTS) == "", "a reset")
    bench.enable()
    return bench


def test_joints_follow_what_is_commanded(enabled):
    enabled.target = ROBOT.stand_joint_position + 0.1
    enabled.wait(lambda: np.abs(enabled.position - enabled.target).max() < 0.01, "the targets")
    told = np.array(enabled.joints.position)
    assert np.abs(told - enabled.position).max() < 0.01
    assert list(enabled.joints.name) == list(ROBOT.joint_names)
    assert enabled.status.working_counter == enabled.status.expected_working_counter == 12
    values = enabled.wait_for_report(lambda s: s.level == DiagnosticStatus.OK, "a good report")
    assert (values["damaged_answers"], values["hottest_deg_c"]) == ("0", "25")


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("overload", "overload"),
        pytest.param("overheat", "overheating", marks=pytest.mark.slow),  # as overload
        ("unplug", "no answer"),
    ],
)
def test_a_servo_that_fails_stops_all(enabled, fault, words):
    enabled.inject(JOINT, fault)
    enabled.wait(lambda: not enabled.status.operational, "the end of operation")
    assert JOINT in enabled.status.reason
    enabled.wait(lambda: words in enabled.status.reason, "what is wrong with it")
    enabled.wait(lambda: not enabled.motors.records["torque_on"].any(), "torque off")
    index = ROBOT.joint_names.index(JOINT)
    enabled.wait(lambda: enabled.status.drives[index].state == "fault", "the servo's fault")
    assert JOINT in enabled.trigger(graph.DRIVES_ENABLE)
    enabled.wait_for_report(lambda s: JOINT in s.message, "a report that names it")


def test_while_the_controller_lands_the_other_servos_follow(enabled):
    """Arms of a robot in the air are not let go for one that is lost."""
    enabled.lands = True
    enabled.inject(JOINT, "overload")
    enabled.wait(lambda: not enabled.status.operational, "the end of operation")
    enabled.target = ROBOT.stand_joint_position + 0.1
    others = [name != JOINT for name in ROBOT.joint_names]
    away = lambda: np.abs(enabled.position - enabled.target)[others].max()  # noqa: E731
    after = enabled.time_ns + 600_000_000  # on the ground they let go after 0.36 s
    enabled.wait(lambda: away() < 0.01 and enabled.time_ns > after, "the targets, and time")
    assert enabled.motors.records["torque_on"][others].all()
    enabled.lands = False
    enabled.wait(lambda: not enabled.motors.records["torque_on"].any(), "torque off")


def test_after_an_emergency_stop_servos_settle_and_then_stay_where_they_are(enabled):
    enabled.lands = True
    assert enabled.trigger(graph.DRIVES_EMERGENCY_STOP)
    enabled.wait(lambda: enabled.status.emergency_stop, "the emergency stop")
    low = enabled.target = ROBOT.stand_joint_position + 0.1
    after = enabled.time_ns + 1_200_000_000
    enabled.wait(lambda: enabled.time_ns > after, "more than a second later")
    assert np.abs(enabled.position - low).max() < 0.02
    enabled.target = low + 0.1
    after = enabled.time_ns + 300_000_000
    enabled.wait(lambda: enabled.time_ns > after, "a little more")
    assert enabled.motors.records["torque_on"].all(), enabled.status.reason
    assert np.abs(enabled.position - low).max() < 0.02
    enabled.lands = False
    enabled.wait(lambda: not enabled.motors.records["torque_on"].any(), "torque off")


def test_two_servos_of_one_id_are_told(enabled):
    enabled.inject(JOINT, "id_conflict")
    enabled.wait(lambda: not enabled.status.operational, "the end of operation")
    assert JOINT in enabled.status.reason and "two servos of this id" in enabled.status.reason


def test_a_damaged_answer_now_and_then_is_counted_and_survived(enabled):
    enabled.inject(JOINT, "checksum:0.2")
    before = enabled.status.short_cycles
    enabled.wait(lambda: enabled.status.short_cycles > before + 3, "damaged answers")
    assert enabled.status.operational
    enabled.wait_for_report(lambda s: s.level == DiagnosticStatus.OK, "a report")


def test_an_answer_within_the_patience_is_not_missed(enabled):
    """Later than the 20 ms that a bridge waits which is not told otherwise."""
    before, end = enabled.status.short_cycles, enabled.time_ns + 20 * graph.TICK_PERIOD_NS
    enabled.lag = 0.05
    try:
        enabled.wait(lambda: enabled.answered_ns > end, "joint states")
    finally:
        enabled.lag = 0.0
    enabled.status = None
    enabled.wait(lambda: enabled.status, "a status")
    assert enabled.status.operational and enabled.status.short_cycles == before


def test_without_commands_servos_hold_still(enabled):
    """What nobody commands any more may be in the air."""
    enabled.target = None
    enabled.wait(lambda: not enabled.status.operational, "the end of operation")
    assert "no joint command" in enabled.status.reason
    start, after = enabled.position.copy(), enabled.time_ns + 600_000_000
    enabled.wait(lambda: enabled.time_ns > after, "longer than damping holds")
    assert enabled.motors.records["torque_on"].all()
    assert np.abs(enabled.position - start).max() < 0.02
    enabled.trigger(graph.DRIVES_DISABLE)  # the next test need not wait


def test_a_bad_command_is_refused_whole(enabled):
    before = enabled.status.refused_commands
    enabled.target = ROBOT.stand_joint_position + np.eye(12)[3] * 5.0
    enabled.wait(lambda: enabled.status.refused_commands > before, "a refusal")
    enabled.target = np.array(ROBOT.stand_joint_position)
    assert np.abs(enabled.position - enabled.target).max() < 0.2
    enabled.trigger(graph.DRIVES_DISABLE)  # they may hold still by now


def test_emergency_stop_holds_until_it_is_reset(enabled):
    assert enabled.trigger(graph.DRIVES_EMERGENCY_STOP)
    enabled.wait(lambda: enabled.status.emergency_stop, "the emergency stop")
    enabled.wait(lambda: not enabled.motors.records["torque_on"].any(), "torque off")
    assert "servos have stopped: emergency stop" in enabled.said()
    assert "emergency stop" in enabled.trigger(graph.DRIVES_ENABLE)
    enabled.wait(lambda: enabled.trigger(graph.DRIVES_RESET_FAULTS) == "", "a reset")
    enabled.enable()


def test_a_line_that_is_pulled_is_opened_again(enabled):
    with enabled.held():
        enabled.port.unplug()
    enabled.wait_for_report(lambda s: s.level == DiagnosticStatus.ERROR, "the lost line")
    assert "no line" in enabled.trigger(graph.DRIVES_ENABLE)
    with enabled.held():
        enabled.port.replug()
    enabled.enable()


def test_a_bridge_that_dies_leaves_servos_that_stop_by_themselves(enabled):
    """Their bus watchdog bites: they hold still and take no goals."""
    enabled.process.kill()
    enabled.process.wait()
    enabled.process = None
    records = enabled.motors.records
    enabled.wait(lambda: records["bitten"].all(), "the watchdogs")
    assert enabled.bus.servos[0].write(116, (2048).to_bytes(4, "little")) == 4
    enabled.start(time="realtime", port=enabled.port.path, command_timeout=0.03)
    enabled.status = None
    enabled.wait(lambda: enabled.status is not None, "status of the new one")
    enabled.wait(lambda: enabled.status.active, "its line")
    enabled.enable()


def test_bad_parameters_end_it_with_a_sentence():
    for parameters, words in (
        ({"time": "sundial"}, "parameter time is 'sundial'"),
        ({"robot": "carbon"}, "robot is 'carbon' with actuation 'drives', it must be one of beta"),
        ({"robot": "gamma"}, "robot is 'gamma', it must be one of carbon, beta or the path"),
    ):
        assert_refused(MODULE, words, **parameters)
