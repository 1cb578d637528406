"""Emulated servos against ROBOTIS's own SDK as their master, over a pseudo-terminal."""

import random

import numpy as np
import pytest
from dynamixel_sdk import (
    COMM_RX_TIMEOUT,
    COMM_SUCCESS,
    GroupSyncRead,
    GroupSyncWrite,
)
from servo_line import SERVO, Line

from husky_drivers.dynamixel import control_table as table
from husky_drivers.dynamixel.chain import ServoChain
from husky_drivers.dynamixel.commissioning import ServoSetup, registers_of
from husky_drivers.dynamixel.control_table import HardwareError, StatusError

IDS = range(1, 13)


@pytest.fixture
def line(tmp_path):
    line = Line(tmp_path)
    yield line
    line.close()


def test_ping_names_the_model(line):
    for number in IDS:
        assert line.sdk.ping(line.port, number) == (SERVO.model_number, COMM_SUCCESS, 0)


def test_ping_of_nobody_is_not_answered(line):
    assert line.sdk.ping(line.impatient(), 99)[1] == COMM_RX_TIMEOUT


def test_sync_write_and_sync_read_of_the_sdk(line):
    write = GroupSyncWrite(line.port, line.sdk, table.GOAL_POSITION.address, 4)
    for number in IDS:
        write.addParam(number, list(table.GOAL_POSITION.pack(1000 + number)))
    assert write.txPacket() == COMM_SUCCESS
    read = GroupSyncRead(line.port, line.sdk, table.GOAL_POSITION.address, 4)
    for number in IDS:
        read.addParam(number)
    assert read.txRxPacket() == COMM_SUCCESS
    for number in IDS:
        assert read.getData(number, table.GOAL_POSITION.address, 4) == 1000 + number
    assert read.fastSyncRead() == COMM_SUCCESS
    for number in IDS:
        assert read.getData(number, table.GOAL_POSITION.address, 4) == 1000 + number


def test_a_stuffed_answer_is_read(line):
    """A speed of -1 count beside a position that ends in FD looks like a header."""
    record = line.motors.records[2]
    record["seen_rate"], record["count"] = -1.0 * 4096 * 0.229 / 60, 0x7FD
    chain = ServoChain(line.port)
    answers = chain.sync_read(list(IDS))
    data = answers[3].data
    assert data[2:6] == b"\xff\xff\xff\xff" and table.PRESENT_POSITION.unpack(data[6:]) == 0x7FD
    assert not chain.damaged and not chain.missed


@pytest.mark.parametrize(
    ("register", "value", "error"),
    [
        (table.PRESENT_POSITION, 5, StatusError.ACCESS),
        (table.OPERATING_MODE, 2, StatusError.DATA_RANGE),
        (table.POSITION_P_GAIN, 20000, StatusError.DATA_RANGE),
        (table.GOAL_POSITION, 5000, StatusError.DATA_LIMIT),
        (table.GOAL_CURRENT, 1500, StatusError.DATA_LIMIT),
        (table.LED, 1, StatusError.NONE),
    ],
)
def test_writes_that_a_servo_refuses(line, register, value, error):
    """A factory-fresh servo is in position mode, of one turn."""
    data = list(register.pack(value))
    result = line.sdk.writeTxRx(line.port, 1, register.address, register.size, data)
    assert result == (COMM_SUCCESS, error)


def test_half_a_register_is_no_data(line):
    write = line.sdk.writeTxRx(line.port, 1, table.GOAL_POSITION.address, 2, [1, 2])
    assert write == (COMM_SUCCESS, StatusError.DATA_LENGTH)
    assert line.sdk.readTxRx(line.port, 1, 600, 4)[2] == StatusError.ACCESS


def test_eeprom_is_locked_while_torque_is_on(line):
    sdk, port = line.sdk, line.port
    assert sdk.write1ByteTxRx(port, 1, table.TORQUE_ENABLE.address, 1) == (COMM_SUCCESS, 0)
    mode = table.OPERATING_MODE.address
    assert sdk.write1ByteTxRx(port, 1, mode, 5) == (COMM_SUCCESS, StatusError.ACCESS)
    assert sdk.write1ByteTxRx(port, 1, table.TORQUE_ENABLE.address, 0) == (COMM_SUCCESS, 0)
    assert sdk.write1ByteTxRx(port, 1, mode, 5) == (COMM_SUCCESS, 0)


def test_registered_writes_wait_for_the_action(line):
    sdk, port, goal = line.sdk, line.port, table.GOAL_POSITION
    assert sdk.regWriteTxRx(port, 1, goal.address, 4, list(goal.pack(77))) == (COMM_SUCCESS, 0)
    assert sdk.read4ByteTxRx(port, 1, goal.address)[0] != 77
    assert sdk.action(port, 1) == COMM_SUCCESS
    line.port.setPacketTimeout(11)
    assert sdk.rxPacket(port, False)[1] == COMM_SUCCESS  # the SDK does not wait for this answer
    assert sdk.read4ByteTxRx(port, 1, goal.address)[0] == 77


def test_factory_reset_is_refused_and_unknown_instructions_too(line):
    assert line.sdk.factoryReset(line.port, 1, 0xFF) == (COMM_SUCCESS, StatusError.RESULT_FAIL)
    assert line.sdk.clearMultiTurn(line.port, 1) == (COMM_SUCCESS, StatusError.INSTRUCTION)


def test_a_servo_that_has_shut_down_alerts_until_it_is_restarted(line):
    chain, record = ServoChain(line.port), line.motors.records[3]
    assert ServoSetup(chain, SERVO).commission(3, 4) == ""
    assert chain.write(4, table.TORQUE_ENABLE, 1)
    record["loaded"] = 10.0
    line.motors.step(np.zeros(12), np.zeros(12))
    answer = chain.sync_read([4])[4]
    assert answer.alert and not record["torque_on"]
    assert not chain.write(4, table.TORQUE_ENABLE, 1)
    assert chain.read(4, table.HARDWARE_ERROR, table.HARDWARE_ERROR) == bytes(
        [HardwareError.OVERLOAD]
    )
    assert chain.reboot(4)
    line.bus.advance(0.6)
    assert not chain.sync_read([4])[4].alert
    assert ServoSetup(chain, SERVO).commission(3, 4) == "" and chain.write(
        4, table.TORQUE_ENABLE, 1
    )


def test_commissioning_writes_only_what_differs(line):
    chain = ServoChain(line.port)
    assert ServoSetup(chain, SERVO).commission(0, 1) == ""
    for register, value in registers_of(SERVO):
        assert register.unpack(chain.read(1, register, register)) == value
    writes = []
    chain.write = lambda *arguments: writes.append(arguments) or True
    assert ServoSetup(chain, SERVO).commission(0, 1) == "" and not writes


def test_another_model_is_not_used(line):
    line.bus.servos[5]._set(table.MODEL_NUMBER, 1020)
    assert "1020" in ServoSetup(ServoChain(line.port), SERVO).commission(5, 6)


def test_a_silent_return_level_answers_pings_alone(line):
    sdk, port = line.sdk, line.port
    sdk.write1ByteTxOnly(port, 1, table.STATUS_RETURN_LEVEL.address, 0)
    assert sdk.ping(port, 1)[1] == COMM_SUCCESS
    assert sdk.read1ByteTxRx(line.impatient(), 1, table.LED.address)[1] == COMM_RX_TIMEOUT


def test_bytes_of_no_sense_harm_neither_side(line):
    """Random bytes, and packets cut and bent, to the servos; then all is as before."""
    chain, dice = ServoChain(line.impatient()), random.Random(3)
    good = bytes.fromhex("FFFFFD0001070002840004001D15")
    for _ in range(60):
        bent = bytearray(good * dice.randrange(1, 4))
        for _ in range(dice.randrange(4)):
            bent[dice.randrange(len(bent))] = dice.randrange(256)
        noise = bytes(bent[: dice.randrange(len(bent))]) + dice.randbytes(dice.randrange(30))
        line.port.writePort(list(noise))
    line.port.writePort([0] * 1100)  # the longest packet that can have begun is over
    line.port._patience = 5.0
    chain.ping(1)
    assert len(chain.sync_read(list(IDS))) == 12
    for servo in line.bus.servos:
        assert servo.number in IDS and not servo.motor["torque_on"]


def test_noise_on_the_line_is_no_answer(line):
    chain, dice = ServoChain(line.impatient()), random.Random(4)
    for _ in range(40):
        line.far.write(dice.randbytes(dice.randrange(1, 80)), SERVO.baud_rate)
        chain.fetch()
    line.port._patience = 5.0
    assert len(chain.sync_read(list(IDS))) == 12
