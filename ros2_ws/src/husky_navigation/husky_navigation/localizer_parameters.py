"""Parameters of the localizer, each with unit, range and reason."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated

from husky_description.parameters import bounds_of, number, read_value


@dataclass(frozen=True)
class LocalizerParameters:
    """Parameters of `MapFrame`.

    An error of scale or direction of rms sigma that changes over a length L makes the position a
    random walk of 2 L sigma^2 per metre, as in `husky_control.estimation.odometry_covariance`.
    Drifts "per root metre" are deviations of a random walk over the distance walked.

    Attributes:
        leg_drift: rms error of a step of the legs over its length [-]: the drift of odometry is 1
            to 2 % of the distance.
        leg_drift_length: over which that error changes [m]; assumed, as long as gait and ground
            stay the same.
        leg_height_drift: the same as `leg_drift` of the height [-].
        leg_heading_drift: of odometry's heading per root metre [rad/sqrt(m)]; assumed, 0.03 rad
            over 50 m.
        leg_turn_drift: of the heading per root radian turned [rad/sqrt(rad)]; assumed, 1.5 deg in a
            full turn.
        leg_rest_drift: of the heading per root second [rad/sqrt(s)]: 1 deg in 10 min, as of a
            gyroscope of 6 deg/h.

        tracking_drift: rms error of a step of the T265 over its length [-]: half of the greatest,
            0.8 %, that `carbon.yaml` has (t265.drift).
        tracking_drift_length: over which that error changes [m] (t265.drift_length).
        tracking_heading_drift: of the T265's heading per root metre [rad/sqrt(m)]; assumed, 7 mrad
            over 50 m.
        tracking_position_noise: of a pose of the T265 at high confidence, on each axis, with what
            interpolated odometry adds [m].
        tracking_heading_noise: the same of the heading [rad].

        update_period: time between poses of the T265 that are fused [s].
        gate: deviations beyond which the legs do not explain a pose of the T265 [-]; Gaussian
            errors of four dimensions exceed 5 once in 20 000 poses.
        jump_distance: between two frames of the T265, beyond which it has jumped [m]: ten times the
            step that noise makes at low confidence, 3 mm; its driver allows 0.05 m.
        jump_angle: the same of the heading [rad].
        slip_speed: by which legs and T265 may differ without a jump [m/s]: 0.1 m of a foot's slip
            in half a second.
        slip_turn: the same of the heading [rad/s].
        settle_time: without a jump, after which a T265 is used that has started or has jumped [s].
        silence: without a frame, after which the T265 counts as frozen [s].
        frozen_motion: of the legs while the T265 repeats its pose, after which it counts as frozen
            [m], [rad].

        place_spacing: distance walked between places that are remembered [m].
        place_radius: distance from such a place within which the T265 may recognise it [m].
        loop_distance: walked since the place was there, below which the T265 has not drifted enough
            to correct itself [m].
        place_deviation: of a position that the T265 recognises [m]; assumed.
        place_heading_deviation: the same of the heading [rad]; assumed.
        relocalisation_gate: deviations within which a jump is a relocalisation [-].

        most_speed: of the base [m/s]: beyond it, and
        odometry_jump: this distance [m], odometry has started anew.
        most_turn_rate: of the base [rad/s]: beyond it, and
        odometry_turn_jump: this angle [rad], odometry has started anew.
        odometry_gap: between two poses of odometry, beyond which nothing between them is known
            [s].
    """

    leg_drift: Annotated[float, number(1e-4, 0.5)] = 0.015
    leg_drift_length: Annotated[float, number(0.1, 1000.0)] = 10.0
    leg_height_drift: Annotated[float, number(1e-4, 0.5)] = 0.005
    leg_heading_drift: Annotated[float, number(1e-5, 0.5)] = 0.004
    leg_turn_drift: Annotated[float, number(0.0, 0.5)] = 0.01
    leg_rest_drift: Annotated[float, number(0.0, 0.1)] = 7e-4

    tracking_drift: Annotated[float, number(1e-4, 0.5)] = 0.004
    tracking_drift_length: Annotated[float, number(0.1, 1000.0)] = 20.0
    tracking_heading_drift: Annotated[float, number(1e-5, 0.5)] = 0.001
    tracking_position_noise: Annotated[float, number(1e-4, 0.1)] = 0.003
    tracking_heading_noise: Annotated[float, number(1e-4, 0.1)] = 0.003

    update_period: Annotated[float, number(0.005, 1.0)] = 0.05
    gate: Annotated[float, number(2.0, 20.0)] = 5.0
    jump_distance: Annotated[float, number(0.005, 1.0)] = 0.03
    jump_angle: Annotated[float, number(0.005, 1.0)] = 0.05
    slip_speed: Annotated[float, number(0.0, 2.0)] = 0.2
    slip_turn: Annotated[float, number(0.0, 2.0)] = 0.2
    settle_time: Annotated[float, number(0.0, 10.0)] = 0.5
    silence: Annotated[float, number(0.05, 10.0)] = 0.5
    frozen_motion: Annotated[float, number(0.001, 1.0)] = 0.02

    place_spacing: Annotated[float, number(0.1, 100.0)] = 1.0
    place_radius: Annotated[float, number(0.1, 10.0)] = 1.5
    loop_distance: Annotated[float, number(0.5, 1000.0)] = 5.0
    place_deviation: Annotated[float, number(0.001, 1.0)] = 0.03
    place_heading_deviation: Annotated[float, number(0.001, 1.0)] = 0.01
    relocalisation_gate: Annotated[float, number(1.0, 10.0)] = 3.0

    most_speed: Annotated[float, number(0.1, 20.0)] = 2.0
    odometry_jump: Annotated[float, number(0.005, 1.0)] = 0.03
    most_turn_rate: Annotated[float, number(0.1, 50.0)] = 5.0
    odometry_turn_jump: Annotated[float, number(0.005, 1.0)] = 0.1
    odometry_gap: Annotated[float, number(0.02, 2.0)] = 0.2

    def __post_init__(self) -> None:
        """Check every number.

        Raises:
            ValueError: one is not a number, out of range, or contradicts another; names it, its
                value and what is allowed.
        """
        bounds = bounds_of(type(self))
        for field in fields(self):
            read_value(getattr(self, field.name), bounds[field.name], field.name)
        if self.loop_distance <= 2.0 * self.place_radius:
            raise ValueError(
                f"loop_distance: {self.loop_distance} is not above twice place_radius, "
                f"{2.0 * self.place_radius}"
            )
