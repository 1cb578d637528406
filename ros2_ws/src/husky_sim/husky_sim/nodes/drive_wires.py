"""Messages between the plant and the drives: motors one way, power stages the other."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from husky_msgs.msg import ServoCommand, ServoState
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.message_guard import Refused
from husky_sim.devices.drives.motor import Servos
from husky_sim.nodes.answered_wire import JointWires, peer_of
from husky_sim.nodes.world_clock import ImuLatency, WorldClock
from husky_sim.world import World


class DriveWires(JointWires):
    """Motors of the drives: messages to and from who has the drives.

    That is the drive bridge, or behind frames the drive segment; then the bridge hears of a tick by
    the clock alone, which is told at every tick.
    """

    def __init__(
        self,
        node: Node,
        world: World,
        servos: Servos,
        grace: float,
        latency: ImuLatency,
        advance: Callable[[], None],
        clock: WorldClock | None = None,
    ):
        """Subscribe and publish; arguments as of `open_joint_wires`, a clock for drives behind
        frames.
        """
        name = graph.DRIVE_BRIDGE if clock is None else graph.DRIVE_SEGMENT
        super().__init__(node, world, peer_of(node, world, name, grace))
        self._clock = clock
        self._servos, self._latency, self._advance = servos, latency, advance
        self._command_ns = -1
        self._state = ServoState()
        self._publisher = node.create_publisher(ServoState, graph.SERVO_STATE, qos.CONTROL_OFFERED)
        self.hot = [
            node.create_subscription(
                ServoCommand, graph.SERVO_COMMAND, self._on_command, qos.CONTROL
            )
        ]

    def _on_command(self, command: ServoCommand) -> None:
        stamp = stamps.to_ns(command.stamp)
        if stamp > self._world.time_ns:
            return  # of a time before a reset
        if stamp < self._command_ns:
            self.peer.answer(stamp)
            return  # a sign of life
        taken = self._servos.set_command(
            command.kind,
            command.position,
            command.velocity,
            command.torque,
            command.kp,
            command.kd,
            command.torque_limit,
        )
        if not taken:
            raise Refused("a kind is none of 0 to 3, or a number is not finite")
        self.peer.answer(stamp)
        self._command_ns = stamp
        self._latency.end(stamps.to_ns(command.imu_stamp))
        self._advance()

    def tell(self) -> None:
        """Tell what the motors' encoders show now."""
        if not self._world.has_legs:
            return
        state, servos = self._state, self._servos
        stamps.fill(state.stamp, self._world.time_ns)
        state.encoder_count = servos.encoder_count
        state.velocity_count = servos.velocity_count
        state.current = servos.current
        state.bus_voltage = servos.bus_voltage
        self._send()

    def _say(self) -> None:
        self._publisher.publish(self._state)
        if self._clock is not None:
            self._clock.tell(self._world.time_ns)

    def restart(self) -> None:
        """The world is back at time 0."""
        super().restart()
        self._command_ns = -1
