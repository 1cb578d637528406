"""The controller's live parameters: every gain once, with its range, unit and meaning (T11)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from husky_control.gait import COLUMN_UNITS, GAITS, Gait


@dataclass(frozen=True)
class Parameter:
    """A number that may change while the robot runs."""

    default: float
    lower: float
    upper: float
    unit: str
    description: str


_P = Parameter

# fmt: off
_GAINS: dict[str, Parameter] = {
    "command.acceleration": _P(1.5, 0.1, 5.0, "m/s^2", "Ramp of the velocity command"),
    "command.yaw_acceleration": _P(3.0, 0.1, 10.0, "rad/s^2", "Ramp of the yaw rate command"),
    "command.max_yaw_rate": _P(0.8, 0.0, 2.0, "rad/s", "Largest yaw rate command accepted"),
    "command.max_lateral_speed": _P(0.3, 0.0, 1.0, "m/s", "Largest sideways speed accepted"),
    "command.timeout": _P(0.5, 0.05, 5.0, "s", "A velocity command older than this stops walking"),
    "walk.position_gain": _P(0.8, 0.0, 3.0, "1/s", "Position error into the desired velocity (the integral of the velocity error)"),
    "walk.position_leash": _P(0.15, 0.0, 0.5, "m", "Most position error that is remembered"),
    "walk.yaw_leash": _P(0.20, 0.0, 0.6, "rad", "Most heading error that is remembered"),
    "walk.hold_back": _P(0.2, 0.0, 1.0, "m/s", "Most by which stance feet hold the body back, or push it, towards its desired velocity"),
    "walk.height_rate": _P(0.10, 0.01, 0.5, "m/s", "Slew of the body height"),
    "walk.sway_limit": _P(0.10, 0.0, 0.2, "m", "Most sway of the body over its support polygon"),
    "walk.sway_excursion": _P(0.025, 0.005, 0.2, "m", "How far a sway may push the zero-moment point; sets its time"),
    "walk.static_load_time": _P(0.15, 0.0, 1.0, "s", "Time over which a leg is loaded and unloaded in a gait with a static margin"),
    "walk.late_limit": _P(0.06, 0.0, 0.3, "s", "How long the clock waits for a late touchdown"),
    "walk.search_speed": _P(0.35, 0.0, 1.0, "m/s", "A late foot reaches down at this speed"),
    "walk.search_depth": _P(0.05, 0.0, 0.1, "m", "and no further below the ground than this"),
    "walk.touchdown_blend": _P(0.02, 0.0, 0.2, "s", "Time constant that takes up the step between swing and stance targets"),
    "walk.load_time": _P(0.02, 0.0, 0.2, "s", "Time to full weight of a leg in the force distribution after touchdown"),
    "walk.weight_share": _P(1.0, 0.0, 1.2, "-", "Share of the weight carried by torque feed-forward"),
    "walk.load_compliance": _P(1e-3, 0.0, 1e-2, "m/s/N", "How fast standing feet yield to load that they hold against each other"),
    "walk.attitude_stiffness": _P(0.0, 0.0, 400.0, "N m/rad", "Roll and pitch moment asked of the stance legs by feed-forward"),
    "walk.attitude_damping": _P(15.0, 0.0, 40.0, "N m s/rad", "Roll and pitch rate damping asked of the stance legs by feed-forward"),
    "walk.terrain_follow": _P(1.0, 0.0, 1.0, "-", "Share of a foothold's height difference that its stance target keeps"),
    "assist.share": _P(0.0, 0.0, 0.8, "-", "Share of the weight that the fans carry while the robot stands and walks"),
    "assist.slew": _P(0.4, 0.05, 2.0, "1/s", "How fast that share changes"),
    "assist.attitude_stiffness": _P(20.0, 0.0, 100.0, "N m/rad", "Roll and pitch moment asked of the fans"),
    "assist.attitude_damping": _P(3.0, 0.0, 20.0, "N m s/rad", "Roll and pitch rate damping asked of the fans"),
    "assist.moment_limit": _P(2.0, 0.0, 4.0, "N m", "Largest moment asked of the fans about roll and pitch, each"),
    "wair.load_slope": _P(0.32, 0.05, 0.7, "-", "Tangential over normal load that the feet are to bear on an incline; the fans take the rest"),
    "wair.most_load_slope": _P(0.5, 0.05, 1.0, "-", "Most of it that footholds and feed-forward allow for, while the fans give less"),
    "wair.least_load": _P(62.0, 0.0, 80.0, "N", "Least force on the ground that all feet together are to keep; on steep slopes the fans press them"),
    "wair.thrust_share": _P(1.0, 0.0, 1.5, "-", "Share of the statics' thrust that is asked for; 0 climbs without fans"),
    "wair.thrust_limit": _P(73.5, 0.0, 80.0, "N", "Most thrust asked for"),
    "wair.thrust_slew": _P(40.0, 5.0, 200.0, "N/s", "How fast the thrust asked for changes"),
    "wair.velocity_gain": _P(15.0, 0.0, 100.0, "N s/m", "Thrust per velocity error along the incline"),
    "wair.feedback_limit": _P(3.0, 0.0, 20.0, "N", "Most thrust that the velocity error adds"),
    "wair.slope_filter": _P(0.15, 0.0, 2.0, "s", "Time constant of the measured incline"),
    "wair.lean_rate": _P(0.6, 0.05, 3.0, "rad/s", "How fast the body follows the measured incline"),
    "wair.lean_ahead": _P(0.30, 0.0, 0.6, "rad", "With fixed fans, how much further than the slope the body pitches ahead from 45 deg on; times tan(slope) below"),
    "wair.lean_sink": _P(0.11, 0.0, 0.15, "m", "How much lower such a body walks"),
    "wair.crouch_time": _P(0.6, 0.2, 5.0, "s", "Time to crouch when the fans are lost on an incline"),
    "foothold.velocity_gain": _P(0.15, 0.0, 0.4, "s", "Foothold displacement per velocity error"),
    "foothold.reach": _P(0.35, 0.0, 0.5, "m", "Most displacement of a foothold from its nominal place"),
    "foothold.disturbance": _P(0.1, 0.0, 2.0, "m/s", "Velocity change since the last event that places footholds anew within a step; 0 places them at every tick"),
    "contact.touchdown_force": _P(10.0, 1.0, 60.0, "N", "Vertical force that tells a touchdown late in the swing"),
    "contact.early_force": _P(25.0, 1.0, 100.0, "N", "Vertical force that tells a contact early in the swing"),
    "contact.liftoff_force": _P(5.0, 0.0, 60.0, "N", "Vertical force below which contact is lost"),
    "estimator.acceleration": _P(0.15, 0.001, 5.0, "m/s^2/sqrt(Hz)", "Deviation of the specific force, attitude error included"),
    "estimator.foot_drift": _P(0.01, 0.0, 1.0, "m/sqrt(s)", "Drift of a foot in contact"),
    "estimator.foot_position": _P(0.005, 1e-4, 0.1, "m", "Deviation of a foot's place from kinematics"),
    "estimator.foot_velocity": _P(0.10, 1e-3, 5.0, "m/s", "Deviation of a foot's velocity from kinematics"),
    "estimator.ground_height": _P(0.02, 1e-4, 1.0, "m", "Deviation of the ground's height from its mean"),
    "estimator.innovation_gate": _P(3.0, 1.0, 100.0, "-", "Deviations beyond which a foot is believed to slip"),
    "stand.height_offset": _P(0.0, -0.15, 0.06, "m", "Added to the robot's own standing height"),
    "stand.lateral_spread": _P(0.04, 0.0, 0.15, "m", "Feet outside of the hips after standing up"),
    "stand.duration": _P(2.0, 0.5, 10.0, "s", "Duration of standing up and of sitting down"),
    "stand.joint_speed": _P(1.0, 0.1, 5.0, "rad/s", "Speed of the joints while the body lies and the feet go to their places"),
    "safety.max_tilt": _P(0.8, 0.1, 1.5, "rad", "Tilt of the body beyond which it is falling"),
    "safety.joint_margin": _P(0.15, 0.0, 0.5, "rad", "How far a joint may be beyond its range"),
    "safety.torque_share": _P(0.98, 0.1, 1.5, "-", "Share of the torque limit that counts as overload"),
    "safety.torque_time": _P(0.5, 0.01, 5.0, "s", "Time of overload of one joint that trips"),
    "safety.imu_age": _P(0.020, 0.001, 0.2, "s", "Age of the IMU sample that trips"),
    "safety.joint_age": _P(2.0, 1.0, 50.0, "ticks", "Age of the joint states beyond which they trip"),
}
# fmt: on

_GAIT_RANGES: dict[str, tuple[float, float, str]] = {
    "period": (0.15, 6.0, "Duration of one cycle"),
    "duty": (0.3, 0.95, "Fraction of the cycle that a leg stands"),
    "swing_height": (0.01, 0.20, "Height of the foot over the straight line of its swing"),
    "stance_height": (0.35, 0.60, "Base over the foot centres"),
    "forward_spread": (-0.2, 0.2, "Footholds ahead of the front hips and behind the hind hips"),
    "lateral_spread": (-0.1, 0.2, "Footholds outside of the hips"),
    "velocity_follow": (0.0, 1.0, "Share of the velocity error that stance feet give way to"),
    "static_margin": (0.0, 0.08, "Margin kept inside of the support polygon before a leg lifts"),
    "hop_speed": (0.0, 2.0, "Upward speed of the body at liftoff"),
    "max_speed": (0.0, 2.5, "Largest forward speed accepted"),
}


def _table() -> dict[str, Parameter]:
    table = dict(_GAINS)
    for gait in GAITS.values():
        for column, (lower, upper, description) in _GAIT_RANGES.items():
            table[f"gait.{gait.name}.{column}"] = Parameter(
                float(getattr(gait, column)),
                lower,
                upper,
                COLUMN_UNITS[column],
                f"{description} ({gait.name}; taken over when walking starts)",
            )
    return table


TABLE: Mapping[str, Parameter] = _table()


class Parameters:
    """Values of the live parameters; a value outside of its range is refused."""

    def __init__(self, values: Mapping[str, float] | None = None) -> None:
        """The defaults of the table, with some values replaced.

        Raises:
            ValueError: a name is unknown or a value out of range.
        """
        self._values = {name: parameter.default for name, parameter in TABLE.items()}
        self.revision = 0
        self._set_at: dict[str, int] = {}
        for name, value in (values or {}).items():
            self.set(name, value)

    def __getitem__(self, name: str) -> float:
        """The value of one parameter, in the unit of the table."""
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        """The names, in the order of the table."""
        return iter(self._values)

    def set(self, name: str, value: float) -> None:
        """Change one parameter; it takes effect at the next tick.

        Raises:
            ValueError: the name is unknown, or the value not finite or out of range.
        """
        parameter = TABLE.get(name)
        if parameter is None:
            raise ValueError(f"there is no parameter '{name}'")
        number = float(value)
        if not math.isfinite(number) or not parameter.lower <= number <= parameter.upper:
            raise ValueError(
                f"{name} must be within {parameter.lower:g} to {parameter.upper:g} "
                f"{parameter.unit}, not {value}"
            )
        self._values[name] = number
        self.revision += 1
        self._set_at[name] = self.revision

    def set_at(self, name: str) -> int:
        """The revision in which a parameter was set last, 0 for never."""
        return self._set_at.get(name, 0)

    def gait(self, name: str) -> Gait:
        """A gait of the table with the present values of its columns.

        Raises:
            ValueError: there is no such gait.
        """
        gait = GAITS.get(name)
        if gait is None:
            raise ValueError(f"there is no gait '{name}'; there are {', '.join(GAITS)}")
        values: dict[str, Any] = {
            column: self._values[f"gait.{name}.{column}"] for column in _GAIT_RANGES
        }
        return gait._replace(**values)
