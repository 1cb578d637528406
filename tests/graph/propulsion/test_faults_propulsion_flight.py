"""The propulsion unit alone, flown by the pilot's sticks, and what fails in the air."""

import pytest

from husky_runtime import graph

pytestmark = pytest.mark.graph

CLIMB = 0.18
"""Throttle of a slow climb: 14.4 N for 1.28 kg."""
LIFT = 13.0
"""Less does not make it climb: it weighs 12.6 N [N]."""
FLOOR = 1.0
"""Higher is in the air [m]."""


class Pilot:
    """Holds the sticks of the remote control."""

    def __init__(self, fans):
        self.fans, self.session = fans, fans.session

    def hold(self, duration, throttle=0.0, *, arm=True):
        """Hold throttle (0 to 1) and arming switch for a while [s]; the rest is centred."""
        s = self.session
        for _ in range(round(duration / 0.1)):
            s.joystick([0.0, 2.0 * throttle - 1.0, 0.0, 0.0, 0.0], [0, 0, 0, 0, 0, 0, 0, int(arm)])
            s.advance(0.1)

    def is_heard(self):
        """Move the sticks a little; return whether the radio has them."""
        self.hold(0.1, arm=False)
        return self.fans.robot.reported(graph.RC_TRANSMITTER, "").message == "sending"

    def arm(self):
        """Move the arming switch, and let the speed controllers see low pulses."""
        self.hold(1.0, arm=False)
        self.hold(1.5)
        assert self.session.propulsion.armed, self.fans.seen

    def flies(self):
        """Whether it is in the air, as `take_off` leaves it."""
        s = self.session
        return s.propulsion is not None and s.propulsion.armed and self.fans.lift() > LIFT

    def take_off(self):
        """From a fresh world into the air, climbing."""
        s = self.session
        self.fans.heal()
        s.reset(seed=1)
        self.arm()
        start = self.fans.robot.height
        self.fans.robot.until(
            lambda: self.fans.robot.height > start + FLOOR or self.hold(0.1, CLIMB),
            "the unit in the air",
            within=6.0,
            step=0.002,
        )


@pytest.fixture
def pilot(unit_of_module):
    """The unit in the air, climbing slowly by its pilot's sticks."""
    pilot = Pilot(unit_of_module)
    if not pilot.flies():
        pilot.take_off()
    return pilot


def test_radio_lost_in_flight(pilot, record_property):
    fans, s = pilot.fans, pilot.session
    died = fans.watch()
    s.kill(graph.RC_TRANSMITTER)
    record_property("reaction_s", fans.thrust_ends(died))
    assert not s.propulsion.armed, fans.seen
    fans.robot.reported(graph.FLIGHT_CONTROLLER, "rc_transmitter lost")
    back = fans.watch()
    s.start(graph.RC_TRANSMITTER)
    fans.robot.until(pilot.is_heard, "the new radio", within=5.0)
    assert fans.rise(back) == 0.0 and not s.propulsion.armed, "the radio is back, and fans turn"
    s.reset(seed=1)
    pilot.arm()


@pytest.mark.slow  # `test_sticks_failsafe_and_a_line_that_vanishes`; the unit: `test_rc_loss`
def test_joystick_lost_in_flight(pilot, record_property):
    """The transmitter runs on, and says failsafe by itself."""
    fans, s = pilot.fans, pilot.session
    died = fans.watch()
    record_property("reaction_s", fans.thrust_ends(died + 0.5) + 0.5)
    assert not s.propulsion.armed, fans.seen
    pilot.take_off()


@pytest.mark.slow  # in one process: `test_a_lost_fan_ends_the_flight_when_the_tilt_is_watched`
def test_fan_lost_in_flight(pilot, record_property):
    """Three fans cannot hold it: it tips over, and the rest is turned off in the air."""
    fans, s = pilot.fans, pilot.session
    failed = fans.watch()
    s.inject(graph.PLANT_INJECT_FAULT, "front_left_fan", "fail")
    while not fans.rests and s.time < failed + 2.0:
        pilot.hold(0.1, CLIMB)
    record_property("reaction_s", fans.thrust_ends(failed))
    assert not s.propulsion.armed, fans.seen
    assert "termination" in fans.arming_refused()
    pilot.take_off()
