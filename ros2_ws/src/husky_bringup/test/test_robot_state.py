"""The robot's state for its operator: a word, the next step, why a stick moves nothing."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

pytest.importorskip("husky_msgs")

from scipy.spatial.transform import Rotation

from husky_bringup.outcome import Outcome
from husky_bringup.robot_state import FALLEN, SILENT, Kind, Known, judge, tilt
from husky_bringup.teleop_mapping import Action
from husky_msgs.msg import (
    ControllerMode,
    ControllerState,
    DriveStatus,
    DriveStatusArray,
    ModeTable,
)

REQUESTS = {
    "passive": ["stand_up", "damping"],
    "stand_up": ["sit"],
    "fly": ["stand", "emergency_stop"],
    "quadrotor": ["splay"],
    "splay": ["perch", "quadrotor", "damping"],
    "leap": [],
}
RIGHTING = {**REQUESTS, "passive": ["stand_up", "righting"], "righting": ["damping"]}
FAULT = DriveStatusArray(drives=[DriveStatus(), DriveStatus(error_code=0x2310)])
STOP = DriveStatusArray(emergency_stop=True)
BACK = [1.0, 0.0, 0.0, 0.0]


def known(
    mode: str = "stand",
    *,
    orientation: list[float] | None = None,
    drives: DriveStatusArray | None = None,
    silence: float = 0.02,
    simulated: bool = False,
    requests: dict[str, list[str]] = REQUESTS,
) -> Known:
    state = ControllerState(mode=mode, orientation=orientation or [0.0, 0.0, 0.0, 1.0])
    modes = [ControllerMode(name=name, requests=may) for name, may in requests.items()]
    return Known(state, drives, ModeTable(modes=modes), silence, simulated)


@pytest.mark.parametrize(
    ("of", "kind", "step", "press", "obstacle"),
    [
        ({"mode": "passive"}, Kind.LYING, "press Stand up", Action.STAND_UP, "it lies"),
        ({"mode": "sit"}, Kind.LYING, "press Stand up", Action.STAND_UP, "it lies"),
        ({"mode": "stand"}, Kind.STANDING, "hold a stick", None, ""),
        ({"mode": "walk"}, Kind.WALKING, "let go", Action.STOP, ""),
        ({"mode": "damping"}, Kind.STOPPED, "press Recover", Action.RECOVER, "it is stopped"),
        ({"mode": "emergency_stop"}, Kind.STOPPED, "press Recover", Action.RECOVER, "stopped"),
        ({"mode": "settle"}, Kind.STOPPED, "wait until its body is down", None, "settle"),
        ({"mode": "passive", "drives": STOP}, Kind.STOPPED, "press Recover", Action.RECOVER, "st"),
        ({"mode": "passive", "drives": FAULT}, Kind.STOPPED, "press Recover", Action.RECOVER, "st"),
        ({"mode": "fly"}, Kind.FLYING, "choose mode stand to land", None, "it flies in mode fly"),
        ({"mode": "quadrotor"}, Kind.FLYING, "choose mode splay to land", None, ""),
        ({"mode": "quadrotor", "drives": FAULT}, Kind.FLYING, "splay to land", None, "its joints"),
        ({"mode": "leap"}, Kind.FLYING, "wait until it has landed", None, "it flies"),
        ({"mode": "stand_up"}, Kind.OTHER, "wait until it stands", None, "it is in mode stand up"),
        ({"mode": "splay"}, Kind.OTHER, "choose mode perch or quadrotor", None, "mode splay"),
        ({"mode": "a_new_one"}, Kind.OTHER, "wait", None, "it is in mode a new one"),
        ({"silence": 12.4}, Kind.SILENT, "no word from the controller for 12 s", None, "12 s"),
    ],
)
def test_states(
    of: dict[str, Any], kind: Kind, step: str, press: Action | None, obstacle: str
) -> None:
    state = judge(known(**of))
    assert (state.kind, state.press) == (kind, press)
    assert step in state.next_step
    assert obstacle in state.obstacle and bool(state.obstacle) == bool(obstacle)


@pytest.mark.parametrize(
    ("of", "step", "press"),
    [
        ({}, "turn it over by hand, then press Recover", Action.RECOVER),
        ({"simulated": True}, "press Reset simulation", Action.RESET_SIMULATION),
        ({"requests": RIGHTING}, "press Right itself", Action.RIGHTING),
        (
            {"requests": RIGHTING, "mode": "damping", "simulated": True},
            "press Recover, then Right itself (or Reset simulation)",
            Action.RECOVER,
        ),
        (
            {"requests": RIGHTING, "drives": STOP},
            "press Recover, then Right itself",
            Action.RECOVER,
        ),
    ],
)
def test_the_way_up_of_a_robot_that_has_fallen(
    of: dict[str, Any], step: str, press: Action
) -> None:
    state = judge(known(**{"mode": "passive", "orientation": BACK, **of}))
    assert (state.kind, state.next_step, state.press) == (Kind.FALLEN, step, press)


def test_tilted_is_fallen_only_where_the_legs_do_not_carry_it() -> None:
    """It walks up walls, too; and a controller that has not measured yet tells of no rotation."""
    for mode, kind in (("wair", Kind.WALKING), ("righting", Kind.OTHER), ("fly", Kind.FLYING)):
        assert judge(known(mode, orientation=BACK, requests=RIGHTING)).kind is kind
    assert judge(known("passive", orientation=[0.0] * 4)).kind is Kind.LYING
    assert judge(known("passive", orientation=[math.nan] * 4)).kind is Kind.LYING


def test_a_robot_that_has_never_spoken() -> None:
    for silence, kind in ((0.1, Kind.OTHER), (SILENT + 0.1, Kind.SILENT)):
        state = judge(Known(None, None, ModeTable(), silence, False))
        assert state.kind is kind and state.obstacle


@given(arrays.arrays(float, 4, elements=st.floats(-1.0, 1.0)))
def test_tilt_is_the_angle_of_the_vertical_axis(quaternion: Any) -> None:
    norm = float(quaternion @ quaternion)
    if 0.6 < norm < 1.9:
        up = Rotation.from_quat(quaternion).apply([0.0, 0.0, 1.0])[2]
        assert math.cos(tilt(quaternion.tolist())) == pytest.approx(up, abs=1e-9)


def test_fallen_is_what_the_controller_refuses_to_stand_up_from() -> None:
    from husky_control.parameters import TABLE

    assert TABLE["safety.max_tilt"].default == FALLEN


# Outcomes -----------------------------------------------------------------------------------------
def test_an_outcome_is_told_part_by_part() -> None:
    outcome = Outcome()
    outcome.wait("enable drives")
    assert (outcome.text, outcome.time, outcome.refused) == ("enable drives ...", "", False)
    outcome.finish("enable drives")
    outcome.refuse("stand up", "stand up: refused, no")
    assert outcome.text == "enable drives: done; stand up: refused, no" and outcome.refused
    assert len(outcome.time) == len("12:34:56")
    outcome.clear()
    outcome.finish("walk")
    assert outcome.text == "walk: done" and not outcome.refused
