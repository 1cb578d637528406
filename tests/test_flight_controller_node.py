"""The process `flight_controller`: sensors in, pulses out, a ground station, a serial line."""

import pytest
import serial
from flight_bench import FlightBench
from node_bench import every, values_of
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from husky_msgs.msg import FlightSensors
from husky_pu.radio.sbus import encode, frame_of_pulses
from husky_runtime import graph
from husky_runtime.nodes import stamps

pytestmark = pytest.mark.graph


class World(FlightBench):
    """Advances as the plant does, and listens as a ground station."""

    def __init__(self, domain, directory, **parameters):
        super().__init__(domain, directory, **parameters)
        self.station = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{self.udp_port}", source_system=255, dialect="common"
        )

    def tick(self, count=1):
        """Advance: the next state when the last was answered."""
        for _ in range(count):
            self.time_ns += 2_000_000
            self.await_answer()

    def await_answer(self):
        """Say the state, again when it may have been lost, until it is answered."""
        say = every(0.1, self.say)
        say()
        self.wait(lambda: self.answered_ns == self.time_ns, f"an answer to {self.time_ns}", say)

    def heard(self, kind, accept=lambda message: True, ticks=1000):
        """Tick until the ground station hears a message."""
        for _ in range(ticks):
            while (message := self.station.recv_msg()) is not None:
                if message.get_type() == kind and accept(message):
                    return message
            self.tick()
        raise AssertionError(f"no {kind}")

    def beat(self):
        self.station.mav.heartbeat_send(6, 8, 0, 0, 0)

    def arm(self, force=0):
        self.station.mav.command_long_send(1, 1, 400, 0, 1, force, 0, 0, 0, 0, 0)

    def _give_back(self):
        self.station.close()
        super()._give_back()


@pytest.fixture
def world(domain, tmp_path, request):
    made = World(domain, tmp_path, **getattr(request, "param", {}))
    yield made
    made.close()


def test_a_ground_station_over_udp(world):
    world.tick()
    world.beat()
    heartbeat = world.heard("HEARTBEAT")
    assert heartbeat.autopilot == mavlink.MAV_AUTOPILOT_PX4
    assert mavutil.mode_string_v10(heartbeat) == "STABILIZED"
    world.tick(600)

    world.station.mav.param_request_list_send(1, 1)
    names = {}
    while len(names) < 2 or len(names) < next(iter(names.values())):
        message = world.heard("PARAM_VALUE")
        names[message.param_id] = message.param_count
    assert "COM_OF_LOSS_T" in names

    world.arm()
    text = world.heard("STATUSTEXT", lambda m: "denied" in m.text)
    assert "no manual control input" in text.text
    ack = world.heard("COMMAND_ACK")
    assert ack.result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert list(world.commands[-1].pwm) == [1000] * 4

    world.arm(force=21196)
    ack = world.heard("COMMAND_ACK")
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    assert world.heard("HEARTBEAT").base_mode & 128


def test_sensors_of_another_number_of_fans_are_refused_and_told(world):
    world.tick(5)
    tick = world.answered_ns
    for speeds, currents in (([], []), ([0.0] * 3, [0.0] * 4), ([0.0] * 4, [0.0] * 6)):
        wrong = FlightSensors(fan_speed=speeds, fan_current=currents)
        wrong.specific_force = [0.0, 0.0, -9.81]
        stamps.fill(wrong.stamp, tick + graph.TICK_PERIOD_NS)
        world.publisher.publish(wrong)
    world.wait(lambda: "values, it must be 4" in world.said(), "a word about it")
    assert world.answered_ns == tick
    world.tick(5)


def test_serial_line_and_radio(world):
    world.tick()
    with (
        serial.Serial(world.pixhawk, 921600, timeout=0) as line,
        serial.Serial(world.sbus, 100000, parity="E", stopbits=2, timeout=0) as radio,
    ):
        received = bytearray()

        def run(seconds, arm, throttle=1000):
            frame = encode(frame_of_pulses([1500, 1500, throttle, 1500, 1000, arm, 1000]))
            for index in range(int(seconds * 500)):
                if index % 7 == 0:
                    radio.write(frame)
                world.tick()
                received.extend(line.read(4096))

        run(2.0, 1000)
        run(0.3, 2000)
        run(1.0, 2000, 1500)
    messages = mavlink.MAVLink(None).parse_buffer(bytes(received))
    assert any(m.get_type() == "SERVO_OUTPUT_RAW" for m in messages)
    assert any(m.get_type() == "RC_CHANNELS" and m.chan3_raw == 1500 for m in messages)
    assert any(m.get_type() == "HEARTBEAT" and m.base_mode & 128 for m in messages)
    assert min(world.commands[-1].pwm) > 1100


def test_reset_of_the_world(world):
    world.tick(700)
    world.beat()
    world.arm(force=21196)
    world.heard("COMMAND_ACK")
    world.time_ns = -2_000_000
    world.tick(5)
    world.beat()
    heartbeat = world.heard("HEARTBEAT", lambda m: not m.base_mode & 128)
    assert heartbeat.system_status in (mavlink.MAV_STATE_BOOT, mavlink.MAV_STATE_STANDBY)


@pytest.mark.parametrize("world", [{"time": "lockstep", "grace": 4.0}], indirect=True)
def test_lockstep_waits_for_the_companion_while_it_takes_part(world):
    world.tick(10)

    def setpoint(stamp_ms):
        world.station.mav.set_attitude_target_send(
            stamp_ms, 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.0
        )

    setpoint(world.time_ns // 1_000_000)  # 18 ms: from now on it takes part
    world.wait_for_report(lambda r: values_of(r)["links"], "the setpoint to be there")
    world.tick(5)  # 28 ms
    world.time_ns += 2_000_000  # 30 ms needs a setpoint of 20 ms
    world.say()
    values = world.wait_for_report(lambda report: True, "a report while it waits")
    assert (values["ticks"], world.answered_ns) == ("15", 28_000_000)
    setpoint(20)
    world.await_answer()
    world.tick(20)  # it falls silent: after the grace period time goes on
    assert world.time_ns == 70_000_000


def test_parameters_outlast_the_process(domain, tmp_path):
    file = tmp_path / "kept" / "pixhawk.parameters"

    def value(world):
        world.station.mav.param_request_read_send(1, 1, b"COM_OF_LOSS_T", -1)
        return world.heard("PARAM_VALUE", lambda m: m.param_id == "COM_OF_LOSS_T").param_value

    world = World(domain, tmp_path, parameter_file=str(file))
    try:
        world.tick()
        world.station.mav.param_set_send(1, 1, b"COM_OF_LOSS_T", 0.75, 9)
        world.wait(file.exists, "the file", world.tick)
    finally:
        world.close()
    world = World(domain, tmp_path, parameter_file=str(file))
    try:
        world.tick()
        assert value(world) == 0.75
        values = world.wait_for_report(lambda report: True, "a report")
        assert values["parameters_kept"] == "1"
        file.unlink()
        file.mkdir()  # nothing can be written there
        world.station.mav.param_set_send(1, 1, b"COM_OF_LOSS_T", 0.5, 9)
        text = world.heard("STATUSTEXT", lambda m: "not stored" in m.text)
        assert text.severity == mavlink.MAV_SEVERITY_WARNING
        world.wait_for_report(
            lambda r: r.level == b"\1" and str(file) in r.message, "a warning", world.tick
        )
        assert value(world) == 0.5
    finally:
        world.close()
