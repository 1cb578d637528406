"""A plan whose motion is known in closed form; for tests of what plans go through."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from husky_control.planning.plan import MeshError, Plan

POINTS = 12
PERIOD = 0.4
SPEED = 0.3


def motion(time: np.ndarray) -> dict[str, np.ndarray]:
    """A smooth body motion whose derivatives are known."""
    w = 2.0 * math.pi / PERIOD
    wave, slope, bend = np.cos(w * time), -w * np.sin(w * time), -(w**2) * np.cos(w * time)
    zero = np.zeros_like(time)
    turn = Rotation.from_rotvec(np.outer(0.1 * wave, [0.0, 1.0, 0.0]))
    return {
        "position": np.stack([SPEED * time, 0.01 * wave, 0.5 + 0.02 * wave], axis=1),
        "velocity": np.stack([SPEED + zero, 0.01 * slope, 0.02 * slope], axis=1),
        "acceleration": np.stack([zero, 0.01 * bend, 0.02 * bend], axis=1),
        "rotation": turn.as_matrix(),
        "angular_velocity": np.stack([zero, 0.1 * slope, zero], axis=1),
        "angular_acceleration": np.stack([zero, 0.1 * bend, zero], axis=1),
    }


def make_plan(points: int = POINTS, **changes: object) -> Plan:
    half = np.linspace(0.0, PERIOD / 2, points // 2 + 1)
    time = np.concatenate([half, PERIOD / 2 + half])
    first = np.arange(len(time)) < len(half)
    stance = np.where(first[:, None], [True, False, False, True], [False, True, True, False])
    force = np.zeros((len(time), 4, 3))
    force[..., 2] = 37.0 * stance
    fields: dict[str, object] = {
        "slope": 0.5,
        "speed": SPEED,
        "friction": 0.7,
        "friction_margin": 0.5,
        "thrust_mode": "vector",
        "gait": "trot",
        "period": PERIOD,
        "duty": 0.5,
        "touchdown_phase": np.array([0.0, 0.5, 0.5, 0.0]),
        "height": 0.5,
        "mass": 7.6,
        "thrust_limit": 76.0,
        "center_of_mass": np.array([-0.005, 0.0, -0.015]),
        "time": time,
        "foot_force": force,
        "thrust": np.stack([20.0 * time, 0.0 * time, 1.0 + time], axis=1),
        "stance": stance,
        "foothold": np.array(
            [[0.2, 0.1, 0.0], [0.26, -0.1, 0.0], [-0.14, 0.1, 0.0], [-0.2, -0.1, 0.0]]
        ),
        "mesh_error": MeshError(1e-6, 2e-6, 3e-6, 4e-6),
        "cost": 1.5,
        **motion(time),
        **changes,
    }
    return Plan(**fields)  # type: ignore[arg-type]
