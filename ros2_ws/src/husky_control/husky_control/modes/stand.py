"""Mode `stand`: holds the body over four feet."""

from __future__ import annotations

from husky_control.gait.state import BodyInGround, FeetState
from husky_control.modes.behaviour import Behaviour, Happening, Velocity
from husky_control.tick_data import CYCLIC_POSITION, TICK, JointCommand


class Stand(Behaviour):
    """Legs on the ground, which carry the body."""

    assisted = True
    wakes_to = "walk"

    def tick(self, command: JointCommand) -> Happening | None:
        """Lead the legs; end the steps when the velocity command has become silent."""
        c, body, walking = self.context, self.context.body, self.context.walking
        plane, estimator = c.climbing.plane, body.estimator
        if c.watch.silent and walking.stepping:
            c.counters.command_timeouts += 1
            walking.stop_stepping()
            c.reason = "velocity command silent"
        walking.tick(
            BodyInGround(
                body.rotation_on_ground,
                body.measurements.angular_velocity_base_in_base,
                plane @ estimator.position,
                plane @ estimator.velocity,
            ),
            FeetState(
                body.foot_in_base,
                estimator.foot_in_world @ plane.T,
                body.contacts.contact,
                body.contacts.foot_force,
            ),
            self.lift,
            TICK,
        )
        c.counters.out_of_reach = walking.out_of_reach
        command.mode_of_operation = CYCLIC_POSITION
        command.position[:] = walking.joint_position
        command.velocity[:] = walking.joint_velocity
        command.effort[:] = walking.joint_torque
        return None

    @property
    def lift(self) -> float:
        """What the fans carry [N]."""
        return self.context.assist.lift_in_world(self.context.body.rotation)

    def drive(self, velocity: Velocity, *, wakes: bool) -> str:
        """Stay; say what to do first."""
        if not any(velocity):
            return ""
        if not self.context.watch.wakes:
            return "it stands; ask for mode walk, or set walk_on_command"
        return "the command was not zero already when it was to stand; let go first"
