"""Calls of services from any thread: a node's own thread makes them and passes the answers on."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import rclpy.task
from rclpy.client import Client
from rclpy.node import Node

from husky_runtime.nodes.one_clock import longest_look
from husky_runtime.patient_clock import PatientClock


class CallError(RuntimeError):
    """A service has not answered; says which and why."""


@dataclass(slots=True, eq=False)
class _Call:
    """A request that is on its way.

    Attributes:
        name: of the service.
        kind: class of the service.
        request: what is asked.
        until: time of the calls' clock at which nobody waits for it any longer [s].
        answer: for who asks.
        sent: what rclpy answers with, None before it has been sent.
    """

    name: str
    kind: Any
    request: Any
    until: float
    answer: Future[Any] = field(default_factory=Future)
    sent: rclpy.task.Future | None = None


class ServiceCalls:
    """Calls services for other threads.

    The node's thread calls `serve` whenever it wakes, one of the node's `hot_wires`.
    """

    def __init__(self, node: Node, wake: Callable[[], None], patience: float, most: int = 64):
        """Ask nothing yet.

        Args:
            node: that calls.
            wake: lets the node's thread call `serve`.
            patience: wall time in which a service has to come up and answer [s].
            most: calls at once.
        """
        self._node, self._wake = node, wake
        self._patience, self._most = patience, most
        self._lock = threading.Lock()
        self._clock = PatientClock(longest_look(node))  # under the lock
        self._under_way: list[_Call] = []
        self._clients: dict[tuple[str, Any], Client] = {}
        self._closed = False

    def call(self, name: str, kind: Any, request: Any) -> Future[Any]:
        """Call a service; the answer is there, or a `CallError`, when its time is over.

        Args:
            name: full name of the service.
            kind: class of the service.
            request: what to ask.
        """
        with self._lock:
            call = _Call(name, kind, request, self._now() + self._patience)
            if self._closed:
                _fail(call, "the node ends")
            elif len(self._under_way) >= self._most:
                _fail(call, f"{self._most} calls are under way already")
            else:
                self._under_way.append(call)
        self._wake()
        return call.answer

    # The node's thread ----------------------------------------------------------------------
    def meet(self, name: str, kind: Any) -> None:
        """Have a client for a service: who calls the first time need not wait for discovery."""
        if (name, kind) not in self._clients:
            self._clients[name, kind] = self._node.create_client(kind, name)

    def part(self, name: str) -> None:
        """Have no client for a service any more: for tools it would still be there."""
        for key in [key for key in self._clients if key[0] == name]:
            self._node.destroy_client(self._clients.pop(key))

    def serve(self) -> bool:
        """Send what has been asked since, give up what has taken too long; return whether any."""
        if not self._under_way:
            return False
        with self._lock:
            calls, now = list(self._under_way), self._now()
        over = [call for call in calls if self._is_over(call, now)]
        with self._lock:
            self._under_way = [call for call in self._under_way if call not in over]
        return bool(over)

    def close(self) -> None:
        """Let nobody wait any longer."""
        with self._lock:
            self._closed = True
            calls, self._under_way = self._under_way, []
        for call in calls:
            if not call.answer.done():
                _fail(call, "the node ends")

    def _now(self) -> float:
        return self._clock.read(time.monotonic())

    def _is_over(self, call: _Call, now: float) -> bool:
        if call.answer.done():
            return True
        self.meet(call.name, call.kind)
        client = self._clients[call.name, call.kind]
        if call.sent is None and client.service_is_ready():
            call.sent = client.call_async(call.request)
            call.sent.add_done_callback(partial(_settle, call))
        if now < call.until:
            return False
        if call.sent is not None:
            client.remove_pending_request(call.sent)
        _fail(call, "has not answered in time" if call.sent is not None else "is not there")
        return True


def _settle(call: _Call, sent: rclpy.task.Future) -> None:
    if not call.answer.done():
        call.answer.set_result(sent.result())


def _fail(call: _Call, why: str) -> None:
    call.answer.set_exception(CallError(f"{call.name}: {why}"))
