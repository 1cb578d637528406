"""A node that carries the robot stays active: who asks it to leave that state is refused.

A node may fail to deactivate and stays active; but a shutdown that fails ends it all the same. So
both are refused before the state machine hears of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode

from husky_runtime.nodes.parameters import declare

FORCE = "deactivate_under_load"
"""Parameter that forces it."""


def stay_active_under_load(node: LifecycleNode, load: Callable[[], str], when: str) -> None:
    """Have a node refuse requests to change its state while something hangs on it.

    Args:
        node: that is not active yet.
        load: tells what hangs on it now and what to do first, "" when nothing does.
        when: that is, in words, for the parameter's description.
    """
    what = f"deactivation and shutdown are not refused while {when}; the robot then drops"
    declare(node, FORCE, False, what, read_only=False)
    service: Any = next(each for each in node.services if each.srv_type is ChangeState)
    change = service.callback

    def answer(request: ChangeState.Request, response: ChangeState.Response) -> Any:
        reason = load()
        if not reason or node.get_parameter(FORCE).value:
            return change(request, response)
        node.get_logger().error(f"change of state refused: {reason}, or set {FORCE}")
        response.success = False
        return response

    service.callback = answer
