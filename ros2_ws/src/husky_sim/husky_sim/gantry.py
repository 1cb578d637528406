"""The movable gantry of thesis T39: a beam on a trolley, and two ropes against operator error.

The trolley runs along x on a rail above everything; a position servo holds it where it is told to
be. From the ends of its beam, left and right, a rope goes down to each side of the propulsion
unit. A rope pulls when it is taut and never pushes: a one-sided limit of a spatial tendon.
"""

from __future__ import annotations

from husky_description.gantry import GantryOptions
from husky_description.plain_mujoco import mujoco

TROLLEY = "trolley"
"""Name of the trolley's body, joint and actuator."""
ROPES = ("rope_left", "rope_right")
"""Names of the two tendons."""
TROLLEY_SPEED = 0.25
"""[m/s]"""
RAIL = 4.0
"""The trolley's range on either side of the middle [m]."""
_STIFFNESS = 900.0
"""Stiffness of the trolley's position servo, critically damped [N/m]."""
_MASS = 20.0
"""Of trolley and beam; the thesis does not tell [kg]."""
_WIDTH = 0.012
"""Of a rope, for the eye only [m]."""


def add_gantry(spec: mujoco.MjSpec, options: GantryOptions) -> None:
    """Put a gantry over the body `base`; the trolley's joint and actuator come after the robot's.

    The trolley's actuator takes its position along x [m] as control.
    """
    trolley = spec.worldbody.add_body(name=TROLLEY, pos=[0.0, 0.0, options.height])
    trolley.add_joint(
        name=TROLLEY,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[1.0, 0.0, 0.0],
        range=[-RAIL, RAIL],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
    )
    trolley.explicitinertial = True
    trolley.mass = _MASS
    trolley.ipos = [0.0, 0.0, 0.0]  # given, or it is lost in the XML
    trolley.inertia = [_MASS * options.span**2 / 12.0, 0.1, _MASS * options.span**2 / 12.0]
    for name, size in (
        ("beam", [0.03, options.span / 2 + 0.05, 0.03]),
        ("carriage", [0.12, 0.06, 0.05]),
    ):
        trolley.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=size,
            rgba=[0.85, 0.65, 0.10, 1.0],
            contype=0,
            conaffinity=0,
            mass=0.0,
            group=2,
        )
    spec.worldbody.add_geom(
        name="rail",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[0.0, 0.0, options.height + 0.08],
        size=[RAIL, 0.02, 0.03],
        rgba=[0.55, 0.57, 0.60, 1.0],
        contype=0,
        conaffinity=0,
        group=2,
    )
    _add_ropes(spec, trolley, options)
    servo = spec.add_actuator(name=TROLLEY, target=TROLLEY, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.set_to_position(kp=_STIFFNESS, kv=2.0 * (_STIFFNESS * _MASS) ** 0.5)
    servo.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    servo.ctrlrange = [-RAIL, RAIL]
    for key in spec.keys:  # which know nothing of the trolley yet
        key.qpos = [*key.qpos, 0.0]
        key.ctrl = [*key.ctrl, 0.0]


def _add_ropes(spec: mujoco.MjSpec, trolley: mujoco.MjsBody, options: GantryOptions) -> None:
    """Hang the body in two ropes, each from an end of the beam."""
    base = spec.body("base")
    for name, side in zip(ROPES, (1.0, -1.0), strict=True):
        trolley.add_site(name=f"{name}_top", pos=[0.0, side * options.span / 2, 0.0], group=4)
        y, z = options.attachment
        base.add_site(name=f"{name}_end", pos=[0.0, side * y, z], group=4)
        rope = spec.add_tendon(
            name=name,
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            range=[0.0, options.rope],
            solref_limit=[0.02, 1.0],
            width=_WIDTH / 2,
            rgba=[0.15, 0.35, 0.75, 1.0],
        )
        rope.wrap_site(f"{name}_top")
        rope.wrap_site(f"{name}_end")


class Gantry:
    """Reads and moves the gantry of a compiled model."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, options: GantryOptions):
        """Find trolley and ropes."""
        self._data = data
        self._options = options
        self._tendons = [model.tendon(name).id for name in ROPES]
        self._actuator = model.actuator(TROLLEY).id
        self._target = 0.0

    def move_to(self, position: float) -> None:
        """Send the trolley along x [m], at `TROLLEY_SPEED`; raises ValueError beyond the rail."""
        if not abs(position) <= RAIL:
            raise ValueError(f"trolley is sent to {position} m, the rail is {RAIL} m either way")
        self._target = float(position)

    def advance(self, period: float) -> None:
        """Roll on towards that position at a person's pace, for so long [s]."""
        control, step = self._data.ctrl, TROLLEY_SPEED * period
        error = self._target - float(control[self._actuator])
        control[self._actuator] += min(step, max(-step, error))

    def taut(self) -> tuple[bool, bool]:
        """Return whether the left and the right rope pull."""
        left, right = (
            bool(self._data.ten_length[tendon] >= self._options.rope) for tendon in self._tendons
        )
        return left, right
