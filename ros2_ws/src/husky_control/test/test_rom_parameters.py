"""Numbers of the reduced-order model against Pinocchio, and what they refuse."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from husky_control.planning.rom_parameters import hips_in_base, rom_parameters
from husky_description.robot import load_robot
from husky_description.urdf import build_urdf

ROBOT = load_robot()
PARAMETERS = rom_parameters(ROBOT)


@pytest.mark.parametrize("payload", [None, 0.0, 2.5])
def test_mass_center_and_inertia_are_those_of_pinocchio(payload):
    """Of the standing robot's URDF; the parameters come from the MuJoCo model."""
    pin = pytest.importorskip("pinocchio")
    robot = ROBOT if payload is None else load_robot(payload_mass=payload)
    model = pin.buildModelFromXML(build_urdf(robot), pin.JointModelFreeFlyer())
    data, q = model.createData(), pin.neutral(model)
    for name, angle in zip(robot.joint_names, robot.stand_joint_position, strict=True):
        q[model.joints[model.getJointId(name)].idx_q] = angle
    pin.ccrba(model, data, q, np.zeros(model.nv))
    parameters = rom_parameters(robot)
    # The URDF is text: its numbers have some nine digits.
    assert parameters.mass == pytest.approx(pin.computeTotalMass(model), rel=1e-8)
    np.testing.assert_allclose(
        parameters.center_of_mass, pin.centerOfMass(model, data, q), atol=1e-8
    )
    np.testing.assert_allclose(parameters.inertia, data.Ig.inertia, atol=1e-7)


def test_inverse_of_the_mass_matrix():
    inverse = PARAMETERS.mass_matrix_inverse
    np.testing.assert_allclose(inverse[:3, :3] * PARAMETERS.mass, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(inverse[3:, 3:] @ PARAMETERS.inertia, np.eye(3), atol=1e-14)
    assert not inverse[:3, 3:].any() and not inverse[3:, :3].any()
    heavier = replace(PARAMETERS, mass=10.0)
    assert heavier.mass_matrix_inverse[0, 0] == pytest.approx(0.1)


def test_hips():
    np.testing.assert_allclose(
        hips_in_base(ROBOT), PARAMETERS.hip_position + PARAMETERS.center_of_mass, atol=1e-15
    )


def test_numbers_cannot_be_written_to():
    for array in (PARAMETERS.inertia, PARAMETERS.hip_position, PARAMETERS.gravity):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": 0.0}, "mass must be finite and > 0 kg, not 0.0"),
        ({"mass": np.nan}, "mass must be finite and > 0 kg, not nan"),
        ({"inertia": np.eye(2)}, r"inertia must be \(3, 3\) finite numbers"),
        ({"inertia": np.diag([1.0, 1.0, 3.0])}, "inertia has principal values"),
        ({"inertia": np.diag([-1.0, 1.0, 1.0])}, "inertia has principal values"),
        ({"inertia": np.eye(3) + np.diag([0.1], 2)}, "inertia must be symmetric"),
        ({"hip_position": np.zeros((2, 3))}, r"hip_position must be \(4, 3\) finite numbers"),
        ({"center_of_mass": [0.0, np.inf, 0.0]}, r"center_of_mass must be \(3,\) finite numbers"),
        ({"gravity": [0.0, 0.0]}, r"gravity must be \(3,\) finite numbers"),
        ({"gravity": ca.SX.zeros(2)}, r"gravity must have shape \(3, 1\)"),
    ],
)
def test_bad_numbers_are_named(change, message):
    if "inertia" in change and change["inertia"].shape == (3, 3):
        change = {"inertia": np.asarray(change["inertia"])}
    with pytest.raises(ValueError, match=message):
        replace(PARAMETERS, **change)
