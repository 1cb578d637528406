"""Servos that somebody else has set up, and ids that are missing or doubled."""

import numpy as np
import pytest
from servo_line import ROBOT, SERVO, Line

from husky_drivers.dynamixel import control_table as table
from husky_drivers.dynamixel.chain import ServoChain
from husky_drivers.dynamixel.commissioning import GARBLED, ServoSetup, registers_of
from husky_drivers.dynamixel.control_table import ServoRegister
from husky_drivers.dynamixel.port import DynamixelPort
from husky_drivers.dynamixel.servo_master import ServoMaster
from husky_drivers.dynamixel.settings import servo_settings

SAVED = {
    table.TORQUE_ENABLE: 1,
    table.BUS_WATCHDOG: 5,
    table.RETURN_DELAY: 250,
    table.DRIVE_MODE: 5,
    table.OPERATING_MODE: 16,
    table.SECONDARY_ID: 7,
    table.TEMPERATURE_LIMIT: 40,
    table.MAX_VOLTAGE_LIMIT: 120,
    table.MIN_VOLTAGE_LIMIT: 110,
    table.PWM_LIMIT: 300,
    table.CURRENT_LIMIT: 100,
    table.VELOCITY_LIMIT: 10,
    table.STARTUP: 2,
    table.SHUTDOWN: 0,
    table.POSITION_D_GAIN: 1,
    table.POSITION_I_GAIN: 1,
    table.POSITION_P_GAIN: 1,
    table.FEEDFORWARD_1ST_GAIN: 1,
    table.FEEDFORWARD_2ND_GAIN: 1,
    table.GOAL_PWM: 200,
    table.PROFILE_ACCELERATION: 1,
    table.PROFILE_VELOCITY: 1,
    table.GOAL_CURRENT: 50,
    table.STATUS_RETURN_LEVEL: 1,
}
ANY = 3
NUMBER = ANY + 1


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    line = Line(tmp_path_factory.mktemp("servos"))
    yield line
    line.close()


@pytest.fixture
def line(shared):
    """A line whose servos are as one set-up leaves them."""
    shared.port._patience = 5.0
    for index, servo in enumerate(shared.bus.servos):
        factory = {register: register.initial for register in table.TABLE if register.writable}
        factory |= {table.ID: index + 1, table.HOMING_OFFSET: 0, table.BUS_WATCHDOG: 0}
        servo.preset(factory | {table.GOAL_POSITION: 2048} | dict(registers_of(SERVO)))
    return shared


def held(servo, register: ServoRegister):
    return register.unpack(servo.read(register.address, register.size)[1])


@pytest.mark.parametrize("register", SAVED, ids=lambda register: register.name)
def test_whatever_is_saved_the_servo_gets_the_value_that_it_has_to_have(line, register):
    servo = line.bus.servos[ANY]
    servo.preset({register: SAVED[register]})
    if register is table.TORQUE_ENABLE:
        servo.motor["torque_on"] = 1
    setup = ServoSetup(ServoChain(line.port), SERVO)
    assert setup.commission(ANY, NUMBER) == ""
    wanted = dict(registers_of(SERVO)) | {table.STATUS_RETURN_LEVEL: 2}
    for each, value in wanted.items():
        assert held(servo, each) == value, each.name
    change = setup.changes[ANY, register.title]
    assert change.after == str(wanted[register])
    assert change.before == str(SAVED[register])


def test_every_register_that_is_set_is_among_them():
    assert {register for register, _ in registers_of(SERVO)} == set(SAVED) - {
        table.STATUS_RETURN_LEVEL
    }


def test_a_servo_that_answers_no_read_is_made_to(line):
    line.bus.servos[ANY].preset({table.STATUS_RETURN_LEVEL: 0})
    line.port._patience = 0.3  # for the one answer that does not come
    setup = ServoSetup(ServoChain(line.port), SERVO)
    assert setup.commission(ANY, NUMBER) == ""
    assert setup.changes[ANY, "status return level (68)"].before == "0"


def test_older_firmware_has_no_startup_configuration(line):
    servo = line.bus.servos[ANY]
    servo._set(table.FIRMWARE_VERSION, 44)
    servo.preset({table.STARTUP: 1})
    assert ServoSetup(ServoChain(line.port), SERVO).commission(ANY, NUMBER) == ""
    assert held(servo, table.STARTUP) == 1
    servo._set(table.FIRMWARE_VERSION, 48)


def test_gains_that_a_new_operating_mode_resets_are_set_again(line, monkeypatch):
    """As the maker's servos do it: the gains were right before."""
    servo = line.bus.servos[ANY]
    servo.preset({table.OPERATING_MODE: 3} | {table.POSITION_P_GAIN: SERVO.position_p})
    take = servo._take

    def resetting(registers, data):
        take(registers, data)
        if table.OPERATING_MODE in registers:
            servo._set(table.POSITION_P_GAIN, 800)

    monkeypatch.setattr(servo, "_take", resetting)
    assert ServoSetup(ServoChain(line.port), SERVO).commission(ANY, NUMBER) == ""
    assert held(servo, table.POSITION_P_GAIN) == SERVO.position_p


def test_a_servo_that_does_not_keep_a_value_is_not_used(line, monkeypatch):
    servo = line.bus.servos[ANY]
    servo.preset({table.RETURN_DELAY: 250})
    monkeypatch.setattr(servo, "_take", lambda registers, data: None)
    why = ServoSetup(ServoChain(line.port), SERVO).commission(ANY, NUMBER)
    assert why.startswith("does not keep return delay time (9), position d gain (80)")


def test_a_homing_offset_is_refused_unless_it_is_expected(line):
    """It may be the calibration of how the servo is mounted: 100 counts are 0.15 rad."""
    servo = line.bus.servos[ANY]
    count = held(servo, table.PRESENT_POSITION)
    servo.preset({table.HOMING_OFFSET: 100})
    assert held(servo, table.PRESENT_POSITION) == count + 100
    setup = ServoSetup(ServoChain(line.port), SERVO)
    why = setup.commission(ANY, NUMBER)
    assert why.startswith("homing offset (20) is 100, expected 0")
    assert "homing_offsets" in why and not setup.changes
    assert held(servo, table.HOMING_OFFSET) == 100
    assert setup.commission(ANY, NUMBER, 100) == ""


def master_on(line):
    port = DynamixelPort(str(line.far.path), SERVO.baud_rate, 0.05)
    chain = ServoChain(port)
    port.setPacketTimeoutMillis = lambda msec: DynamixelPort.setPacketTimeoutMillis(port, 20.0)
    line.port.close()
    return ServoMaster(chain, servo_settings(ROBOT, SERVO, 0.01))


def after_connecting(line):
    master = master_on(line)
    master.connect()
    master.disconnect("end of the test")
    line.port.open()
    return master


def test_a_servo_with_another_id_is_named_with_it(line):
    line.bus.servos[ANY].preset({table.ID: 23})
    master = after_connecting(line)
    assert master.troubles.unusable == {
        ANY: "no answer; ids 23 answer, which no joint has",
    }
    name = ROBOT.joint_names[ANY]
    assert f"{name} (servo 4): no answer; ids 23" in master.troubles.why_not_well(enabled=False)


def test_two_servos_of_one_id_are_named_and_so_is_the_missing_one(line):
    line.motors.update_state(np.linspace(-1.0, 1.0, 12))
    line.bus.servos[ANY].preset({table.ID: 2})
    master = after_connecting(line)
    assert master.troubles.unusable == {1: GARBLED, ANY: "no answer"}


def test_changes_are_told_by_joint(line):
    for index, servo in enumerate(line.bus.servos):
        gain = 800 if index == ANY else SERVO.position_p
        ours = dict(registers_of(SERVO))
        servo.preset(ours | {table.RETURN_DELAY: 250, table.POSITION_P_GAIN: gain})
    told = after_connecting(line).counters()["changed"].split("; ")
    assert f"{ROBOT.joint_names[ANY]}: position p gain (84) was 800, set to 2694" in told
    assert "all servos: return delay time (9) was 250, set to 0" in told


@pytest.mark.parametrize("offsets", [(1,), (0,) * 11 + (2_000_000,)])
def test_offsets_are_checked(offsets):
    with pytest.raises(ValueError, match=r"homing_offsets is .* it must be 12 numbers within"):
        servo_settings(ROBOT, SERVO, 0.01, offsets)
