"""Arming, modes, fail-safes and what follows from them: a thrust and moments, every tick."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from husky_description.gimbal import NEUTRAL, Angles, Gimbal, axis
from husky_description.rotation import (
    Quaternion,
    Vector,
    from_roll_pitch_yaw,
    swap_body,
    to_roll_pitch_yaw,
)
from husky_pu.autopilot import arming
from husky_pu.autopilot.attitude_control import ControlGains, RateControl, rate_demand
from husky_pu.autopilot.battery import BatteryLevel, BatteryMonitor
from husky_pu.autopilot.descent import Descent, braking, hurried
from husky_pu.autopilot.failsafes import Cause, FlightMode, FlightSituation, Reaction, judge
from husky_pu.autopilot.flight_parameters import FlightParameters
from husky_pu.autopilot.rc import StickInput, Sticks
from husky_pu.autopilot.setpoints import AttitudeSetpoint, SetpointStream
from husky_pu.autopilot.standing_thrust import StandingThrust
from husky_pu.autopilot.state import ZERO, Motion, Severity

_ACROSS = 0.002
"""Share of the full thrust across fixed fans that is worth a word."""
_RUN_DOWN = 1.0
"""Without thrust for so long the rotors stand, and the axis may turn [s]."""


class FlightLogic:
    """Decides; knows no wire and no clock.

    Attributes:
        armed: the fans may turn.
        mode: of flight.
        failsafe: the one that acts, None when none does.
        terminated: fans are off until the termination is lifted.
        thrust: share of full collective, after every limit.
        moments: shares of what the mixer can give, FRD.
        tilt: pitch and roll of the thrust's axis [rad], see `husky_description.gimbal`.
        fans_ok: which fans are not lost.
        attitude_desired: what the attitude law follows (x, y, z, w).
        rates_desired: what the rate law follows [rad/s].
        texts: status texts that nobody has taken yet, as (severity, text).
    """

    def __init__(
        self,
        parameters: FlightParameters,
        stream: SetpointStream,
        input_: StickInput,
        battery: BatteryMonitor,
        fans: Sequence[str],
        gimbal: Gimbal | None = None,
    ):
        """Start disarmed in STABILIZED; `fans` are their names, `gimbal` None if they are fixed."""
        self._gimbal = gimbal
        self.tilt: Angles = NEUTRAL
        self._told_across = False
        self._fans = fans
        self.fans_ok = [True] * len(fans)
        self._p = parameters
        self._stream = stream
        self._input = input_
        self._battery = battery
        self._control = RateControl()
        self.armed = False
        self.mode = FlightMode.STABILIZED
        self.failsafe: Cause | None = None
        self.terminated = False
        self.thrust = 0.0
        self.moments: Vector = ZERO
        self.attitude_desired: Quaternion = (0.0, 0.0, 0.0, 1.0)
        self.rates_desired: Vector = ZERO
        self.texts: list[tuple[Severity, str]] = []
        self._motion = Motion()
        self._now = 0.0
        self._ramp = False
        self._descent: Descent | None = None
        self._heading = 0.0
        self._tilted_for = 0.0
        self._idle_since = 0.0
        self._battery_level = BatteryLevel.NORMAL
        self._last: Sticks | None = None
        self._standing = StandingThrust(parameters, stream, input_)

    # Commands -----------------------------------------------------------------------------------
    def arm(self, *, force: bool = False) -> str:
        """Arm; return why not, or "". `force` skips all checks but `arming.never`."""
        if self.armed:
            return ""
        situation = self.situation
        never = arming.never(situation)
        reasons = ([never] if never else []) if force else arming.refusals(situation, self._p)
        if reasons:
            for reason in reasons[:3]:
                self._say(Severity.CRITICAL, f"Arming denied: {reason}")
            return reasons[0]
        self._stop()
        self.armed = True
        self._idle_since = self._now
        self._standing.arm(self._now)
        self._say(Severity.INFO, "Armed by force" if force else "Armed")
        if self._standing.holds(self.mode):
            self._say(Severity.WARNING, "No thrust until it is asked for anew from low")
        return ""

    def disarm(self, *, force: bool = False, reason: str = "") -> None:
        """Stop the fans: at once by force or at low thrust, through the ramp otherwise."""
        if not self.armed:
            return
        if force or self.thrust <= self._p["HKY_INT_THR"]:
            self._stop()
            self._say(Severity.INFO, f"Disarmed{': ' if reason else ''}{reason}")
        elif not self._ramp:
            self._come_down()
            self._say(Severity.INFO, "Disarming: thrust comes down")

    def set_mode(self, mode: FlightMode) -> str:
        """Change the mode; return why not, or "".

        During the descent after lost setpoints or sticks this is how a pilot or a companion takes
        over again.
        """
        if mode is FlightMode.OFFBOARD and not self._stream.alive(self._now):
            self._say(Severity.CRITICAL, "OFFBOARD denied: no offboard signal")
            return "no offboard signal"
        takes_over = self.failsafe in (Cause.OFFBOARD_LOSS, Cause.RC_LOSS)
        if self._ramp and not takes_over:
            return "thrust is coming down"
        if self._ramp and mode is FlightMode.STABILIZED and not self._sticks_alive():
            return "no manual control input"
        if takes_over:
            self._ramp, self.failsafe, self._descent = False, None, None
        if mode is not self.mode:
            self.mode = mode
            self._control.reset_integral()
            self._heading = to_roll_pitch_yaw(self._motion.attitude)[2]
            self._say(Severity.INFO, f"Mode {mode.value}")
        return ""

    def terminate(self, on: bool) -> str:
        """Stop the fans at once and for good, or lift that while disarmed; return why not."""
        if on:
            if not self.terminated:
                self._act(Cause.TERMINATION, Reaction.TERMINATE)
        elif self.armed:
            return "armed"
        elif self.terminated:
            self.terminated = False
            self._say(Severity.INFO, "Flight termination lifted")
        return ""

    def lose_fan(self, index: int) -> None:
        """A fan does not do what it is told; so it is until the next disarming."""
        self.fans_ok[index] = False
        self._say(Severity.CRITICAL, f"Fan {self._fans[index]} lost")

    @property
    def may_rise(self) -> bool:
        """Whether moments may raise the thrust (MC_AIRMODE), which they never do in a descent."""
        held = self._ramp or self._standing.holds(self.mode)
        return bool(self._p["MC_AIRMODE"]) and not held

    # Every tick ---------------------------------------------------------------------------------
    def decide(self, now: float, dt: float, motion: Motion, gains: ControlGains) -> None:
        """Decide what the fans do next.

        Args:
            now: time since boot [s].
            dt: since the last tick [s].
            motion: of the unit.
            gains: of its control.
        """
        self._now, self._motion = now, motion
        self._watch_switches()
        self._watch_battery()
        if not self.armed:
            self.thrust, self.moments, self.rates_desired = 0.0, ZERO, ZERO
            self.attitude_desired = motion.attitude
            return
        if self.failsafe is None:
            self._time_tilt(dt)
            found = judge(self.situation, self._p)
            if found is not None:
                self._act(*found)
                if not self.armed:
                    return
        self._standing.look(now, self.thrust)
        setpoint = self._setpoint(dt)
        if self._standing.holds(self.mode):
            setpoint = replace(setpoint, thrust=0.0)
        self._slew(self._aim(setpoint, dt), dt)
        self._follow(setpoint, gains, dt)
        self._end()

    def _setpoint(self, dt: float) -> AttitudeSetpoint:
        """Return what is to be followed: the companion's, the sticks' or a descent's."""
        newest = self._stream.newest
        if self.mode is FlightMode.OFFBOARD and newest is not None:
            if not self._ramp:
                stream = self._stream
                return replace(newest, thrust=stream.thrust, direction=stream.direction)
            if newest.moments is not None:  # what stands on legs is not to be levelled
                return AttitudeSetpoint(0, 0.0, moments=ZERO)
        if self._descent is not None:
            return self._descending(self._descent)
        alive = self._sticks_alive() and not self._ramp
        sticks = self._input.sticks if alive else Sticks()
        p = self._p
        yaw_rate = math.radians(p["MPC_MAN_Y_MAX"]) * sticks.yaw
        if self.thrust <= p["HKY_INT_THR"]:
            self._heading = to_roll_pitch_yaw(self._motion.attitude)[2]
        else:
            self._heading += yaw_rate * dt
        tilt = math.radians(p["MPC_MAN_TILT_MAX"])
        low = p["MPC_MANTHR_MIN"] if alive and sticks.throttle > 0.0 else 0.0
        return AttitudeSetpoint(
            0,
            low + sticks.throttle * (p["MPC_THR_MAX"] - low),
            attitude=from_roll_pitch_yaw(tilt * sticks.roll, -tilt * sticks.pitch, self._heading),
            yaw_rate=yaw_rate,
        )

    def _descending(self, descent: Descent) -> AttitudeSetpoint:
        """Return what brakes; on the ground, level, unless a lost rotor ends the thrust there."""
        whole = all(self.fans_ok)
        if not whole:  # three rotors do not hold the heading: it may turn
            self._heading = to_roll_pitch_yaw(self._motion.attitude)[2]
        roll, pitch = braking(self._motion.speed, self._heading)
        if whole and descent.down:
            roll = pitch = 0.0
        attitude = from_roll_pitch_yaw(roll, pitch, self._heading)
        return AttitudeSetpoint(0, 0.0, attitude=attitude)

    def _aim(self, setpoint: AttitudeSetpoint, dt: float) -> float:
        """Turn the thrust's axis; return the thrust that is wanted along it as it stands.

        That is the wanted force's projection: nothing is pushed where nothing was asked for. In a
        descent, and until the rotors stand, the axis stays.
        """
        wanted, direction = setpoint.thrust or 0.0, setpoint.direction
        x, y, z = swap_body(direction) if direction is not None else (0.0, 0.0, 1.0)
        if self._gimbal is None:
            across = wanted * math.hypot(x, y)
            if across > _ACROSS and not self._told_across:
                self._say(Severity.WARNING, "Thrust across the fans left out: they are fixed")
            self._told_across = across > _ACROSS
            return wanted * max(0.0, z)
        if not self._ramp and (wanted > 0.0 or self._now - self._idle_since > _RUN_DOWN):
            target = self._gimbal.angles((x, y, z))
            self.tilt = self._gimbal.slewed(self.tilt, target, dt)
        a, b, c = axis(self.tilt)
        return wanted * max(0.0, a * x + b * y + c * z)

    def _slew(self, wanted: float, dt: float) -> None:
        """Move the thrust: slowly up, faster down, never up in a descent."""
        p, descent = self._p, self._descent
        if self._ramp and (descent is None or descent.down or self._motion.sensors_lost):
            at_once = descent is not None and descent.down and not all(self.fans_ok)
            fall = self.thrust if at_once else dt / p["HKY_FS_RAMP"]
            self.thrust = max(0.0, self.thrust - fall)
            return
        if self._ramp and descent is not None:
            wanted = descent.thrust(self._motion.speed.climb, self._motion.tilt, dt)
        rise, fall = p["HKY_THR_UP"] * dt, p["HKY_THR_DOWN"] * dt
        wanted = min(wanted, p["MPC_THR_MAX"])
        self.thrust = max(self.thrust - fall, min(self.thrust + rise, wanted))

    def _follow(self, setpoint: AttitudeSetpoint, gains: ControlGains, dt: float) -> None:
        """Turn attitude or rates into moments; or take moments as they are."""
        motion = self._motion
        if not motion.aligned or motion.sensors_lost:
            self.moments = self.rates_desired = ZERO
            self._control.reset()
            return
        if setpoint.moments is not None:
            self.attitude_desired, self.rates_desired = motion.attitude, ZERO
            self.moments = setpoint.moments
            self._control.reset()
            return
        if setpoint.attitude is not None:
            self.attitude_desired = setpoint.attitude
            p, q, r = rate_demand(motion.attitude, setpoint.attitude, gains)
            self.rates_desired = (p, q, r + setpoint.yaw_rate)
        else:
            self.attitude_desired = motion.attitude
            self.rates_desired = setpoint.rates or ZERO
        if self._descent is not None and not all(self.fans_ok):
            gains = replace(gains, integral=hurried(gains.integral))
        flying = self.thrust > self._p["HKY_INT_THR"]
        if not flying:
            self._control.reset_integral()
        self.moments = self._control.update(
            motion.rates, self.rates_desired, gains, dt, integrate=flying
        )

    def _end(self) -> None:
        """Disarm at the end of a descent, or after a while without thrust if that is wanted."""
        if self.thrust > 0.0:
            self._idle_since = self._now
        elif self._ramp:
            self.disarm(force=True, reason=self.failsafe.value if self.failsafe else "")
        elif 0.0 < self._p["COM_DISARM_PRFLT"] < self._now - self._idle_since:
            self.disarm(force=True, reason="no thrust")

    # What is watched ----------------------------------------------------------------------------
    def _watch_switches(self) -> None:
        """Act on switches that moved; as they first stand they say nothing, but for kill."""
        sticks = self._input.sticks
        if sticks is self._last:
            return
        last, self._last = self._last, sticks
        if not self._input.seen:
            return
        if sticks.kill and self.armed:
            self._act(Cause.KILL, Reaction.DISARM)
        if last is None:
            return
        if sticks.arm is not last.arm and last.arm is not None:
            if sticks.arm:
                self.arm()
            else:
                self.disarm()
        if sticks.offboard is not last.offboard and last.offboard is not None:
            self.set_mode(FlightMode.OFFBOARD if sticks.offboard else FlightMode.STABILIZED)

    def _watch_battery(self) -> None:
        level = self._battery.level
        if level > self._battery_level:
            word = level.name.lower()
            self._say(Severity.WARNING if level == 1 else Severity.CRITICAL, f"Battery {word}")
        if level > self._battery_level or not self.armed:
            self._battery_level = level

    def _act(self, cause: Cause, reaction: Reaction) -> None:
        self.failsafe = cause
        self._say(Severity.EMERGENCY, f"Failsafe: {cause.value}, {reaction.value}")
        if reaction is Reaction.DESCEND:
            self._come_down()
            return
        self.terminated = self.terminated or reaction is Reaction.TERMINATE
        self.disarm(force=True, reason=cause.value)
        self._stop()

    def _come_down(self) -> None:
        """Let the thrust go; where it carries the unit in the air, on the ground only."""
        self._ramp = True
        self._heading = to_roll_pitch_yaw(self._motion.attitude)[2]
        speed, carries = self._p["MPC_LAND_SPEED"], self.thrust > 0.5 * self._p["MPC_THR_HOVER"]
        if speed > 0.0 and carries and self.fans_ok.count(False) < 2:
            self._descent = Descent(speed, self._p["MPC_THR_HOVER"])

    def _stop(self) -> None:
        self.armed = self._ramp = False
        self.failsafe = self._descent = None
        self.thrust, self.moments, self.rates_desired = 0.0, ZERO, ZERO
        self._tilted_for = 0.0
        self.fans_ok[:] = [True] * len(self._fans)
        self._control.reset()

    def _sticks_alive(self) -> bool:
        return self._input.seen and not self._input.silent(self._now)

    def _time_tilt(self, dt: float) -> None:
        roll_limit, pitch_limit = self._p["FD_FAIL_R"], self._p["FD_FAIL_P"]
        if roll_limit or pitch_limit:
            roll, pitch, _ = map(math.degrees, to_roll_pitch_yaw(self._motion.attitude))
            beyond = 0 < roll_limit < abs(roll) or 0 < pitch_limit < abs(pitch)
            self._tilted_for = self._tilted_for + dt if beyond else 0.0

    @property
    def situation(self) -> FlightSituation:
        """What the pre-arm checks and the fail-safes look at."""
        alive = self._sticks_alive()
        return FlightSituation(
            mode=self.mode,
            motion=self._motion,
            tilted_for=self._tilted_for,
            battery_connected=self._battery.connected,
            battery=self._battery.level,
            battery_warned=self._battery_level,
            kill=alive and self._input.sticks.kill,
            terminated=self.terminated,
            sticks_seen=self._input.seen,
            sticks_alive=alive,
            throttle=self._input.sticks.throttle,
            stream_alive=self._stream.alive(self._now),
            setpoint_age=self._stream.age(self._now),
            setpoint_thrust=self._stream.thrust,
            fans_lost=self.fans_ok.count(False),
        )

    def _say(self, severity: Severity, text: str) -> None:
        if len(self.texts) < 32:
            self.texts.append((severity, text))
