"""What `low_level_controller` tells: modes, state, odometry, drawing, diagnostics."""

from __future__ import annotations

import math

import numpy as np
from rclpy.node import Node

from husky_control.controller import Controller
from husky_control.gait.stability import static_margin
from husky_control.gait.table import GAITS
from husky_control.modes.table import Mode
from husky_control.nodes.imu_link import ImuLink
from husky_control.nodes.odometry_report import OdometryReport
from husky_control.nodes.plan_link import PlanLink
from husky_control.nodes.walk_markers import WalkMarkers
from husky_control.tick_data import Measurements
from husky_msgs.msg import ControllerMode, ControllerState, ModeTable
from husky_runtime import graph
from husky_runtime.lockstep import Presence
from husky_runtime.nodes import diagnostics, qos, stamps
from husky_runtime.nodes.tick_clock import TickClock, percentile_ms

REPORT_EVERY = 10
"""Ticks between two messages of state and odometry: 50 Hz."""


def mode_table(controller: Controller) -> ModeTable:
    """Return what a robot can be asked for, which stays the same when its world starts again."""
    modes = [
        ControllerMode(name=mode.value, meaning=mode.meaning, requests=requests)
        for mode, requests in controller.allowed_requests().items()
    ]
    return ModeTable(modes=modes, gaits=list(GAITS))


class ControllerReport:
    """Tells of a controller.

    Attributes:
        controller: the present one.
        missed: ticks whose joint states have not come.
    """

    def __init__(self, node: Node, controller: Controller, clock: TickClock, imu: ImuLink):
        """Make the publishers of the controller's node; the IMU is the source of its attitude."""
        self.controller = controller
        self.missed = 0
        self._node, self._clock, self._imu = node, clock, imu
        self._told = (controller.mode, controller.reason)
        self._publisher = node.create_publisher(ControllerState, graph.CONTROLLER_STATE, qos.STATUS)
        modes = node.create_publisher(ModeTable, graph.MODE_TABLE, qos.LATCHED)
        modes.publish(mode_table(controller))
        self._odometry = OdometryReport(node, float(controller.robot.foot_radius))
        self._markers = WalkMarkers(node)

    def restart(self, controller: Controller) -> None:
        """The world starts again, with a new controller."""
        self.controller = controller
        self._odometry.restart()

    def tell_mode(self) -> None:
        """Say a change of mode, or what has changed the robot's mind within one, in one line."""
        mode, reason = self.controller.mode, self.controller.reason
        if (mode, reason) != self._told:
            old, self._told = self._told[0], (mode, reason)
            change = mode.value if mode is old else f"{old.value} -> {mode.value}"
            self._node.get_logger().info(f"mode {change}: {reason}")

    def tell(self, time_ns: int, measurements: Measurements) -> None:
        """Publish state, odometry and drawing after the tick of a time [ns]."""
        self._publisher.publish(self._state(time_ns))
        self._odometry.tell(
            time_ns,
            self.controller,
            measurements.angular_velocity_base_in_base,
            self._imu.attitude_variance,
            self._imu.rate_variance,
        )
        self._markers.tell(time_ns, self.controller)

    def _state(self, time_ns: int) -> ControllerState:
        controller, clock, state = self.controller, self._clock, ControllerState()
        context, body, legs = controller.context, controller.body, controller.present.clock
        contact = body.contacts.contact
        position = body.estimator.position
        stamps.fill(state.stamp, time_ns)
        state.mode, state.gait = controller.mode.value, context.gait
        state.reason = context.reason
        state.phase = legs.phase
        state.stance = controller.present.stance.tolist()
        state.contact = contact.tolist()
        state.joint_positions = body.measurements.joint_position
        state.position = position
        state.orientation = body.measurements.orientation_base_in_world
        state.velocity = body.estimator.velocity
        feet = body.foot_in_base[np.asarray(contact, dtype=bool)]
        # The legs are light: the base's origin stands for the centre of mass.
        margin = static_margin(position, feet @ body.rotation.T + position)
        state.static_margin = margin if len(feet) else math.nan
        state.desired_position = context.desired_position
        state.desired_velocity = context.desired_velocity
        state.commanded_velocity = controller.present.ramped_velocity
        limits = controller.present.velocity_limits
        state.velocity_limit = [controller.parameters[name] for name in limits]
        state.ticks = clock.ticks
        state.overruns = clock.overruns
        state.missed_ticks = self.missed
        state.refused_commands = controller.counters.refused_velocity_commands
        durations = clock.durations(REPORT_EVERY)
        state.tick_time_mean, state.tick_time_max = float(durations.mean()), float(durations.max())
        jitter = np.abs(clock.periods(REPORT_EVERY) - graph.TICK_PERIOD)
        state.jitter_max = float(jitter.max())
        return state

    def diagnose(self, plans: PlanLink | None) -> diagnostics.Report:
        """Return what `/diagnostics` tells.

        Args:
            plans: the planner's side, where one is asked.
        """
        controller, clock, peer = self.controller, self._clock, self._imu.peer
        counters = controller.counters
        level, message = diagnostics.OK, controller.mode.value
        if peer.presence is Presence.LOST:
            level, message = diagnostics.ERROR, f"{peer.name} is lost"
        elif controller.mode in (Mode.SETTLE, Mode.DAMPING, Mode.EMERGENCY_STOP):
            level, message = diagnostics.WARN, f"{message}: {controller.reason}"
        return (
            level,
            message,
            {
                "ticks": clock.ticks,
                "tick_ms_p50": percentile_ms(clock.durations(), 50),
                "tick_ms_p99": percentile_ms(clock.durations(), 99),
                "period_ms_p50": percentile_ms(clock.periods(), 50),
                "period_ms_p99": percentile_ms(clock.periods(), 99),
                "overruns": clock.overruns,
                "missed_ticks": self.missed,
                "peer_losses": peer.losses,
                "refused_commands": counters.refused_velocity_commands,
                "refused_requests": counters.refused_requests,
                "command_timeouts": counters.command_timeouts,
                "bad_measurements": counters.bad_measurements,
                "feet_out_of_reach": counters.out_of_reach,
                "safety_trips": counters.faults,
                "plans": plans.plans if plans is not None else 0,
                "plans_refused": plans.refusals if plans is not None else 0,
            },
        )
