"""Setpoints and sticks that come to the flight controller by MAVLink: which it takes, and when."""

import math

import pytest
from mavlink_bench import Bench, heartbeat
from pymavlink.dialects.v20 import ardupilotmega as dialect


@pytest.mark.parametrize(
    "bad",
    [
        {"thrust": math.nan},
        {"thrust": 1.5},
        {"thrust": -0.1},
        {"q": (0.0, 0.0, 0.0, 0.0)},
        {"q": (math.nan, 0.0, 0.0, 1.0)},
        {"q": (2.0, 0.0, 0.0, 0.0)},
        {"mask": 0, "rates": (math.inf, 0.0, 0.0)},
        {"mask": 128, "rates": (0.0, 100.0, 0.0)},
        {"mask": 128 | 7},
        {"mask": 32 | 64 | 7},
    ],
)
def test_a_bad_setpoint_is_refused_whole(bad):
    bench = Bench()
    bench.setpoint(0.25)
    before = bench.stream.newest
    bench.setpoint(**bad)
    assert bench.stream.refused == 1
    assert bench.stream.newest is before
    bench.tick(2)
    assert any("Setpoint refused" in getattr(m, "text", "") for m in bench.take())


def test_what_is_masked_may_be_anything():
    bench = Bench()
    bench.setpoint(0.5)
    bench.setpoint(math.nan, mask=64 | 7)
    assert bench.stream.refused == 0
    assert bench.stream.thrust == 0.5  # as before
    bench.setpoint(0.3, mask=7, rates=(math.nan,) * 3)
    bench.setpoint(0.3, mask=128, q=(math.nan,) * 4, rates=(0.1, 0.2, 0.3))
    assert bench.stream.refused == 0
    assert bench.stream.newest.rates == pytest.approx((0.1, 0.2, 0.3))


@pytest.mark.parametrize(
    ("group", "controls"),
    [(1, [0.0] * 8), (0, [1.1, *[0.0] * 7]), (0, [0, 0, 0, -0.2, 0, 0, 0, 0]), (0, [math.nan] * 8)],
)
def test_bad_actuator_controls(group, controls):
    bench = Bench()
    bench.send(dialect.MAVLink_set_actuator_control_target_message(0, group, 1, 1, controls))
    assert bench.stream.refused == 1


def test_one_source_owns_the_setpoints():
    bench = Bench()
    bench.setpoint(0.1, link="a")
    bench.tick(5)
    bench.setpoint(0.9, link="b")
    assert bench.stream.thrust == pytest.approx(0.1)
    assert bench.stream.contested == 1
    bench.tick(300)  # the first has fallen silent
    bench.setpoint(0.2, link="b")
    assert bench.stream.thrust == pytest.approx(0.2)


def test_somebody_with_our_own_id():
    bench = Bench()
    thief = dialect.MAVLink(None, 1, 1)
    bench.send(heartbeat())
    message = dialect.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1, 0, 0, 0], 0, 0, 0, 0.9)
    bench.send(message, codec=thief)
    bench.send(
        dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0), codec=thief
    )
    assert bench.stream.accepted == 0
    assert not bench.logic.armed
    assert bench.autopilot.server.impostors == 2
    bench.tick(2)
    assert any("uses our id" in getattr(m, "text", "") for m in bench.take())


def test_rc_override():
    bench = Bench()

    def override(*fields):
        padded = [*fields, *[0] * (18 - len(fields))]
        bench.send(dialect.MAVLink_rc_channels_override_message(1, 1, *padded))

    override(1600, 1500, 1000, 1500, 1000, 1000, 1000, 1000)
    sticks = bench.autopilot.vehicle.input.sticks
    assert sticks.roll > 0.1 and sticks.arm is False
    override(65535, 65535, 1200, 65535, 65535, 65535, 65535, 65535)
    sticks = bench.autopilot.vehicle.input.sticks
    assert sticks.roll > 0.1 and sticks.throttle == pytest.approx(0.2)
    bench.tick(300)  # 0.6 s: lost
    assert bench.autopilot.vehicle.input.silent(1e-9 * bench.time_ns)
    override(0, 0, 0, 0, 0, 0, 0, 0)  # released: no news
    assert bench.autopilot.vehicle.input.silent(1e-9 * bench.time_ns)
    override(9000, 1500, 1000, 1500)
    assert bench.autopilot.vehicle.input.bad_frames == 1


# Lockstep ---------------------------------------------------------------------------------------
@pytest.mark.parametrize("early", [True, False])
def test_a_setpoint_acts_at_its_time_however_early_it_came(early):
    bench = Bench(lockstep=True)
    acted = {}
    for tick in range(60):
        now_ms = 2 * tick
        if now_ms % 10 == 0:
            stamp = now_ms if early else now_ms - 10
            if stamp >= 0:
                bench.setpoint(thrust=stamp / 1000.0, stamp_ms=stamp)
        bench.tick()
        acted[now_ms] = bench.stream.stamp_ns
    for now_ms, stamp_ns in acted.items():
        grid = now_ms - now_ms % 10
        assert stamp_ns == (grid - 10) * 1_000_000 if grid >= 10 else stamp_ns == -1


def test_a_command_keeps_its_place_among_setpoints():
    bench = Bench(lockstep=True).tick(6)  # 0 to 10 ms
    arm = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0)
    bench.setpoint(stamp_ms=10)
    bench.send(arm)
    bench.setpoint(stamp_ms=20)
    bench.tick(9)  # to 28 ms: the setpoint of 10 has acted, that of 20 has not
    assert not bench.logic.armed
    bench.tick(1)
    assert bench.logic.armed


def test_held_commands_are_let_go_when_the_companion_is_gone_or_time_stands():
    arm = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0)
    bench = Bench(lockstep=True).tick(6)
    bench.setpoint(stamp_ms=10)
    bench.send(arm)
    bench.autopilot.server.release(standstill=True)
    assert bench.logic.armed
    assert bench.stream.accepted == 0  # its time has not come
    bench = Bench(lockstep=True).tick(6)
    bench.setpoint(stamp_ms=10)
    bench.send(arm)
    bench.tick(70)
    assert bench.logic.armed


def test_a_companion_without_a_setpoint_tells_its_time_and_is_no_stream():
    """Nobody waits for it, commands keep their place, and the last setpoint grows old."""
    bench = Bench(lockstep=True).tick(6)
    arm = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0)
    clock = dialect.MAVLink_system_time_message
    bench.send(clock(0, 5_000))  # of a stranger: no setpoint has come from there
    assert bench.autopilot.server.stamp_ns == -1
    bench.setpoint(stamp_ms=10)
    bench.send(arm)
    bench.send(clock(0, 20))
    assert bench.autopilot.server.stamp_ns == 20_000_000
    bench.tick(9)
    assert not bench.logic.armed
    bench.tick(1)
    assert bench.logic.armed
    stream = bench.stream
    assert (stream.accepted, stream.refused, stream.stamp_ns) == (1, 0, 10_000_000)


def test_a_setpoint_of_before_a_reset():
    bench = Bench(lockstep=True).tick(6)
    bench.setpoint(stamp_ms=100_000)
    assert bench.autopilot.server.stamp_ns == -1
