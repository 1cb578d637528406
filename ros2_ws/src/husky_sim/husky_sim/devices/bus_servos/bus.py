"""The bus of emulated servos: bytes in, answers out, and what can go wrong on it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from husky_description.bus_servo import BusServoSection
from husky_drivers.dynamixel import control_table as table
from husky_drivers.dynamixel.control_table import BROADCAST, Instruction, StatusError
from husky_sim.devices.bus_servos.motors import AMBIENT, BusServoMotors
from husky_sim.devices.bus_servos.packets import (
    HEADER,
    InstructionPacket,
    PacketReader,
    checksum,
)
from husky_sim.devices.bus_servos.servo import EmulatedServo

FAULTS = (
    "unplug",
    "brownout",
    "id_conflict",
    "checksum",
    "overload",
    "overheat",
    "encoder",
    "shock",
)
"""What `EmulatedServoBus.inject` knows, besides "" for healing; `checksum:0.5` damages every other
answer."""
_HEALTH = b"".join(
    number.to_bytes(2, "little")
    for number in (
        table.HEALTH_DATA[0].address,
        table.HEALTH_DATA[-1].end - table.HEALTH_DATA[0].address,
    )
)
"""Parameters of a read of a servo's health: address and length."""
_MOST_OUTPUT = 65536
"""Bytes that wait for the master at most."""


class EmulatedServoBus:
    """Servos on one half-duplex line; implements `husky_runtime.ports.pty_port.SerialDevice`.

    Attributes:
        servos: in joint order, ids from 1.
        packets: instruction packets heard, sound or not.
        cycle_words: sync writes, which end a tick of the master's in which a cycle begins.
        health_words: reads of a servo's health, which end its other ticks
            (`husky_drivers.dynamixel.servo_master`).
        reader: finds packets; counts what is none.
    """

    def __init__(self, servo: BusServoSection, joints: Sequence[str], motors: BusServoMotors):
        """Power on.

        Args:
            servo: their data sheet.
            joints: their names.
            motors: of the servos, in the same order.
        """
        self._baud = servo.baud_rate
        self._names = {name: index for index, name in enumerate(joints)}
        self.servos = [
            EmulatedServo(index + 1, servo, motors.records[index]) for index in range(len(joints))
        ]
        self.reader = PacketReader()
        self.packets = self.cycle_words = self.health_words = 0
        self._output = bytearray()
        self._conflicts: set[int] = set()
        self._damage = [0.0] * len(self.servos)
        self._damaged = [0.0] * len(self.servos)
        self._starved: set[int] = set()

    # SerialDevice -------------------------------------------------------------------------------
    @property
    def baud(self) -> int:
        """Rate of the bus."""
        return self._baud

    def feed(self, data: bytes) -> None:
        """Take bytes of the master."""
        for packet in self.reader.feed(data):
            self.packets += 1
            for servo in self.servos:
                servo.hear()
            if packet.sound:
                self._obey(packet)
            else:
                self._answer(packet.servo, packet.instruction, StatusError.CRC)

    def take_output(self) -> bytes:
        """Return the answers since the last call."""
        output = bytes(self._output[:_MOST_OUTPUT])
        self._output.clear()
        return output

    # Time ---------------------------------------------------------------------------------------
    def advance(self, period: float) -> None:
        """Let time [s] pass."""
        for index, servo in enumerate(self.servos):
            if index in self._starved:
                servo.restart()
            servo.advance(period)

    def restart(self) -> None:
        """The world is back at time 0: what was heard is forgotten, faults stay."""
        self._output.clear()
        self.reader = PacketReader()
        for servo in self.servos:
            servo.booting = 0.0

    # Instructions -------------------------------------------------------------------------------
    def _obey(self, packet: InstructionPacket) -> None:
        number, instruction, parameters, _ = packet
        if instruction == Instruction.SYNC_READ:
            self._sync_read(parameters)
        elif instruction == Instruction.FAST_SYNC_READ:
            self._fast_sync_read(parameters)
        elif instruction == Instruction.SYNC_WRITE:
            self.cycle_words += 1
            self._sync_write(parameters)
        elif number == BROADCAST:
            self._obey_all(instruction, parameters)
        else:
            self.health_words += instruction == Instruction.READ and parameters == _HEALTH
            self._obey_one(number, instruction, parameters)

    def _obey_one(self, number: int, instruction: int, parameters: bytes) -> None:
        meant = self._meant(bytes([number]))
        self._say_at_once(
            (index, servo.answer(instruction, servo.execute(instruction, parameters)))
            for index, servo in meant
        )
        if instruction == Instruction.REBOOT:
            for _, servo in meant:
                servo.restart()

    def _obey_all(self, instruction: int, parameters: bytes) -> None:
        """Do what is said to all: nobody answers but to a ping."""
        for index, servo in enumerate(self.servos):
            if not servo.answers:
                continue
            outcome = servo.execute(instruction, parameters)
            if instruction == Instruction.PING:
                self._say(index, servo.answer(instruction, outcome))
            elif instruction == Instruction.REBOOT:
                servo.restart()

    def _answer(self, number: int, instruction: int, error: int) -> None:
        self._say_at_once(
            (index, servo.answer(instruction, (error, b"")))
            for index, servo in self._meant(bytes([number]))
        )

    def _meant(self, numbers: bytes) -> list[tuple[int, EmulatedServo]]:
        """Return the servos of these ids that answer, in this order, with their places."""
        return [
            (index, servo)
            for number in numbers
            for index, servo in enumerate(self.servos)
            if servo.number == number and servo.answers
        ]

    def _sync_read(self, parameters: bytes) -> None:
        """Each answers in turn; one that is missing leaves a hole (the e-manual does not say)."""
        address = int.from_bytes(parameters[:2], "little")
        length = int.from_bytes(parameters[2:4], "little")
        for number in parameters[4:]:
            self._say_at_once(
                (index, servo.answer(Instruction.SYNC_READ, servo.read(address, length)))
                for index, servo in self._meant(bytes([number]))
            )

    def _fast_sync_read(self, parameters: bytes) -> None:
        """All answer in one packet, each with the checksum so far; a missing one ends it."""
        address = int.from_bytes(parameters[:2], "little")
        length = int.from_bytes(parameters[2:4], "little")
        numbers = parameters[4:]
        said = 1 + len(numbers) * (length + 4)
        body = HEADER + bytes([0, BROADCAST]) + said.to_bytes(2, "little")
        body += bytes([Instruction.STATUS])
        for (_, servo), number in zip(self._meant(numbers), numbers, strict=False):
            if servo.number != number:
                break
            error, data = servo.read(address, length)
            alert = table.ALERT if servo.motor["error"] else 0
            body += bytes([error | alert, servo.number]) + data
            body += checksum(body).to_bytes(2, "little")
        self._output += body

    def _sync_write(self, parameters: bytes) -> None:
        address = int.from_bytes(parameters[:2], "little")
        length = int.from_bytes(parameters[2:4], "little")
        rest = parameters[4:]
        for start in range(0, len(rest), length + 1):
            piece = rest[start : start + length + 1]
            if len(piece) != length + 1 or length == 0:
                break
            for _, servo in self._meant(piece[:1]):
                servo.write(address, piece[1:])

    def _say_at_once(self, answers: Iterable[tuple[int, bytes]]) -> None:
        """Put the answers of all servos of one id on the line: a low level wins."""
        (*others, last) = list(answers) or [(0, b"")]
        index, packet = last
        for _, other in others:
            common = bytes(a & b for a, b in zip(packet, other, strict=False))
            packet = common + max(packet, other, key=len)[len(common) :]
        self._say(index, packet)

    def _say(self, index: int, packet: bytes) -> None:
        """Put a servo's answer on the line, as the line's faults leave it."""
        if index in self._conflicts:
            # Two drivers at once, of another servo's readings: a low level wins.
            packet = bytes(a & (a + 37 * (1 + i)) if i > 8 else a for i, a in enumerate(packet))
        self._damaged[index] += self._damage[index]
        if packet and self._damaged[index] >= 1.0:
            self._damaged[index] -= 1.0
            packet = packet[:-1] + bytes([packet[-1] ^ 0x10])
        self._output += packet

    # Faults -------------------------------------------------------------------------------------
    def inject(self, joint: str, fault: str) -> None:
        """Make a servo fail (`FAULTS`), or heal it with "".

        Raises:
            ValueError: no such joint or fault.
        """
        if joint not in self._names:
            raise ValueError(f"no servo {joint!r}; there are {', '.join(self._names)}")
        index = self._names[joint]
        servo = self.servos[index]
        kind, _, share = fault.partition(":")
        if kind == "unplug":
            servo.silent = True
            servo.motor["torque_on"] = 0
        elif kind == "brownout":
            self._starved.add(index)
        elif kind == "id_conflict":
            self._conflicts.add(index)
        elif kind == "checksum":
            self._damage[index] = float(share) if share else 1.0
        elif kind == "overload":
            servo.motor["loaded"] = 1e3
        elif kind == "overheat":
            servo.motor["temperature"] = servo.motor["temperature_limit"] + 20.0
        elif kind == "encoder":
            servo.motor["error"] |= int(table.HardwareError.MOTOR_ENCODER)
        elif kind == "shock":
            servo.motor["error"] |= int(table.HardwareError.ELECTRICAL_SHOCK)
        elif kind == "":
            self._heal(index)
        else:
            raise ValueError(f"fault of a servo is {fault!r}, there are {', '.join(FAULTS)}")

    def _heal(self, index: int) -> None:
        servo = self.servos[index]
        if servo.silent or index in self._starved:
            servo.restart()
        servo.silent = False
        self._starved.discard(index)
        self._conflicts.discard(index)
        self._damage[index] = self._damaged[index] = 0.0
        servo.motor["loaded"] = 0.0
        servo.motor["temperature"] = min(float(servo.motor["temperature"]), AMBIENT)
