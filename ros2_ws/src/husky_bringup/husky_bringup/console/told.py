"""JSON for operators' pages: state of the robot, and requests that it may take."""

from __future__ import annotations

from typing import Any

from husky_bringup.console.panels import drives_in_words, fans_in_words
from husky_bringup.robot_state import RIGHTING, Known, judge
from husky_bringup.teleop_mapping import Action
from husky_msgs.msg import PropulsionState

_MEANINGS = {
    Action.STAND_UP: "enables the joints if need be, then stands up",
    Action.RECOVER: "resets the joints' faults and the emergency stop; mode passive",
    Action.RIGHTING: "turns onto its feet",
    Action.RESET_SIMULATION: "puts the simulated world back to its start",
}
_ALWAYS_THERE = (Action.EMERGENCY_STOP, Action.CUT)
"""Actions with a button of their own."""


def tell(known: Known, fans: PropulsionState | None) -> dict[str, Any]:
    """Return what pages are told, as JSON has it.

    Args:
        known: of the robot.
        fans: theirs, None for a robot that has told of none.
    """
    robot, table = judge(known), known.table
    told: dict[str, Any] = {
        "kind": robot.kind.value,
        "title": robot.title,
        "next": robot.next_step,
        "press": robot.press.value if robot.press is not None else "",
        "obstacle": robot.obstacle,
        "mode": "",
        "why": "",
        "actions": [
            {"name": action.value, **_possibility(action, known)}
            for action in Action
            if action not in _ALWAYS_THERE
            and (action is not Action.RESET_SIMULATION or known.is_simulated)
        ],
        "modes": [
            {"name": mode.name, "meaning": mode.meaning, "possible": mode.name in known.requests}
            for mode in table.modes
        ],
        "gaits": list(table.gaits),
    }
    if known.state is not None and not known.is_silent:
        state = known.state
        told |= {"mode": state.mode, "why": state.reason, "gait": state.gait}
    if known.drives is not None:
        told["drives"] = drives_in_words(known.drives)
    if fans is not None:
        told["fans"] = fans_in_words(fans)
    return told


def _possibility(action: Action, known: Known) -> dict[str, Any]:
    """Return whether a button is lit, and what it means or why it is not."""
    meaning = _MEANINGS.get(action, "")
    if action is Action.RIGHTING and not known.has_righting:
        return {"possible": False, "meaning": f"this robot has no mode {RIGHTING}"}
    if action is Action.RIGHTING and RIGHTING not in known.requests:
        return {"possible": False, "meaning": f"{meaning}: not in this mode"}
    return {"possible": True, "meaning": meaning}
