"""The operator's hands: which way they move, how fast, and how they keep a unit at its place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_experiments.pilot import FULL_TILT, FULL_YAW_RATE, Pilot, Sight, Wish
from husky_pu.radio.rc_mapping import JoyLayout, RcMapping
from husky_pu.radio.sbus import SbusChannel

HOVER = 0.16
STILL = Sight(np.zeros(3), np.zeros(3), 0.0)
LOOK = 0.04


def pulses(pilot: Pilot) -> tuple[float, ...]:
    """Send the sticks through the radio; pulse widths [us]."""
    radio = RcMapping(JoyLayout())
    axes, buttons = pilot.joy()
    assert radio.joy(axes, buttons, 0.0)
    return radio.frame(0.0).pulses


def held(wish: Wish, sight: Sight = STILL) -> Pilot:
    """Return a pilot who has wished for something for two seconds."""
    pilot = Pilot(HOVER)
    for _ in range(50):
        pilot.move(sight, wish, LOOK)
    return pilot


@pytest.mark.parametrize(
    ("wish", "channel", "sign"),
    [
        (Wish(roll=0.1), SbusChannel.ROLL, 1),
        (Wish(roll=-0.1), SbusChannel.ROLL, -1),
        (Wish(pitch=0.1), SbusChannel.PITCH, 1),
        (Wish(pitch=-0.1), SbusChannel.PITCH, -1),
        (Wish(yaw_rate=0.3), SbusChannel.YAW, -1),
        (Wish(yaw_rate=-0.3), SbusChannel.YAW, 1),
    ],
)
def test_directions_at_the_receiver(wish: Wish, channel: SbusChannel, sign: int) -> None:
    """Right, nose down and clockwise are above the centre, as the autopilot reads them."""
    found = np.array(pulses(held(wish)))
    assert sign * (found[channel] - 1500.0) > 50.0
    others = [c for c in (SbusChannel.ROLL, SbusChannel.PITCH, SbusChannel.YAW) if c is not channel]
    assert np.allclose(found[others], 1500.0, atol=1.0)


def test_full_sticks_are_the_autopilots() -> None:
    pilot = held(Wish(roll=FULL_TILT, pitch=-FULL_TILT, yaw_rate=FULL_YAW_RATE, throttle=1.0))
    assert (pilot.roll, pilot.pitch, pilot.yaw) == (-1.0, -1.0, 1.0)
    # half of the throttle's way in two seconds at a thumb's 0.2 of it a second
    assert pilot.throttle == pytest.approx(0.4)


def test_switch_and_rest() -> None:
    pilot = Pilot(HOVER)
    assert pulses(pilot)[SbusChannel.ARM] < 1100.0
    assert pulses(pilot)[SbusChannel.THROTTLE] == pytest.approx(1000.0, abs=1.0)
    pilot.armed = True
    assert pulses(pilot)[SbusChannel.ARM] > 1900.0


FINITE = st.floats(-100.0, 100.0)


@given(
    st.lists(st.tuples(*[FINITE] * 6, st.floats(-4.0, 4.0)), min_size=1, max_size=8),
    st.tuples(st.none() | FINITE, st.none() | FINITE, FINITE, st.none() | FINITE),
)
def test_sticks_stay_in_their_travel_and_move_like_a_hand(
    sights: list[tuple[float, ...]], wish: tuple[float | None, float | None, float, float | None]
) -> None:
    pilot = Pilot(HOVER)
    for *seen, yaw in sights:
        before = np.array((pilot.roll, pilot.pitch, pilot.yaw, pilot.throttle))
        pilot.move(Sight(np.array(seen[:3]), np.array(seen[3:]), yaw), Wish(*wish), LOOK)
        after = np.array((pilot.roll, pilot.pitch, pilot.yaw, pilot.throttle))
        assert np.all(np.abs(after) <= 1.0)
        assert after[3] >= 0.0
        assert np.all(np.abs(after - before) <= np.array((0.8, 0.8, 0.8, 0.2)) * LOOK + 1e-12)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_a_point_mass_is_brought_home(yaw: float) -> None:
    """A mass that leans as the sticks say and hovers at a little more than was thought."""
    pilot = Pilot(HOVER)
    pilot.place = np.array((0.3, -0.2, 1.2))
    position, velocity = np.array((-0.4, 0.5, 0.9)), np.zeros(3)
    pilot.throttle = HOVER
    forward, left = np.array((np.cos(yaw), np.sin(yaw))), np.array((-np.sin(yaw), np.cos(yaw)))
    for _ in range(round(20.0 / LOOK)):
        pilot.move(Sight(position.copy(), velocity.copy(), yaw), Wish(), LOOK)
        lean = np.tan(FULL_TILT * pilot.pitch) * forward + np.tan(FULL_TILT * pilot.roll) * left
        lift = pilot.throttle / (1.05 * HOVER) - 1.0
        velocity += LOOK * 9.81 * np.append(lean, lift)
        position += LOOK * velocity
    assert np.allclose(position, pilot.place, atol=0.02)
    assert np.allclose(velocity, 0.0, atol=0.02)
