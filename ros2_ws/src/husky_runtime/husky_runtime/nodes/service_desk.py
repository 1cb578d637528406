"""Requests in, answers out: each request gets one, and none ends the node."""

from __future__ import annotations

import contextlib
import time
import warnings
from collections.abc import Callable
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.service import Service

from husky_runtime.nodes.message_guard import MessageGuard
from husky_runtime.nodes.message_rules import Check, make_check

_ANSWER_AGAIN = (0.2, 0.5, 1.0, 2.0, 4.0)
"""Waits between the tries to answer a client that is not yet known here [s]."""


class Deferred:
    """What a service's callback returns when it cannot answer yet: the node hears others meanwhile.

    Attributes:
        response: the answer, to be filled before `complete`.
    """

    def __init__(self, response: Any):
        """Keep the response that the callback was given."""
        self.response = response
        self._done = False
        self._send: Callable[[Any], None] | None = None

    def complete(self) -> None:
        """Give the answer, once; a client that has gone does not matter."""
        if self._done:
            return
        self._done = True
        if self._send is not None:
            self._send(self.response)

    def when_complete(self, send: Callable[[Any], None]) -> None:
        """Say how the answer is sent: at once if it is complete already."""
        self._send = send
        if self._done:
            send(self.response)


class ServiceDesk:
    """Serves the services of a node.

    A request may come before discovery has told where its answer goes: then rmw_fastrtps waits
    0.1 s, gives up with a warning and the client waits for ever. Such an answer is sent again.

    Attributes:
        guard: what refuses requests.
    """

    def __init__(self, guard: MessageGuard):
        """Nothing has been asked yet."""
        self.guard = guard
        self._checks: dict[type, Check] = {}
        self._late: list[tuple[float, int, Service, Any, Any]] = []

    def serve(self, service: Service) -> None:
        """Answer one request, if there is one."""
        types: Any = service.srv_type
        kind = types.Request
        request, header = service.handle.service_take_request(kind)
        if header is None:
            return
        if kind not in self._checks:
            self._checks[kind] = make_check(kind)
        name = service.service_name
        self._send(service, self.guard.answer(self._checks[kind], name, service, request), header)

    def _send(self, service: Service, response: Any, header: Any, tries: int = 0) -> None:
        """Send an answer, when it is complete, and keep it if its client is not known yet."""
        if isinstance(response, Deferred):
            response.when_complete(lambda complete: self._send(service, complete, header))
            return
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            service.send_response(response, header)
        if caught and tries < len(_ANSWER_AGAIN):
            due = time.monotonic() + _ANSWER_AGAIN[tries]
            self._late.append((due, tries + 1, service, response, header))
        elif caught:
            message = f"{service.service_name}: {caught[-1].message}"
            warnings.warn(message, RuntimeWarning, stacklevel=2)

    def send_again(self) -> None:
        """Send what is due, once more."""
        if not self._late:
            return
        now = time.monotonic()
        due = [late for late in self._late if late[0] <= now]
        self._late = [late for late in self._late if late[0] > now]
        for _, tries, service, response, header in due:
            with contextlib.suppress(InvalidHandle):  # The service has gone meanwhile.
                self._send(service, response, header, tries)
