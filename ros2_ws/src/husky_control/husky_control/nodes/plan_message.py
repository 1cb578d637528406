"""Plans as messages and back."""

from __future__ import annotations

from dataclasses import astuple
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Quaternion, Vector3
from scipy.spatial.transform import Rotation

from husky_control.planning.plan import NUMBERS, MeshError, Plan
from husky_description.arrays import Array
from husky_msgs.msg import InclinePlan, InclinePlanPoint

_SAME = (*NUMBERS, "thrust_mode", "gait")
"""Fields that plan and message have alike."""
_VECTORS = (
    "velocity",
    "angular_velocity",
    "acceleration",
    "angular_acceleration",
    "thrust",
)


def to_message(plan: Plan, stamp: Time) -> InclinePlan:
    """The message of a plan."""
    message = InclinePlan(stamp=stamp)
    for name in _SAME:
        setattr(message, name, getattr(plan, name))
    message.touchdown_phase = plan.touchdown_phase
    message.center_of_mass = _as(Point, plan.center_of_mass)
    message.foothold = [_as(Point, foothold) for foothold in plan.foothold]
    message.mesh_error = np.array(astuple(plan.mesh_error))
    message.points = [_plan_point(plan, k) for k in range(len(plan.time))]
    return message


def from_message(message: InclinePlan) -> Plan:
    """The plan of a message.

    Raises:
        ValueError: the message holds no plan; says which field is wrong.
    """
    points = message.points
    quaternions = [
        (p.orientation.x, p.orientation.y, p.orientation.z, p.orientation.w) for p in points
    ]
    fields: dict[str, Any] = {name: getattr(message, name) for name in _SAME}
    for name in _VECTORS:
        fields[name] = np.array([_array(getattr(point, name)) for point in points])
    return Plan(
        **fields,
        touchdown_phase=np.array(message.touchdown_phase),
        center_of_mass=_array(message.center_of_mass),
        foothold=np.array([_array(foothold) for foothold in message.foothold]),
        mesh_error=MeshError(*(float(value) for value in message.mesh_error)),
        time=np.array([point.time for point in points]),
        position=np.array([_array(point.position) for point in points]),
        rotation=Rotation.from_quat(quaternions).as_matrix() if points else np.zeros((0, 3, 3)),
        foot_force=np.array([[_array(force) for force in p.foot_force] for p in points]),
        stance=np.array([point.stance for point in points], dtype=np.bool_),
    )


def _plan_point(plan: Plan, k: int) -> InclinePlanPoint:
    x, y, z, w = Rotation.from_matrix(plan.rotation[k]).as_quat().tolist()
    point = InclinePlanPoint(
        time=float(plan.time[k]),
        position=_as(Point, plan.position[k]),
        orientation=Quaternion(x=x, y=y, z=z, w=w),
        foot_force=[_as(Vector3, force) for force in plan.foot_force[k]],
        stance=plan.stance[k].tolist(),
    )
    for name in _VECTORS:
        setattr(point, name, _as(Vector3, getattr(plan, name)[k]))
    return point


def _as(kind: Any, values: Array) -> Any:
    x, y, z = values.tolist()
    return kind(x=x, y=y, z=z)


def _array(vector: Any) -> Array:
    return np.array([vector.x, vector.y, vector.z])
