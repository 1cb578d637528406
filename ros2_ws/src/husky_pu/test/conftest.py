"""What tests of this package share; import mode importlib does not find it by itself."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from scripted_autopilot import ScriptedAutopilot

from husky_pu.companion.client import ClientConfig, MavlinkClient


@pytest.fixture(scope="session")
def make_autopilot():
    return ScriptedAutopilot


class Pair:
    """A client and an autopilot joined by a wire, and a time that the test moves."""

    def __init__(self, autopilot, unix_time=lambda: 1.8e9, **config):
        self.client = MavlinkClient(ClientConfig(4, **config), unix_time)
        self.autopilot = autopilot
        self.now = 100.0

    def carry(self):
        """Until nobody has anything more to say."""
        while True:
            up, down = self.client.take_output(), self.autopilot.take_output()
            if not up and not down:
                return
            self.autopilot.feed(up)
            self.client.feed(down, self.now)

    def wait(self, seconds, step=0.05):
        for _ in range(round(seconds / step) + 1):
            self.now += step
            self.client.poll(self.now)
            self.carry()

    def connect(self):
        self.autopilot.heartbeat()
        self.carry()
        self.wait(0.5)
        assert self.client.connected
        return self

    def ask(self, *command):
        answer = self.client.command(*command)
        self.client.poll(self.now)
        self.carry()
        return answer


@pytest.fixture(scope="session")
def make_pair():
    return Pair


@pytest.fixture
def pair():
    return Pair(ScriptedAutopilot()).connect()
