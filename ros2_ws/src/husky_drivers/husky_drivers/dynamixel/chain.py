"""The servos on their bus: transactions of protocol 2.0 through ROBOTIS's `dynamixel-sdk`.

What is not answered, or comes with a wrong checksum, is counted and dropped; only a line that is
gone raises. Plain Sync Read is used, not the fast one: the SDK does not take the byte stuffing out
of a fast one's answer, and a speed of -1 beside a position that ends in 0xFD is stuffed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from dynamixel_sdk import COMM_RX_TIMEOUT, COMM_SUCCESS, Protocol2PacketHandler

from husky_drivers.dynamixel.control_table import (
    ALERT,
    CYCLE_DATA,
    ServoRegister,
    StatusError,
)
from husky_drivers.dynamixel.port import DynamixelPort

_ID, _LENGTH, _ERROR, _PARAMETERS = 4, 5, 8, 9
"""Where a status packet has its id, length, error and parameters."""
_STATUS_BYTES = 11
"""Bytes of a status packet without parameters."""


class Answer(NamedTuple):
    """A status packet.

    Attributes:
        servo: id of who answers.
        error: one of `StatusError`.
        alert: it has a hardware error.
        data: its parameters.
    """

    servo: int
    error: int
    alert: bool
    data: bytes


class ServoChain:
    """Talks to the servos of one line.

    Attributes:
        port: the line.
        missed: answers that did not come, by id.
        damaged: packets that came with a wrong checksum.
        garbled: the same by the id that they seem to have.
        refused: writes that a servo has refused, in words, the newest.
    """

    def __init__(self, port: DynamixelPort):
        """Take a line that is not open yet."""
        self.port = port
        self._handler = Protocol2PacketHandler()
        self.missed: Counter[int] = Counter()
        self.garbled: Counter[int] = Counter()
        self.damaged = 0
        self.refused = ""

    # One servo, waiting for its answer ----------------------------------------------------------
    def ping(self, servo: int) -> int | None:
        """Return a servo's model number, None when it does not answer well."""
        model, result, _ = self._handler.ping(self.port, servo)
        return int(model) if self._well(servo, result) else None

    def read(self, servo: int, first: ServoRegister, last: ServoRegister) -> bytes | None:
        """Return the bytes from one register to another, None without a good answer."""
        length = last.end - first.address
        data, result, _ = self._handler.readTxRx(self.port, servo, first.address, length)
        return bytes(data) if self._well(servo, result) and len(data) == length else None

    def write(self, servo: int, register: ServoRegister, value: int) -> bool:
        """Write a register; return whether the servo has taken it."""
        data = list(register.pack(value))
        result, error = self._handler.writeTxRx(
            self.port, servo, register.address, register.size, data
        )
        if not self._well(servo, result):
            return False
        if error & ~ALERT:
            reason = StatusError(error & ~ALERT).name.lower().replace("_", " ")
            self.refused = f"servo {servo} refuses {register.name} = {value}: {reason}"
            return False
        return True

    def find(self) -> list[int]:
        """Return the ids of all servos that answer; takes the SDK about a second."""
        found, _ = self._handler.broadcastPing(self.port)
        self.port.is_using = False
        return sorted(found)

    def reboot(self, servo: int) -> bool:
        """Restart a servo; return whether it has heard."""
        result, _ = self._handler.reboot(self.port, servo)
        return self._well(servo, result)

    # One servo, its answer fetched later --------------------------------------------------------
    def ask_model(self, servo: int) -> None:
        """Ask for an answer to a ping; fetch it with `fetch`."""
        header = [0, 0, 0, 0, servo, 3, 0, 1, 0, 0]
        self._handler.txPacket(self.port, header)
        self.port.is_using = False

    def ask(self, servo: int, first: ServoRegister, last: ServoRegister) -> None:
        """Ask for the bytes from one register to another; fetch them with `fetch`."""
        length = last.end - first.address
        self._handler.readTx(self.port, servo, first.address, length)
        self.port.is_using = False

    def fetch(self) -> Answer | None:
        """Return the answer to `ask` or `ask_model` if it has come whole."""
        self.port.expect_at_once()
        return self._next_answer()

    # All servos ---------------------------------------------------------------------------------
    def sync_read(
        self, servos: Sequence[int], registers: Sequence[ServoRegister] = CYCLE_DATA
    ) -> dict[int, Answer]:
        """Read neighbouring registers of several servos at once; return the answers by id."""
        first, last = registers[0], registers[-1]
        length = last.end - first.address
        answers: dict[int, Answer] = {}
        if servos:
            self._handler.syncReadTx(
                self.port, first.address, length, list(servos), len(servos), False
            )
            self.port.setPacketTimeout((_STATUS_BYTES + length) * len(servos))
        while len(answers) < len(servos):
            answer = self._next_answer()
            if answer is None:
                if self.port.isPacketTimeout():
                    break
            elif answer.servo in servos and len(answer.data) == length:
                answers[answer.servo] = answer
        self.missed.update(servo for servo in servos if servo not in answers)
        return answers

    def sync_write(self, register: ServoRegister, values: Mapping[int, int]) -> None:
        """Write a register of several servos at once; nobody answers."""
        parameters: list[int] = []
        for servo, value in values.items():
            parameters += [servo, *register.pack(value)]
        self._handler.syncWriteTxOnly(
            self.port, register.address, register.size, parameters, len(parameters)
        )

    # Answers ------------------------------------------------------------------------------------
    def _next_answer(self) -> Answer | None:
        """Return the next packet on the line, None when it is damaged or none comes in time."""
        packet, result = self._handler.rxPacket(self.port, False)
        if result != COMM_SUCCESS:
            if result != COMM_RX_TIMEOUT:
                self.damaged += 1
                self.garbled.update(packet[_ID : _ID + 1])
            return None
        error, end = packet[_ERROR], _LENGTH + (packet[_LENGTH] | packet[_LENGTH + 1] << 8)
        return Answer(
            packet[_ID], error & ~ALERT, bool(error & ALERT), bytes(packet[_PARAMETERS:end])
        )

    def _well(self, servo: int, result: int) -> bool:
        self.port.is_using = False
        if result == COMM_SUCCESS:
            return True
        if result == COMM_RX_TIMEOUT:
            self.missed[servo] += 1
        else:
            self.damaged += 1
            self.garbled[servo] += 1
        return False
