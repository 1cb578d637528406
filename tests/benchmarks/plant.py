"""The plant's own loop against bare `mj_step` on the same model."""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

from husky_bringup.settings import HelpFormatter
from husky_description.plain_mujoco import mujoco
from husky_description.robot import load_robot
from husky_drivers.vn200.imu import ImuFigures
from husky_runtime import graph
from husky_sim.devices.drives.servo_law import POSITION
from husky_sim.devices.vn200.device import Vn200Device
from husky_sim.world import World, WorldOptions


def bench(arguments: list[str]) -> dict[str, Any]:
    """Physics steps per second in the plant's loop over bare mj_step, standing."""
    parser = argparse.ArgumentParser(prog="scripts/bench.sh plant", formatter_class=HelpFormatter)
    parser.add_argument("--rounds", type=int, default=15, help="of both, in turn")
    parser.add_argument("--ticks", type=int, default=500, help="in each round")
    options = parser.parse_args(arguments)
    robot = load_robot()
    world = World(robot, WorldOptions(keyframe="stand"))
    device = Vn200Device(ImuFigures.of(robot.imu))
    stand = world.joint_position.copy()
    kp, kd = np.full(12, robot.servo.kp), np.full(12, robot.servo.kd)
    kind, zero, limit = np.full(12, POSITION, np.uint8), np.zeros(12), np.full(12, 10.0)

    def tick() -> None:
        """What the node does in a tick, short of its messages."""
        world.servos.set_command(kind, stand, zero, zero, kp, kd, limit)
        for sample in world.step_tick():
            device.sample(
                sample.time_ns, sample.orientation, sample.angular_velocity, sample.specific_force
            )
        device.take_output()

    for _ in range(1000):
        tick()
    bare = mujoco.MjData(world.model)
    substeps = round(graph.TICK_PERIOD / world.model.opt.timestep)
    ours, theirs = [], []
    for _ in range(options.rounds):
        start = time.perf_counter()
        for _ in range(options.ticks):
            tick()
        ours.append(options.ticks * substeps / (time.perf_counter() - start))
        # The same standing state and the same torques, held.
        mujoco.mj_copyData(bare, world.model, world.data)
        start = time.perf_counter()
        for _ in range(options.ticks * substeps):
            mujoco.mj_step(world.model, bare)
        theirs.append(options.ticks * substeps / (time.perf_counter() - start))
    ratios = np.array(ours) / np.array(theirs)
    return {
        "steps_per_s": float(np.median(ours)),
        "bare_steps_per_s": float(np.median(theirs)),
        "steps_over_bare": float(np.median(ratios)),
    }
