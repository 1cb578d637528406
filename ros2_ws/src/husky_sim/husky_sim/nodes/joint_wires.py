"""The wires of the joints, whichever the robot has: drives behind a bridge, or servos on a bus."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from husky_runtime import graph
from husky_runtime.nodes.parameters import declare
from husky_sim.devices.bus_servos.motors import BusServoMotors
from husky_sim.nodes.answered_wire import JointWires
from husky_sim.nodes.drive_wires import DriveWires
from husky_sim.nodes.servo_bus_wires import ServoBusWires
from husky_sim.nodes.world_clock import ImuLatency, WorldClock
from husky_sim.world import World


def open_joint_wires(
    node: Node,
    world: World,
    grace: float,
    clock: WorldClock,
    latency: ImuLatency,
    advance: Callable[[], None],
) -> JointWires:
    """Return the wires of the joints of a world's robot.

    Args:
        node: the plant.
        world: with its robot's joints, or none.
        grace: wall time that a silent peer is waited for [s].
        clock: tells the world's time.
        latency: is told of commands that stand on an IMU sample.
        advance: called when the state of now has been answered.
    """
    what = "EtherCAT bus of the drives; soem: drive_segment answers it, and each tick is told"
    bus = declare(node, "bus", graph.BUSES[0], what, allowed=graph.BUSES)
    if isinstance(world.servos, BusServoMotors):
        return ServoBusWires(node, world, world.servos, grace, clock, advance)
    if bus == graph.BUSES[0]:
        return DriveWires(node, world, world.servos, grace, latency, advance)
    return DriveWires(node, world, world.servos, grace, latency, advance, clock)
