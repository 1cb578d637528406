"""A scripted VN-200, and the line between it and a session."""

from husky_drivers.vn200.binary import IMU_LAYOUT
from husky_drivers.vn200.protocol import AsciiMessage, decode_ascii
from husky_drivers.vn200.session import SessionConfig, SessionState, Vn200Session

STEP = 0.00125
DIALOGUE = [
    b"$VNASY,0*4F\r\n",
    b"$VNWRG,05,921600*53\r\n",
    b"$VNASY,0*4F\r\n",
    b"$VNRRG,01*72\r\n",
    b"$VNRRG,30*70\r\n",
    b"$VNRRG,26*77\r\n",
    b"$VNRRG,06*75\r\n",
    b"$VNWRG,06,0*6C\r\n",
    b"$VNRRG,76*72\r\n",
    b"$VNRRG,77*73\r\n",
    b"$VNRRG,75*71\r\n",
    b"$VNWRG,75,1,1,01,0131*76\r\n",
    b"$VNASY,1*4E\r\n",
]
"""With a device from the factory."""
FACTORY = {
    "06": ("1",),
    "26": ("1", "0", "0", "0", "1", "0", "0", "0", "1"),
    "30": ("0", "0", "0", "0", "1", "0", "1"),
    "75": ("0", "1", "00"),
    "76": ("0", "1", "00"),
    "77": ("0", "1", "00"),
}


class Script:
    """A device that echoes what it is told, at its baud rate, and can be made to misbehave."""

    def __init__(self, baud=115200, replies_at_new_baud=False, **registers):
        self.registers = FACTORY | {name[1:]: fields for name, fields in registers.items()}
        self.baud = baud
        self.replies_at_new_baud = replies_at_new_baud
        self.model = "VN-200T-CR"
        self.paused = False
        self.heard = []
        self.lose = 0
        self.answer = None
        self.silent = False
        self.frozen = False
        self._ticks = 0

    def hear(self, data, baud):
        """Return what comes back, as (bytes, baud)."""
        if self.silent or not data or baud != self.baud:
            return b"", self.baud
        self.heard.append(data)
        if self.lose > 0:
            self.lose -= 1
            return b"", self.baud
        if self.answer is not None:
            return self.answer(data), self.baud
        message = decode_ascii(data)
        old = self.baud
        fields = message.fields
        if message.command == "ASY":
            self.paused = fields == ("0",)
        elif message.command == "WRG" and fields[0] == "05":
            self.baud = int(fields[1])
        elif message.command == "WRG":
            self.registers[fields[0]] = fields[1:]
        elif message.command == "RRG" and fields[0] == "01":
            fields = (*fields, self.model)
        elif message.command == "RRG":
            fields = (*fields, *self.registers[fields[0]])
        reply = AsciiMessage(message.command, fields).encode()
        return reply, self.baud if self.replies_at_new_baud else old

    @property
    def output(self):
        """Binary output 1."""
        return self.registers["75"]

    @output.setter
    def output(self, fields):
        self.registers["75"] = fields

    @property
    def time(self):
        """Its clock [s]."""
        return 1.25e-3 * self._ticks

    def tick(self):
        self._ticks += not self.frozen
        if self.silent or self.paused or self.output != ("1", "1", "01", "0131"):
            return b""
        return IMU_LAYOUT.encode(self._ticks * 1_250_000, 0, 0, 0, 1, 0, 0, 0, 0, 0, -9.81)


class Line:
    """A session and a device in simulated time."""

    def __init__(self, device=None, world_time=lambda: None, **config):
        self.device = device if device is not None else Script()
        self.session = Vn200Session(SessionConfig(**config), world_time)
        self.now = 0.0
        self.sent = []
        self.samples = []
        self.reopened = 0
        self.session.start(self.now)

    def step(self):
        self.now += STEP
        arriving = [(self.device.tick(), self.device.baud)]
        if self.now >= self.session.deadline:
            data = self.session.poll(self.now)
            if data:
                self.sent.append((self.now, self.session.baud, data))
            arriving.append(self.device.hear(data, self.session.baud))
        if self.session.reopen_wanted:
            self.reopened += 1
            self.session.start(self.now)
        for data, baud in arriving:
            if data and baud == self.session.baud:
                self.samples += self.session.feed(data, self.now)

    def run(self, duration):
        for _ in range(round(duration / STEP)):
            self.step()

    def run_until(self, state, limit):
        """Return the time that it took."""
        start = self.now
        while self.session.state is not state:
            assert self.now - start < limit, f"{self.session.state} instead of {state}"
            self.step()
        return self.now - start


def streaming_line(device=None, **config):
    line = Line(device, **config)
    line.run_until(SessionState.STREAMING, 1.0)
    line.run(0.1)
    return line
