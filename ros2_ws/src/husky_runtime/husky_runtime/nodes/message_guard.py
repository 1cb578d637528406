"""The door of a node: every message and every request comes in here, or is refused and counted."""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Callable, Sized
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from husky_runtime.nodes.message_rules import Check, make_check, most_bytes

_REASON = 200
"""Characters of a reason that are told."""
_ANSWERS = 256
"""Parameters of one request that get a no each."""


class Refused(ValueError):
    """Raised in the callback of a message that is not acted on; says why."""


class MessageGuard:
    """Checks what comes to a node, counts and tells what it refuses.

    A callback that fails is a defect of ours, not of who has sent the message: its traceback is in
    the log. Still the node goes on; where its answer is missed, watchdogs act.

    Attributes:
        refused: messages and requests that were not let in or not acted on, by topic or service.
        failures: callbacks that have failed.
        last: the last of both, and why.
    """

    def __init__(self, node: Node):
        """Nothing has come yet."""
        self.refused: Counter[str] = Counter()
        self.failures = 0
        self.last = ""
        self._logger = node.get_logger()

    def taker(
        self, handle: Any, topic: str, message_type: type, *, raw: bool
    ) -> Callable[[], Any]:
        """Return what takes the next message and its info out of a queue, None when it is empty.

        A list of a million texts takes longer to be made than the tick that it would hold up, so
        what may be long comes as bytes, which are counted first.
        """
        take, most = handle.take_message, most_bytes(message_type)
        if raw or most is None:
            return lambda: take(message_type, raw)

        def take_bounded() -> Any:
            while (taken := take(message_type, True)) is not None:
                data, info = taken
                if len(data) > most:
                    self.refuse(topic, f"{len(data)} bytes, {most} are allowed")
                    continue
                try:
                    return deserialize_message(data, message_type), info
                except RuntimeError:
                    self.refuse(topic, f"{len(data)} bytes are no {message_type.__name__}")
            return None

        return take_bounded

    def guarded(
        self, callback: Callable[[Any], object], topic: str, message_type: type, *, raw: bool
    ) -> Callable[[Any], None]:
        """Return a callback that lets in what the rules of its kind allow.

        Args:
            callback: acts on a message; may raise `Refused`.
            topic: for reports.
            message_type: of the messages.
            raw: it gets bytes, which it checks itself.
        """
        check = None if raw else make_check(message_type)

        def enter(message: Any) -> None:
            reason = check(message) if check is not None else ""
            if reason:
                self.refuse(topic, reason)
                return
            try:
                callback(message)
            except Refused as refusal:
                self.refuse(topic, str(refusal))
            except ExternalShutdownException:
                raise
            except Exception as error:
                self.fail(topic, error)

        return enter

    def run(self, name: str, step: Callable[[], object]) -> None:
        """Run a step of something that others ask for, an action; it ends no node either."""
        try:
            step()
        except ExternalShutdownException:
            raise
        except Exception as error:
            self.fail(name, error)

    def answer(self, check: Check, name: str, service: Any, request: Any) -> Any:
        """Return the answer to a request: the service's, or a no.

        Args:
            check: of its kind of requests.
            name: of the service.
            service: with its callback and types.
            request: what is asked for.
        """
        response = service.srv_type.Response()
        reason = check(request)
        if reason:
            self.refuse(name, reason)
            return refusal(request, response, reason)
        try:
            return service.callback(request, response)
        except ExternalShutdownException:
            raise
        except Exception as error:
            # rclpy raises where a request names what is not there: a type, a transition.
            reason = f"{type(error).__name__}: {error}"[:_REASON]
            self.refuse(name, reason)
            return refusal(request, service.srv_type.Response(), reason)

    def refuse(self, topic: str, reason: str) -> None:
        """Count and tell what is not let in."""
        reason = reason[:_REASON]
        self.refused[topic] += 1
        self.last = f"{topic}: {reason}"
        self._logger.warning(f"refused on {topic}: {reason}", throttle_duration_sec=1.0)

    def fail(self, topic: str, error: Exception) -> None:
        """Count and tell what should not have happened."""
        self.failures += 1
        self.last = f"{topic}: {type(error).__name__}: {error}"[:_REASON]
        told = "".join(traceback.format_exception(error))
        self._logger.error(f"{topic}: its callback has failed\n{told}", throttle_duration_sec=1.0)


def check_count(field: str, values: Sized, count: int) -> None:
    """Refuse a message, in its own callback, whose list is not as long as this robot's.

    Raises:
        Refused: it is not.
    """
    if len(values) != count:
        raise Refused(f"{field} holds {len(values)} values, it must be {count}")


def refuser(node: Node, topic: str) -> Callable[[str], None]:
    """Return what tells a node's guard that a message on a topic is not acted on, and why.

    For one that is found wrong only later; in its own callback raise `Refused`.
    """
    topic = node.resolve_topic_name(topic)

    def refuse(reason: str) -> None:
        guard = getattr(node.executor, "guard", None)
        if guard is not None:
            guard.refuse(topic, reason)

    return refuse


def refusal(request: Any, response: Any, reason: str) -> Any:
    """Write a no into an empty answer, in the words of its kind, and return it."""
    if hasattr(response, "results") and hasattr(request, "parameters"):  # SetParameters
        no = SetParametersResult(successful=False, reason=reason)
        response.results = [no] * min(len(request.parameters), _ANSWERS)
    elif hasattr(response, "result") and hasattr(response.result, "successful"):
        response.result.successful, response.result.reason = False, reason
    if hasattr(response, "success"):
        response.success = False
    if hasattr(response, "message"):
        response.message = reason
    return response
