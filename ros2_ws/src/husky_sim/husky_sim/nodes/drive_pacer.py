"""Pacers of `drive_bridge` where its drives are simulated, in its process or behind frames.

`PlantPacer` also paces `drive_segment`, which has the drives when they are behind frames.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from husky_drivers.ethercat.bus import Bus
from husky_drivers.nodes.pacer import BridgeCycle, StreamPacer, WorldClockPacer
from husky_msgs.msg import CycleEnd, ServoCommand, ServoState
from husky_msgs.srv import InjectFault
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_sim.devices.drives.segment import SERVO_COMMAND


class PlantSide(Protocol):
    """Drives as the plant sees them; methods of `SimulatedSegment`."""

    def set_servo_state(
        self, encoder_count: Any, velocity_count: Any, current: Any, bus_voltage: float
    ) -> None:
        """Let one tick pass and say what the motors did in it."""

    def servo_command(self) -> NDArray[np.void]:
        """Return what the power stages do until the next tick."""

    def inject(self, joint: str, fault: str) -> None:
        """Make a drive fail; raises ValueError."""

    def clear(self, joint: str | None = None) -> None:
        """End the injected faults of one drive or of all; raises ValueError."""


class PlantPacer(StreamPacer[ServoState]):
    """Begins a cycle when the plant's motors have moved on; tells it what the drives then do."""

    def __init__(self, node: Node, cycle: BridgeCycle, bus: PlantSide):
        """Subscribe to the plant and offer faults."""
        super().__init__(node, cycle, graph.SERVO_STATE, lambda state: stamps.to_ns(state.stamp))
        self._bus = bus
        self._command = ServoCommand()
        self._publisher = node.create_publisher(
            ServoCommand, graph.SERVO_COMMAND, qos.CONTROL_OFFERED
        )
        self.hot += [
            node.create_subscription(Clock, graph.CLOCK, self._on_clock, qos.CLOCK),
            node.create_subscription(ServoState, graph.SERVO_STATE, self._on_message, qos.CONTROL),
        ]
        node.create_service(InjectFault, graph.DRIVES_INJECT_FAULT, self._on_inject_fault)

    def _on_clock(self, clock: Clock) -> None:
        self._gate.hear_witness(stamps.to_ns(clock.clock))

    def _take(self, message: ServoState) -> None:
        self._bus.set_servo_state(
            message.encoder_count, message.velocity_count, message.current, message.bus_voltage
        )

    def _say_again(self) -> None:
        self._publisher.publish(self._command)

    def cycle_ended(self, time_ns: int) -> None:
        """Tell the plant what the power stages do next."""
        if time_ns < 0:
            return  # the plant has not spoken yet
        servos, message = self._bus.servo_command(), self._command
        stamps.fill(message.stamp, time_ns)
        stamps.fill(message.imu_stamp, self._cycle.imu_stamp_ns)
        for name in SERVO_COMMAND.names or ():
            setattr(message, name, np.ascontiguousarray(servos[name]))
        self._publisher.publish(message)

    def _on_inject_fault(
        self, request: InjectFault.Request, response: InjectFault.Response
    ) -> InjectFault.Response:
        try:
            if request.fault:
                self._bus.inject(request.target, request.fault)
            else:
                self._bus.clear(request.target or None)
        except ValueError as error:
            response.message = str(error)
        response.success = not response.message
        return response


class FramePacer(WorldClockPacer):
    """Begins a cycle with the world's clock; tells the drives' node when it has ended.

    That node has seen the cycle's frame before. But what comes after a tick, a request of a new
    mode say, must find the tick's joints told, so in lockstep the world goes on only then.
    """

    def __init__(self, node: LifecycleNode, cycle: BridgeCycle, bus: Bus):
        """Subscribe to the clock."""
        super().__init__(node, cycle)
        self._end = CycleEnd()
        self._ends = node.create_publisher(CycleEnd, graph.CYCLE_END, qos.CONTROL_OFFERED)

    def _say_again(self) -> None:
        self._ends.publish(self._end)

    def cycle_ended(self, time_ns: int) -> None:
        """Tell the drives' node."""
        if time_ns < 0:
            return  # the world has not spoken yet
        stamps.fill(self._end.stamp, time_ns)
        stamps.fill(self._end.imu_stamp, self._cycle.imu_stamp_ns)
        self._ends.publish(self._end)
