"""Requests in, answers out: each request gets one, and none ends the node."""

from __future__ import annotations

import contextlib
import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

from rcl_interfaces.msg import Parameter, SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.exceptions import InvalidHandle
from rclpy.service import Service

from husky_runtime.nodes.message_guard import MessageGuard
from husky_runtime.nodes.message_rules import MOST_PARAMETERS, Check, make_check

_AT_A_TIME = 16
"""Parameters that are set in one go: of the controller a third of a tick."""
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

    Parameters are set each by itself, as `SetParameters` means it, and of many some at a time:
    ticks come between them.

    Attributes:
        guard: what refuses requests.
    """

    def __init__(self, guard: MessageGuard):
        """Nothing has been asked yet."""
        self.guard = guard
        self._checks: dict[type, Check] = {}
        self._late: list[tuple[float, int, Service, Any, Any]] = []
        self._setting: dict[Service, Iterator[None]] = {}

    def serve(self, service: Service) -> None:
        """Answer one request, if there is one, or go on with one that takes long."""
        if service in self._setting:
            self._go_on(service)
            return
        types: Any = service.srv_type
        kind = types.Request
        request, header = service.handle.service_take_request(kind)
        if header is None:
            return
        if kind not in self._checks:
            self._checks[kind] = make_check(kind)
        if kind is SetParameters.Request and len(request.parameters) <= MOST_PARAMETERS:
            self._setting[service] = self._set(service, request.parameters, header)
            self._go_on(service)
            return
        self._send(service, self._answer(service, request), header)

    @property
    def busy(self) -> bool:
        """Whether there is a request to go on with."""
        return bool(self._setting)

    def _answer(self, service: Service, request: Any) -> Any:
        check = self._checks[type(request)]
        return self.guard.answer(check, service.service_name, service, request)

    def _go_on(self, service: Service) -> None:
        for _ in self._setting[service]:
            return  # the next ones later
        del self._setting[service]

    def _set(self, service: Service, parameters: list[Parameter], header: Any) -> Iterator[None]:
        """Set parameters, some at a time, each or not, and answer when all are done."""
        results: list[SetParametersResult] = []
        for number, parameter in enumerate(parameters):
            if number > 0 and number % _AT_A_TIME == 0:
                yield
            one = SetParameters.Request(parameters=[parameter])
            results += self._answer(service, one).results
        self._send(service, SetParameters.Response(results=results), header)

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
