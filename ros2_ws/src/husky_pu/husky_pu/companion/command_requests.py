"""MAVLink's command protocol: ask, wait for COMMAND_ACK, ask again with `confirmation` raised."""

from __future__ import annotations

from dataclasses import dataclass, field

from pymavlink.dialects.v20 import common as mavlink

ARM_DISARM = 400
DO_SET_MODE = 176
SET_MESSAGE_INTERVAL = 511
REQUEST_MESSAGE = 512
FORCE = 21196.0
"""Second parameter of ARM_DISARM that passes over checks."""
_RESULTS = {
    0: "accepted",
    1: "temporarily rejected",
    2: "denied",
    3: "unsupported",
    4: "failed",
    5: "in progress",
    6: "cancelled",
}
_TEXT_PERIOD = 0.1
"""How long a refusal waits for the STATUSTEXT that explains it [s]."""


@dataclass
class CommandRequest:
    """One command on its way.

    Attributes:
        number: MAV_CMD.
        parameters: seven numbers, as in COMMAND_LONG.
        attempts: how often it may be sent.
        retry_after: time to wait for an answer to each [s].
        sent: how often it has been sent; `confirmation` is one less.
        result: MAV_RESULT of the answer, None before it or without one.
        problem: why there is no answer, "" while that is open.
        texts: warnings of the autopilot since it was sent.
    """

    number: int
    parameters: tuple[float, ...]
    attempts: int = 3
    retry_after: float = 0.3
    sent: int = 0
    result: int | None = None
    problem: str = ""
    texts: list[str] = field(default_factory=list)
    _deadline: float = 0.0
    _settled_at: float | None = None

    def done(self, now: float) -> bool:
        """Return whether there is nothing more to wait for."""
        return self._settled_at is not None and (bool(self.texts) or now >= self._settled_at)

    @property
    def accepted(self) -> bool:
        """Whether the autopilot has said yes."""
        return self.result is not None and self.result == int(mavlink.MAV_RESULT_ACCEPTED)

    @property
    def text(self) -> str:
        """The outcome in words: the answer, and what the autopilot says of it."""
        if self.problem:
            return self.problem
        if self.result is None:
            return "no answer yet"
        answer = _RESULTS.get(self.result, f"result {self.result}")
        return answer if self.accepted or not self.texts else f"{answer}: {'; '.join(self.texts)}"

    def fail(self, problem: str, now: float) -> None:
        """End it without an answer."""
        if self._settled_at is None:
            self.problem = problem
            self._settled_at = now

    def due(self, now: float) -> bool:
        """Return whether to send it now, which counts as sent; gives up after the last attempt."""
        if self._settled_at is not None or (self.sent and now < self._deadline):
            return False
        if self.sent >= self.attempts:
            self.fail(f"no answer to command {self.number} after {self.sent} attempts", now)
            return False
        self.sent += 1
        self._deadline = now + self.retry_after
        return True

    def acknowledge(self, result: int, now: float) -> None:
        """Take the answer; only the first final one counts."""
        if self._settled_at is not None:
            return
        if result == mavlink.MAV_RESULT_IN_PROGRESS:
            self._deadline = now + self.retry_after
            return
        self.result = result
        self._settled_at = now if self.accepted else now + _TEXT_PERIOD


class CommandRequests:
    """The commands that are on their way: one of a number at a time, others of it queue up."""

    def __init__(self) -> None:
        """Nothing is on its way."""
        self._queue: list[CommandRequest] = []

    def add(self, command: CommandRequest) -> CommandRequest:
        """Put a command on its way; return it."""
        self._queue.append(command)
        return command

    def due(self, now: float) -> list[CommandRequest]:
        """Return the commands to send now."""
        self._queue = [command for command in self._queue if not command.done(now)]
        return [command for command in self._first() if command.due(now)]

    def acknowledge(self, number: int, result: int, now: float) -> bool:
        """Take an answer; return whether somebody waited for it."""
        for command in self._first():
            if command.number == number and command.sent:
                command.acknowledge(result, now)
                return True
        return False

    def text(self, text: str) -> None:
        """Take a warning: it may explain a refusal."""
        for command in self._first():
            if command.sent:
                command.texts.append(text)

    def fail(self, problem: str, now: float) -> None:
        """End all of them."""
        for command in self._queue:
            command.fail(problem, now)
        self._queue.clear()

    def _first(self) -> list[CommandRequest]:
        """Return the oldest command of each number."""
        first: dict[int, CommandRequest] = {}
        for command in self._queue:
            first.setdefault(command.number, command)
        return list(first.values())
