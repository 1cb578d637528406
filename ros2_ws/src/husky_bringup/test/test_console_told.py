"""JSON for operators' pages: the buttons, and which of them are lit."""

from __future__ import annotations

import pytest

pytest.importorskip("viser")

from husky_bringup.console.told import tell
from husky_bringup.robot_state import RIGHTING, Known
from husky_msgs.msg import ControllerMode, ControllerState, ModeTable


@pytest.mark.parametrize(
    ("mode", "requests", "lit", "meaning"),
    [
        ("passive", {"passive": ["stand_up"]}, False, "this robot has no mode righting"),
        ("stand", {"stand": [], RIGHTING: []}, False, "turns onto its feet: not in this mode"),
        ("passive", {"passive": [RIGHTING], RIGHTING: []}, True, "turns onto its feet"),
    ],
)
def test_righting_is_lit_where_the_robot_can(
    mode: str, requests: dict[str, list[str]], lit: bool, meaning: str
) -> None:
    modes = [ControllerMode(name=name, requests=may) for name, may in requests.items()]
    known = Known(ControllerState(mode=mode), None, ModeTable(modes=modes), 0.0, False)
    [righting] = [each for each in tell(known, None)["actions"] if each["name"] == "right itself"]
    assert (righting["possible"], righting["meaning"]) == (lit, meaning)


@pytest.mark.parametrize("simulated", [True, False])
def test_a_world_is_reset_where_there_is_one(simulated: bool) -> None:
    told = tell(Known(None, None, ModeTable(), 9.0, simulated), None)
    names = [action["name"] for action in told["actions"]]
    assert ("reset simulation" in names) == simulated
    assert "cut" not in names and "emergency stop" not in names and "recover" in names
    assert told["kind"] == "silent" and told["modes"] == []
