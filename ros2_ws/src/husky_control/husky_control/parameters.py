"""The controller's live parameters: every gain once, with its range, unit and meaning (T11)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import TYPE_CHECKING, Any

from husky_control.gait.table import COLUMN_UNITS, GAIT_RANGES, GAITS, Gait
from husky_control.parameter_rules import RULES, Rule, check_rules, make_rules

if TYPE_CHECKING:
    from husky_description.robot import Robot


@dataclass(frozen=True)
class Parameter:
    """A number that may change while the robot runs."""

    default: float
    lower: float
    upper: float
    unit: str
    description: str


_P = Parameter

# The ends of the ranges lie inside of what was measured, one parameter after the other, with the
# rest at their defaults and all sensor noise on: the value set while the robot trots at 0.3 m/s and
# before it starts, ahead, turning and sideways, to a stop; crawl, climb at 25 deg, trot with the
# fans' help, standing up and sitting down for what acts there. Safety trips no robot that does this.
# fmt: off
_GAINS: dict[str, Parameter] = {
    "command.acceleration": _P(1.5, 0.1, 5.0, "m/s^2", "Ramp of the velocity command"),
    "command.yaw_acceleration": _P(3.0, 0.1, 10.0, "rad/s^2", "Ramp of the yaw rate command"),
    "command.max_yaw_rate": _P(0.8, 0.0, 2.0, "rad/s", "Largest yaw rate command accepted, where the gait allows it"),
    "command.max_lateral_speed": _P(0.3, 0.0, 1.0, "m/s", "Largest sideways speed accepted, where the gait allows it"),
    "command.zero_speed": _P(0.01, 0.0, 0.1, "m/s", "A velocity command slower than this, over ground, and than command.zero_yaw_rate counts as zero"),
    "command.zero_yaw_rate": _P(0.01, 0.0, 0.1, "rad/s", "A velocity command that turns slower than this, and is below command.zero_speed, counts as zero"),
    "command.timeout": _P(0.5, 0.1, 5.0, "s", "A velocity command older than this stops walking"),
    "walk.position_gain": _P(0.8, 0.0, 2.0, "1/s", "Position error into the desired velocity (the integral of the velocity error)"),
    "walk.position_leash": _P(0.15, 0.0, 0.5, "m", "Most position error that is remembered"),
    "walk.yaw_leash": _P(0.20, 0.0, 0.6, "rad", "Most heading error that is remembered"),
    "walk.hold_back": _P(0.2, 0.05, 1.0, "m/s", "Most by which stance feet hold the body back, or push it, towards its desired velocity"),
    "walk.height_rate": _P(0.10, 0.01, 0.5, "m/s", "Slew of the body height"),
    "walk.sway_limit": _P(0.10, 0.05, 0.2, "m", "Most sway of the body over its support polygon"),
    "walk.sway_excursion": _P(0.025, 0.005, 0.2, "m", "How far a sway may push the zero-moment point; sets its time"),
    "walk.static_load_time": _P(0.15, 0.0, 1.0, "s", "Time over which a leg is loaded and unloaded in a gait with a static margin"),
    "walk.late_limit": _P(0.06, 0.0, 0.3, "s", "How long the clock waits for a late touchdown"),
    "walk.search_speed": _P(0.35, 0.0, 1.0, "m/s", "A late foot reaches down at this speed"),
    "walk.search_depth": _P(0.05, 0.0, 0.1, "m", "and no further below the ground than this"),
    "walk.touchdown_blend": _P(0.02, 0.0, 0.2, "s", "Time constant that takes up the step between swing and stance targets"),
    "walk.load_time": _P(0.02, 0.0, 0.2, "s", "Time to full weight of a leg in the force distribution after touchdown"),
    "walk.weight_share": _P(1.0, 0.3, 1.2, "-", "Share of the weight carried by torque feed-forward"),
    "walk.load_compliance": _P(1e-3, 0.0, 3e-3, "m/s/N", "How fast standing feet yield to load that they hold against each other"),
    "walk.attitude_stiffness": _P(0.0, 0.0, 400.0, "N m/rad", "Roll and pitch moment asked of the stance legs by feed-forward"),
    "walk.attitude_damping": _P(15.0, 0.0, 40.0, "N m s/rad", "Roll and pitch rate damping asked of the stance legs by feed-forward"),
    "walk.terrain_follow": _P(1.0, 0.0, 1.0, "-", "Share of a foothold's height difference that its stance target keeps"),
    "assist.share": _P(0.0, 0.0, 0.8, "-", "Share of the weight that the fans carry while the robot stands and walks; to be set after arming"),
    "assist.slew": _P(0.4, 0.05, 2.0, "1/s", "How fast that share changes"),
    "assist.attitude_stiffness": _P(20.0, 0.0, 100.0, "N m/rad", "Roll and pitch moment asked of the fans"),
    "assist.attitude_damping": _P(3.0, 0.0, 20.0, "N m s/rad", "Roll and pitch rate damping asked of the fans"),
    "assist.moment_limit": _P(2.0, 0.0, 4.0, "N m", "Largest moment asked of the fans about roll and pitch, each"),
    "wair.load_slope": _P(0.32, 0.05, 0.5, "-", "Tangential over normal load that the feet are to bear on an incline; the fans take the rest"),
    "wair.most_load_slope": _P(0.5, 0.35, 1.0, "-", "Most of it that footholds and feed-forward allow for, while the fans give less"),
    "wair.least_load": _P(62.0, 0.0, 80.0, "N", "Least force on the ground that all feet together are to keep; on steep slopes the fans press them"),
    "wair.thrust_share": _P(1.0, 0.0, 1.5, "-", "Share of the statics' thrust that is asked for; 0 climbs without fans"),
    "wair.thrust_limit": _P(73.5, 0.0, 80.0, "N", "Most thrust asked for"),
    "wair.thrust_slew": _P(40.0, 5.0, 200.0, "N/s", "How fast the thrust asked for changes"),
    "wair.velocity_gain": _P(15.0, 0.0, 100.0, "N s/m", "Thrust per velocity error along the incline"),
    "wair.feedback_limit": _P(3.0, 0.0, 20.0, "N", "Most thrust that the velocity error adds"),
    "wair.slope_filter": _P(0.15, 0.0, 2.0, "s", "Time constant of the measured incline"),
    "wair.lean_rate": _P(0.6, 0.05, 3.0, "rad/s", "How fast the body follows the measured incline"),
    "wair.lean_ahead": _P(0.30, 0.2, 0.6, "rad", "With fixed fans, how much further than the slope the body pitches ahead from 45 deg on; times tan(slope) below"),
    "wair.lean_sink": _P(0.11, 0.05, 0.15, "m", "How much lower such a body walks"),
    "wair.crouch_time": _P(0.6, 0.2, 0.6, "s", "Time to crouch when the fans are lost on an incline"),
    "foothold.velocity_gain": _P(0.15, 0.05, 0.4, "s", "Foothold displacement per velocity error"),
    "foothold.reach": _P(0.35, 0.0, 0.5, "m", "Most displacement of a foothold from its nominal place"),
    "foothold.disturbance": _P(0.1, 0.0, 2.0, "m/s", "Velocity change since the last event that places footholds anew within a step; 0 places them at every tick"),
    "contact.touchdown_force": _P(10.0, 5.0, 25.0, "N", "Vertical force that tells a touchdown late in the swing"),
    "contact.early_force": _P(25.0, 15.0, 100.0, "N", "Vertical force that tells a contact early in the swing"),
    "contact.liftoff_force": _P(5.0, 0.0, 9.0, "N", "Vertical force below which contact is lost"),
    "estimator.acceleration": _P(0.15, 0.001, 5.0, "m/s^2/sqrt(Hz)", "Deviation of the specific force, attitude error included"),
    "estimator.foot_drift": _P(0.01, 0.0, 1.0, "m/sqrt(s)", "Drift of a foot in contact"),
    "estimator.foot_position": _P(0.005, 1e-4, 0.1, "m", "Deviation of a foot's place from kinematics"),
    "estimator.foot_velocity": _P(0.10, 1e-3, 5.0, "m/s", "Deviation of a foot's velocity from kinematics"),
    "estimator.ground_height": _P(0.02, 1e-4, 1.0, "m", "Deviation of the ground's height from its mean"),
    "estimator.innovation_gate": _P(3.0, 1.0, 100.0, "-", "Deviations beyond which a foot is believed to slip"),
    "stand.height_offset": _P(0.0, -0.15, 0.06, "m", "Added to the robot's own standing height"),
    "stand.lateral_spread": _P(0.04, 0.0, 0.15, "m", "Feet outside of the hips after standing up"),
    "stand.duration": _P(2.0, 0.8, 10.0, "s", "Duration of standing up and of sitting down"),
    "stand.joint_speed": _P(1.0, 0.3, 5.0, "rad/s", "Speed of the joints while the body lies and the feet go to their places"),
    "safety.stop_category": _P(1.0, 0.0, 1.0, "-", "Category of a stop after IEC 60204-1: 1 lies down before the joints let go, below 1 they let go at once"),
    "safety.max_tilt": _P(0.8, 0.35, 1.5, "rad", "Tilt of the body beyond which it is falling"),
    "safety.joint_margin": _P(0.15, 0.0, 0.5, "rad", "How far a joint may be beyond its range"),
    "safety.torque_share": _P(0.98, 0.8, 1.5, "-", "Share of the torque limit that counts as overload"),
    "safety.torque_time": _P(0.5, 0.4, 5.0, "s", "Time of overload of one joint that trips; the crawl has 0.34 s of it at a share of 0.8"),
    "safety.imu_age": _P(0.020, 0.005, 0.2, "s", "Age of the IMU sample that trips; above its period of 1.25 ms, its way over the line and a late tick"),
    "safety.joint_age": _P(2.0, 2.0, 50.0, "ticks", "Age of the joint states beyond which they trip; 2 forgives one lost frame"),
}
_WITH_PROPELLERS: dict[str, Parameter] = {
    "contact.standing_force": _P(10.0, 4.0, 18.0, "N", "Vertical force that tells contact of a leg that is to stand; where servos' friction asks for more of one that swings"),
    "balance.legs": _P(0.0, 0.0, 5.0, "-", "Legs that mode balance splays: 0 to 3 front left, front right, hind left, hind right; 4 front left and hind right, 5 front right and hind left"),
    "balance.margin": _P(0.04, 0.01, 0.08, "m", "How far inside of the edge of the feet one propeller keeps the centre of pressure"),
    "balance.beyond": _P(0.01, -0.04, 0.05, "m", "How far outside of that edge the body then holds its centre of mass"),
    "balance.idle_thrust": _P(2.3, 0.7, 5.0, "N", "Least thrust of a propeller that helps to balance"),
    "balance.stiffness": _P(30.0, 15.0, 45.0, "N m/rad", "Moment about the edge asked of the propellers by tilt, beside what statics ask for"),
    "balance.damping": _P(10.0, 8.0, 20.0, "N m s/rad", "The same by the rate of tilting"),
    "balance.levelling": _P(1.0, 0.0, 1.5, "1/s", "Rate at which legs that stand turn the body back to level, by its tilt"),
    "balance.thrust_vectoring": _P(1.0, 0.0, 1.0, "-", "Share of what such arms do to hold the heading, by tilting the propellers (T21)"),
    "balance.yaw_stiffness": _P(2.2, 0.0, 9.0, "N m/rad", "Yaw moment asked of tilted propellers by heading error"),
    "balance.yaw_damping": _P(0.3, 0.0, 1.8, "N m s/rad", "The same by yaw rate"),
    "quadrotor.height": _P(0.5, 0.2, 5.0, "m", "Height of the flight above where it took off"),
    "quadrotor.landing_depth": _P(0.25, 0.05, 5.0, "m", "How far below where it took off a landing that was asked for looks for ground; then it holds again"),
    "quadrotor.max_speed": _P(0.5, 0.0, 1.5, "m/s", "Largest speed in flight accepted, ahead and to the side"),
    "quadrotor.max_yaw_rate": _P(0.5, 0.0, 1.5, "rad/s", "Largest yaw rate in flight accepted"),
    "quadrotor.position_gain": _P(1.2, 0.5, 1.5, "1/s", "Velocity per position error in flight; as the next three taken over at take-off"),
    "quadrotor.velocity_gain": _P(2.4, 1.4, 3.0, "1/s", "Acceleration per velocity error in flight"),
    "quadrotor.trim_gain": _P(1.0, 0.1, 1.5, "1/s^3", "Growth of the acceleration that holds against a wind, per position error"),
    "quadrotor.trim_limit": _P(1.0, 0.2, 1.5, "m/s^2", "Most of that acceleration"),
    "quadrotor.thrust_vectoring": _P(0.0, 0.0, 1.0, "-", "Share of what the arms do to turn the body, by tilting the propellers (T21); 0 holds them still"),
    "quadrotor.yaw_gain": _P(4.0, 1.0, 6.0, "1/s", "Yaw rate per heading error that tilted propellers are to give"),
    "quadrotor.yaw_damping": _P(0.2, 0.1, 0.25, "N m s/rad", "Yaw moment asked of tilted propellers per error of that rate"),
    "quadrotor.arm_sweep": _P(0.0, -0.2, 0.2, "rad", "Sweep of the arms about the hip sagittal axes by which front and hind ones near each other, in the hold"),
}
"""Of a robot whose legs carry propellers, at its own size."""
# fmt: on

_GAIT_COLUMNS: dict[str, str] = {
    "period": "Duration of one cycle",
    "duty": "Fraction of the cycle that a leg stands",
    "swing_height": "Height of the foot over the straight line of its swing",
    "stance_height": "Base over the foot centres",
    "forward_spread": "Footholds ahead of the front hips and behind the hind hips",
    "lateral_spread": "Footholds outside of the hips",
    "velocity_follow": "Share of the velocity error that stance feet give way to",
    "static_margin": "Margin kept inside of the support polygon before a leg lifts",
    "hop_speed": "Upward speed of the body at liftoff",
    "max_speed": "Largest forward speed accepted",
    "max_lateral_speed": "Largest sideways speed accepted",
    "max_yaw_rate": "Largest yaw rate accepted",
}


def _table() -> dict[str, Parameter]:
    table = dict(_GAINS)
    for gait in GAITS.values():
        for column, description in _GAIT_COLUMNS.items():
            lower, upper = GAIT_RANGES[gait.name][column]
            table[f"gait.{gait.name}.{column}"] = Parameter(
                float(getattr(gait, column)),
                lower,
                upper,
                COLUMN_UNITS[column],
                f"{description} ({gait.name}; taken over when walking starts)",
            )
    return table


TABLE: Mapping[str, Parameter] = _table()
"""Husky Carbon's."""

# fmt: off
_DIMENSIONS: dict[str, tuple[float, float]] = {
    "-": (0.0, 0.0), "rad": (0.0, 0.0), "m/s^2": (0.0, 0.0),
    "m": (1.0, 0.0), "s": (0.5, 0.0), "m/s": (0.5, 0.0), "m/s/N": (0.5, -1.0),
    "1/s": (-0.5, 0.0), "rad/s": (-0.5, 0.0), "rad/s^2": (-1.0, 0.0),
    "N": (0.0, 1.0), "N/s": (-0.5, 1.0), "N s/m": (-0.5, 1.0),
    "N m": (1.0, 1.0), "N m/rad": (1.0, 1.0), "N m s/rad": (1.5, 1.0),
}
# fmt: on
"""Powers of length and mass with which a unit goes among similar robots, times with the root of
lengths, because gravity is the same for all (Froude)."""
_SAME_FOR_ALL = ("estimator.", "safety.", "command.timeout", "command.zero_")
"""What does not go with the robot's size: of sensors, limits and operators."""


def table_of(robot: Robot) -> Mapping[str, Parameter]:
    """Return the parameters of a robot: Carbon's, scaled to its size, with its file's defaults.

    Raises:
        ValueError: the file gives a parameter that there is none of, or one out of range.
    """
    length, mass = robot.size.length, robot.size.mass
    table = {}
    for name, row in TABLE.items():
        if length != 1.0 or mass != 1.0:
            row = _similar(row, length, mass) if not name.startswith(_SAME_FOR_ALL) else row
        table[name] = row
    if robot.legs_carry_propellers:
        table |= _WITH_PROPELLERS
    for name, (lower, upper) in robot.gain_ranges.items():
        if name in table:
            table[name] = replace(table[name], lower=lower, upper=upper)
    for name, value in robot.gains.items():
        number = _in_range(table, name, value)
        table[name] = replace(table[name], default=number)
    return table


def _similar(row: Parameter, length: float, mass: float) -> Parameter:
    """Scale a parameter; three digits of it are enough."""
    of_length, of_mass = _DIMENSIONS[row.unit]
    factor = length**of_length * mass**of_mass

    def scaled(value: float) -> float:
        return float(f"{value * factor:.3g}")

    ends = (scaled(row.lower), scaled(row.upper))
    return replace(row, default=scaled(row.default), lower=ends[0], upper=ends[1])


class Parameters:
    """Values of the live parameters; one out of range, or that does not fit another, is refused."""

    def __init__(
        self,
        values: Mapping[str, float] | None = None,
        table: Mapping[str, Parameter] = TABLE,
        rules: Sequence[Rule] = RULES,
    ) -> None:
        """The defaults of a table, with some values replaced; see `of` for a robot's.

        Raises:
            ValueError: see `set_all`.
        """
        self._table, self._rules = table, rules
        self._values = {name: parameter.default for name, parameter in table.items()}
        self.revision = 0
        self._set_at: dict[str, int] = {}
        self.set_all(values or {})

    @classmethod
    def of(cls, robot: Robot, values: Mapping[str, float] | None = None) -> Parameters:
        """Make those of a robot, with some values replaced.

        Raises:
            ValueError: see `set_all`.
        """
        return cls(values, table_of(robot), make_rules(robot.size.length))

    def __getitem__(self, name: str) -> float:
        """The value of one parameter, in the unit of the table."""
        return self._values[name]

    def get(self, name: str, default: float) -> float:
        """The value of a parameter that not every robot has, a default where there is none."""
        return self._values.get(name, default)

    def __iter__(self) -> Iterator[str]:
        """The names, in the order of the table."""
        return iter(self._values)

    def set(self, name: str, value: float) -> None:
        """Change one parameter; see `set_all`."""
        self.set_all({name: value})

    def set_all(self, values: Mapping[str, float]) -> None:
        """Change parameters together, all or none; they take effect at the next tick.

        Raises:
            ValueError: a name is unknown, a value is no finite number or out of range, or values
                do not fit each other or those that stay.
        """
        chosen = {name: _in_range(self._table, name, value) for name, value in values.items()}
        check_rules({**self._values, **chosen}, chosen, self._rules)
        for name, number in chosen.items():
            self._values[name] = number
            self.revision += 1
            self._set_at[name] = self.revision

    def set_own(self, values: Mapping[str, Any]) -> None:
        """Change those of a node's parameters that stand in the robot's table; see `set_all`."""
        self.set_all({name: value for name, value in values.items() if name in self._table})

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
            column: self._values[f"gait.{name}.{column}"] for column in _GAIT_COLUMNS
        }
        return gait._replace(**values)


def _in_range(table: Mapping[str, Parameter], name: str, value: float) -> float:
    parameter = table.get(name)
    if parameter is None:
        raise ValueError(f"there is no parameter '{name}'")
    number = float(value) if isinstance(value, Real) else math.nan
    if not math.isfinite(number) or not parameter.lower <= number <= parameter.upper:
        raise ValueError(
            f"{name} must be within {parameter.lower:g} to {parameter.upper:g} "
            f"{parameter.unit}, not {value}"
        )
    return number
