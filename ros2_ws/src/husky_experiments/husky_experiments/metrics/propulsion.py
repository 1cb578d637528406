"""What a recording says of how well the propulsion unit did, as numbers ready for JSON."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from husky_description.arrays import Array
from husky_description.fan import FanModel
from husky_description.robot import Robot
from husky_experiments.metrics.measures import rms
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base, Fans, Mask, Propulsion

Span = tuple[float, float]
"""First and last time [s]."""

LEAST_THRUST = 0.05
"""Share of full thrust below which the autopilot does not hold a heading."""
_AXES = ("roll", "pitch", "yaw")


# Attitude -------------------------------------------------------------------------------------
def attitude_error(attitude: Array, state: Propulsion) -> Array:
    """Return the rotation vector from the desired to an attitude, in base [rad] (n, 3).

    Args:
        attitude: quaternions (x, y, z, w) (n, 4).
        state: what was desired at the same times.
    """
    turn = Rotation.from_quat(state.attitude_desired).inv() * Rotation.from_quat(attitude)
    vector: Array = turn.as_rotvec()
    return vector


def true_attitude(base: Base, time: Array) -> Array:
    """Return the true attitude at some times [s] (n,) as quaternions (x, y, z, w) (n, 4)."""
    inside = np.clip(time, base.time[0], base.time[-1])
    turns: Array = Slerp(base.time, Rotation.from_quat(base.orientation))(inside).as_quat()
    return turns


def taut(fans: Fans, time: Array) -> Mask:
    """Return whether any rope pulls at some times [s] (n,), or has within the last sample."""
    place = np.clip(np.searchsorted(fans.time, time, "right") - 1, 0, len(fans) - 1)
    pulls: Mask = np.any(fans.rope_taut[place], axis=1)
    return pulls


def taut_spans(fans: Fans) -> list[Span]:
    """Return the times [s] in which any rope pulls."""
    pulls = np.any(fans.rope_taut, axis=1).astype(np.int8)
    edges = np.flatnonzero(np.diff(pulls, prepend=0, append=0))
    last = len(fans) - 1
    return [
        (float(fans.time[first]), float(fans.time[min(end, last)]))
        for first, end in edges.reshape(-1, 2)
    ]


def flying(propulsion: Propulsion) -> Mask:
    """Return when the fans are asked for so much thrust that the autopilot holds an attitude."""
    held: Mask = propulsion.armed & (propulsion.collective_desired > LEAST_THRUST)
    return held


def attitude_summary(
    recording: Recording, start: float, end: float
) -> dict[str, float | int | None]:
    """Return how far the attitude was from the desired one between two times [s], fans carrying.

    `attitude_rms_deg` is the root mean square over time and over the three axes of the true
    attitude's error while all ropes are slack; `_taut` while one is taut, `_all` whatever the ropes
    do. Desired headings count from the autopilot's north, so the mean `heading_offset_deg` of its
    compass is taken out of the truth; `attitude_to_true_north_rms_deg` has it in. `_measured` is
    the error of the attitude that the autopilot takes for true, which is what it can see.
    """
    state = recording.propulsion.between(start, end)
    truth = true_attitude(recording.base, state.time)
    held, pulls = flying(state), taut(recording.fans, state.time)
    offset = heading_offset(state.attitude[held], truth[held])
    to_compass = Rotation.from_euler("z", offset)
    errors = {
        "": attitude_error((to_compass * Rotation.from_quat(truth)).as_quat(), state),
        "_to_true_north": attitude_error(truth, state),
        "_measured": attitude_error(state.attitude, state),
    }
    result: dict[str, float | int | None] = {"heading_offset_deg": float(np.degrees(offset))}
    for name, rows in (("", held & ~pulls), ("_taut", held & pulls), ("_all", held)):
        result[f"duration{name or '_slack'}_s"] = float(rows.sum() / _rate(state))
        for kind, error in errors.items():
            degrees = np.degrees(error[rows])
            result[f"attitude{kind}_rms{name}_deg"] = rms(degrees)
            for axis, values in zip(_AXES, degrees.T, strict=True):
                result[f"{axis}{kind}_rms{name}_deg"] = rms(values)
    return result


def heading_offset(attitude: Array, truth: Array) -> float:
    """Return the mean angle about the vertical from the true to the measured attitude [rad].

    Both are quaternions (x, y, z, w) (n, 4).
    """
    if not len(truth):
        return 0.0
    turn = Rotation.from_quat(attitude) * Rotation.from_quat(truth).inv()
    vector: Array = turn.as_rotvec()
    return float(vector[:, 2].mean())


def _rate(state: Propulsion) -> float:
    return 1.0 / float(np.median(np.diff(state.time))) if len(state) > 1 else 1.0


# Battery --------------------------------------------------------------------------------------
def open_circuit_voltage(robot: Robot, charge: Array) -> Array:
    """Return the pack's voltage without load [V] (n,) for a share of charge (n,)."""
    curve = robot.battery.cell_voltage
    cell = np.interp(charge, np.linspace(0.0, 1.0, len(curve)), curve)
    voltage: Array = robot.battery.cells * cell
    return voltage


def pack_resistance(robot: Robot) -> float:
    """Return the resistance of pack and wiring [ohm]."""
    battery = robot.battery
    return battery.cells * battery.cell_resistance + battery.wiring_resistance


def battery_summary(
    recording: Recording, robot: Robot, before: Span, after: Span
) -> dict[str, float | int | None]:
    """Return what spinning up did to the battery, by its voltage and current as measured.

    The drop that is expected is R times the rise in current, and what the open-circuit voltage
    loses by the charge that was drawn. `resistance_measured_mohm` is fitted to all measurements
    from `before` to `after`, through the same voltage. `current_rise_least_a` is what the jets
    alone need for the thrust that is made, by momentum theory, without any loss.

    Args:
        recording: with state of the fans and of the propulsion unit.
        robot: whose battery it is.
        before: fans off [s, s].
        after: fans at a steady thrust [s, s].
    """
    state = recording.propulsion.between(before[0], after[1])
    state = state.between(*_known(state))
    fans = recording.fans
    charge = np.interp(state.time, fans.time, fans.battery_charge)
    unloaded = open_circuit_voltage(robot, charge)

    def mean(values: Array, span: Span) -> float:
        inside = (state.time >= span[0]) & (state.time <= span[1])
        return float(values[inside].mean()) if inside.any() else float("nan")

    rise = mean(state.current, after) - mean(state.current, before)
    drop = mean(state.voltage, before) - mean(state.voltage, after)
    resistance = pack_resistance(robot)
    expected = resistance * rise + mean(unloaded, before) - mean(unloaded, after)
    current = state.current - state.current.mean() if len(state) else state.current
    sag = unloaded - state.voltage
    fans_after = fans.between(*after)
    jets = FanModel.of(robot).jet_factor * np.sum(fans_after.thrust.clip(0.0) ** 1.5, axis=1)
    fitted = float(current @ sag / (current @ current)) if len(state) else float("nan")
    return {
        "current_before_a": mean(state.current, before),
        "current_after_a": mean(state.current, after),
        "current_rise_a": rise,
        "current_rise_least_a": float(jets.mean()) / mean(state.voltage, after),
        "current_peak_a": float(state.current.max()) if len(state) else float("nan"),
        "voltage_before_v": mean(state.voltage, before),
        "voltage_after_v": mean(state.voltage, after),
        "voltage_drop_v": drop,
        "voltage_drop_expected_v": expected,
        "voltage_drop_ratio": drop / expected,
        "resistance_mohm": 1e3 * resistance,
        "resistance_measured_mohm": 1e3 * fitted,
    }


def _known(state: Propulsion) -> Span:
    """Return the times between which the battery's voltage is known [s]."""
    known = np.flatnonzero(np.isfinite(state.voltage) & np.isfinite(state.current))
    if not len(known):
        return (0.0, -1.0)
    return float(state.time[known[0]]), float(state.time[known[-1]])


# Position -------------------------------------------------------------------------------------
def base_by_t265(recording: Recording, robot: Robot) -> Base:
    """Return the base's motion by the tracking camera, put where the truth begins.

    The camera's world begins where the camera does, levelled and with its heading, so what it says
    is turned about the vertical and moved until its first pose is the true one.

    Args:
        recording: with ground truth and the camera's poses.
        robot: where the camera is.
    """
    seen, base = recording.t265, recording.base
    mount = Rotation.from_euler("xyz", np.array(robot.t265.rpy))
    turn = Rotation.from_quat(seen.orientation) * mount.inv()
    position = seen.position - turn.apply(np.array(robot.t265.position))
    at_start = true_attitude(base, seen.time[:1])
    yaw = Rotation.from_quat(at_start[0]).as_euler("ZYX")[0] - turn[0].as_euler("ZYX")[0]
    heading = Rotation.from_euler("z", yaw)
    begin = [np.interp(seen.time[0], base.time, base.position[:, axis]) for axis in range(3)]
    return Base(
        seen.time,
        heading.apply(position - position[0]) + np.array(begin),
        (heading * turn).as_quat(),
        heading.apply(seen.velocity),
        mount.apply(seen.angular_velocity),
    )
