"""Twelve simulated drives: 10 kHz cycles per wall second."""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

from husky_bringup.settings import HelpFormatter
from husky_description.robot import load_robot
from husky_drivers.ethercat.axes import settings_of
from husky_drivers.ethercat.master import Master
from husky_drivers.joint_master.phase import Phase
from husky_runtime import graph
from husky_sim.devices.drives.motor import Servos, ServoTiming
from husky_sim.devices.drives.segment import SimulatedSegment


def bench(arguments: list[str]) -> dict[str, Any]:
    """Cycles of 12 drives simulated per wall second: master, frames, state machines, servo law."""
    parser = argparse.ArgumentParser(prog="scripts/bench.sh drives", formatter_class=HelpFormatter)
    parser.add_argument("--ticks", type=int, default=5000, help="control ticks in each round")
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args(arguments)
    robot = load_robot()
    timing = ServoTiming()
    servos = Servos(robot, timing)
    segment = SimulatedSegment(robot)
    master = Master(segment, settings_of(robot), robot)
    master.configure()
    master.start()
    stand, zero = robot.stand_joint_position.copy(), np.zeros(12)
    substeps = round(graph.TICK_PERIOD / timing.step)
    servos.update_state(stand)

    def tick() -> None:
        segment.set_servo_state(
            servos.encoder_count, servos.velocity_count, servos.current, servos.bus_voltage
        )
        master.exchange()
        master.set_command(8, stand, zero, zero)
        servo = segment.servo_command()
        servos.set_command(*(np.ascontiguousarray(servo[name]) for name in servo.dtype.names))
        for _ in range(substeps):
            servos.step(stand, zero)
        servos.update_state(stand)

    for _ in range(20):
        tick()
    master.enable()
    for _ in range(500):
        tick()
    if master.phase is not Phase.ENABLED:
        raise RuntimeError(f"the drives are not enabled: {master.reason}")
    rates = []
    for _ in range(options.rounds):
        start = time.perf_counter()
        for _ in range(options.ticks):
            tick()
        rates.append(options.ticks / (time.perf_counter() - start))
    cycles = float(np.median(rates)) * graph.TICK_PERIOD / robot.drive.cycle
    return {
        "drives": len(robot.joint_names),
        "cycles_per_s": cycles,
        "times_real_time": cycles * robot.drive.cycle,
        "us_per_tick": 1e6 / float(np.median(rates)),
    }
