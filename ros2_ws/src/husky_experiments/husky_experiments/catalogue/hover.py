"""The robot hovers on its fans above where it stood, by the T265, ropes slack; then it lands.

At the configured mass a full pack carries it for some 16 s only (docs/propulsion_physics.md), so
the time of the hold follows from pack and mass before the start: what the charge allows until full
throttle gives no more than the weight and a reserve, less take-off and landing.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from husky_bringup.system import ParameterValue
from husky_control.flight.hover_gains import HoverGains
from husky_description.fan import FanModel
from husky_description.gravity import GRAVITY
from husky_description.mujoco_model import build_spec, flying_inertia
from husky_description.plain_mujoco import mujoco
from husky_description.robot import Robot, load_robot
from husky_experiments.metrics import walking as metrics
from husky_experiments.metrics.measures import tilt
from husky_experiments.metrics.propulsion import attitude_summary, base_by_t265, taut
from husky_experiments.recordings.recording import Recording
from husky_experiments.run import Run
from husky_experiments.scripts import finish, ready_fans, stand_up
from husky_experiments.session import Session
from husky_pu.autopilot.weighted_mixer import mixer_of
from husky_sim.propulsion.propulsion_figures import STEP, armed_unit, full_throttle
from husky_sim.propulsion.propulsion_unit import PropulsionUnit

_ROPE = 2.4
"""Length of the ropes, just slack above the sitting robot [m]."""
_RESERVE = 0.005
"""Of level thrust over the weight that is to be left when the hold ends; a descent needs none."""
_TAKE_OFF = 3.0
"""What take-off takes from the pack, as time of hovering [s]."""
_SETTLING = 0.5
"""From 5 cm below the height of the hold to its beginning; not measured, part of take-off [s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare duration, payload and seed."""
    parser.add_argument("--duration", type=float, default=20.0, help="of the hold, at most [s]")
    parser.add_argument(
        "--payload", type=float, default=-1.0, help="payload [kg], negative for 7.6 kg in all"
    )
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """No further than 0.3 m from its place, for as long as mass and pack allow."""
    options = run.options
    robot = load_robot() if options.payload < 0.0 else load_robot(payload_mass=options.payload)
    full, level = thrust_to_weight(robot, 1.0), level_thrust(robot, 1.0)
    allowed = hover_time(robot, _RESERVE)
    hold = min(options.duration, math.floor(10.0 * (allowed - _TAKE_OFF)) / 10.0)
    run.metrics |= {
        "mass_kg": robot.mass,
        "thrust_to_weight_full": full,
        "thrust_to_weight_level_full": level,
        "center_of_mass_x_m": center_of_mass(robot)[0],
        "allowed_s": max(0.0, allowed - _TAKE_OFF),
        "asked_s": options.duration,
    }
    run.say(
        f"{robot.mass:.2f} kg: thrust over weight {full:.3f} with a full pack, {level:.3f} when "
        f"level; it hovers for {allowed:.1f} s, take-off included; "
        f"{max(hold, 0.0):.1f} s of {options.duration:g} s are held"
    )
    if hold < options.duration:
        run.say("mass and pack do not allow more; --payload 0.68 (7.0 kg) does")
    if hold <= 0.0:
        run.fail("mass and pack do not allow to hover")
        return
    settings: dict[str, dict[str, ParameterValue]] = {
        "plant": {
            "seed": options.seed,
            "body": "robot_with_unit",
            "gantry": True,
            "rope_length": _ROPE,
            "payload": options.payload,
        },
        "low_level_controller": {"payload": options.payload},
        "flight_controller": {
            "seed": options.seed,
            "inertia": flying_inertia(robot, "robot_with_unit"),
        },
    }
    with run.session(settings, expected=hold + 28.0) as session:
        stand_up(session)
        ready_fans(session)
        spans = fly(session, hold)
        run.metrics["ended"] = session.state.reason if session.state is not None else "silent"
        fallen = metrics.has_fallen(session.truth)
        if not fallen:
            session.arm(False)
        falls = finish(session)
    recording = run.recording()
    run.metrics |= summary(recording, robot, spans)
    run.require("falls", falls, upper=0)
    run.require("hover_s", lower=hold - 0.05)
    run.require("position_error_max_m", upper=0.3)
    run.require("ropes_taut_s", upper=0.0)
    run.illustrate()


Spans = dict[str, tuple[float, float]]


def fly(session: Session, hold: float) -> Spans:
    """Take off, hold for a while [s], land; return when, until standing again or 15 s have gone."""
    spans: Spans = {}

    def passage(name: str, limit: float, height: float | None = None) -> None:
        start = session.time

        def ends() -> bool:
            if mode(session) != "fly":
                return True
            return height is not None and session.state is not None and top(session) >= height

        session.advance(limit, ends)
        spans[name] = (start, session.time)

    ground = session.state.position[2] if session.state is not None else 0.0

    def top(session: Session) -> float:
        return float(session.state.position[2] - ground) if session.state is not None else 0.0

    session.set_mode("fly", reached="fly", within=1.0)
    passage("take_off", 8.0, HoverGains().height - 0.05)
    session.advance(_SETTLING)
    passage("hold", hold)
    if mode(session) == "fly":
        session.set_mode("stand")
        passage("landing", 15.0)
    return spans


def mode(session: Session) -> str:
    """Return the controller's mode."""
    return session.state.mode if session.state is not None else ""


def center_of_mass(robot: Robot) -> tuple[float, float]:
    """Return where the standing robot's centre of mass is in base, along x and y [m]."""
    model = build_spec(robot).compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("stand").id)
    mujoco.mj_forward(model, data)
    x, y, _ = data.subtree_com[model.body("base").id] - data.qpos[:3]
    return float(x), float(y)


def thrust_to_weight(robot: Robot, charge: float) -> float:
    """Return the thrust of full throttle over the weight at a charge (0 to 1)."""
    return float(full_throttle(robot, charge).wrench_in_base[2]) / (robot.mass * GRAVITY)


def level_thrust(robot: Robot, charge: float) -> float:
    """Return the same of the greatest thrust that holds the robot level.

    Its centre of mass is not below the middle of the fans, so not all of them can give everything.
    """
    unit, mixer, weight = armed_unit(robot, charge), mixer_of(robot), robot.mass * GRAVITY
    x, y = center_of_mass(robot)
    for step in range(1200):
        if step % 4 == 0:
            voltage = unit.battery_voltage
            thrust = mixer.allocate(1e3, (weight * y, -weight * x, 0.0), voltage)
            pulses = mixer.pulses(thrust, voltage)
        unit.step(pulses, STEP)
    return float(unit.wrench_in_base[2]) / weight


def hover_time(robot: Robot, reserve: float) -> float:
    """Return how long a full pack hovers the robot, until the reserve is gone [s].

    Args:
        robot: with its mass.
        reserve: of level thrust over the weight that is to be left, a share of the weight.
    """
    if level_thrust(robot, 1.0) < 1.0 + reserve:
        return 0.0
    low, high = 0.0, 1.0
    while high - low > 1e-3:
        middle = (low + high) / 2.0
        enough = level_thrust(robot, middle) >= 1.0 + reserve
        low, high = (low, middle) if enough else (middle, high)
    pack, fan = PropulsionUnit(robot).battery, FanModel.from_section(robot.fans)
    count = len(robot.rotor_names)
    each = fan.electrical_power(robot.mass * GRAVITY / count)
    power = count * each + robot.battery.idle_power
    charge, time, dt = 1.0, 0.0, 0.02
    while charge > high:
        voc = pack.open_circuit_voltage(charge)
        voltage = (voc + math.sqrt(voc * voc - 4.0 * pack.resistance * power)) / 2.0
        charge -= power / voltage * dt / pack.capacity
        time += dt
    return time


def summary(recording: Recording, robot: Robot, spans: Spans) -> dict[str, Any]:
    """Return what the recording says of a flight, by the spans of `fly`."""
    start, end = spans["hold"]
    take_off = spans["take_off"][0]
    place_time = np.array([take_off])
    seen, base = base_by_t265(recording, robot), recording.base
    target = np.array([0.0, 0.0, HoverGains().height])
    result: dict[str, Any] = {"hover_s": end - start, "hover_from_s": start}
    for name, motion in (("", seen), ("true_", base)):
        at = [np.interp(place_time, motion.time, motion.position[:, i])[0] for i in range(3)]
        inside = motion.between(start, end)
        error = np.linalg.norm(inside.position - (np.array(at) + target), axis=1)
        result[f"{name}position_error_max_m"] = float(error.max())
        result[f"{name}position_error_rms_m"] = float(np.sqrt(np.mean(error**2)))
    leaning = tilt(base.between(start, end).orientation)
    result["tilt_max_deg"] = float(np.degrees(leaning.max()))
    yaw = Rotation.from_quat(base.between(take_off, end).orientation).as_euler("ZYX")[:, 0]
    result["yaw_change_max_deg"] = float(np.degrees(np.abs(np.unwrap(yaw) - yaw[0]).max()))
    attitude = attitude_summary(recording, start, end)
    result |= {k: v for k, v in attitude.items() if v is not None and math.isfinite(v)}
    fans = recording.fans.between(start, end)
    result["charge_start"], result["charge_end"] = (
        float(fans.battery_charge[index]) for index in (0, -1)
    )
    for name in ("start", "end"):
        charge = result[f"charge_{name}"]
        result[f"thrust_to_weight_{name}"] = thrust_to_weight(robot, charge)
        result[f"thrust_to_weight_level_{name}"] = level_thrust(robot, charge)
    state = recording.propulsion.between(start, end)
    result["voltage_min_v"] = float(state.voltage.min())
    result["current_mean_a"] = float(state.current.mean())
    result["current_max_a"] = float(state.current.max())
    flight = recording.fans.between(take_off, spans.get("landing", (0.0, end))[1])
    result["ropes_taut_s"] = 0.01 * float(taut(flight, flight.time).sum())
    if "landing" in spans:
        result["landing_s"] = spans["landing"][1] - spans["landing"][0]
        down = base.between(*spans["landing"])
        result["sink_speed_max_mps"] = float(-down.velocity[:, 2].min()) if len(down) else 0.0
    return result
