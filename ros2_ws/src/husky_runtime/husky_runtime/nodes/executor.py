"""An executor for nodes that must turn a message round in tens of microseconds.

rclpy's own executors make a new wait set from every entity of the node at each spin, and waiting,
even for no time, costs a system call and the processor. Looking into a queue costs less than a
microsecond. So this one looks first and waits only when nothing is there: on a small wait set of
the *hot* subscriptions and timers while they are busy, on a full one when they have been quiet for
a while. The rest of the node is looked at every few messages.

Hot messages are served in the order in which they were received, whatever their topics: a command
that was sent before the tick it belongs to is seen before that tick, and one that was sent after
it, after, however long this process has had to wait for a processor meanwhile. Callbacks run one
at a time in the spinning thread, goals of actions beside it in threads of their own.

A node may list subscriptions as `unawaited`: they are served, but what comes there wakes nobody.
It may list `hot_wires` too: functions that carry what is on a wire and return whether there was
something, looked at together with the hot subscriptions. Who sees bytes come calls `end_wait`.

What comes in passes the node's `MessageGuard`: no message and no request ends a node.
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from husky_runtime.nodes.message_guard import MessageGuard
from husky_runtime.nodes.service_desk import ServiceDesk

_QUIET_NS = 2_000_000
"""Longest wait on hot entities before the rest of the node is looked at [ns]."""
_IDLE_AFTER = 25
"""Quiet waits in a row after which the full wait set is used."""
_IDLE_NS = 10_000_000
"""Longest wait on everything then [ns]: bounds how late a node looks at wires that wake nobody."""
_REST_EVERY = 16
"""Hot messages between two looks at the rest of the node."""
_POLL_NS = 50_000_000
"""Longest wait on everything [ns]: bounds the reaction to `stop`."""


class WaitSetExecutor:
    """Spins one node on wait sets made once; `guard` is its door and counts what it refuses."""

    def __init__(
        self,
        node: Node,
        hot: list[Subscription] | None = None,
        on_quiet: Callable[[], None] | None = None,
        hot_timers: list[Timer] | None = None,
        stop: threading.Event | None = None,
    ):
        """Take the node over.

        Args:
            node: the node to serve; its entities may change at any time.
            hot: subscriptions to look at first.
            on_quiet: called whenever hot entities have had nothing for 2 ms of wall time.
            hot_timers: timers to look at together with the hot subscriptions.
            stop: ends `spin` when set, from a signal handler or a callback.
        """
        self._node = node
        self._context = node.context
        self.guard = MessageGuard(node)
        self._waker = GuardCondition(None, None, context=self._context)
        self._stop = stop or threading.Event()
        self._hot = [HeldSubscription(sub, self.guard) for sub in hot or []]
        self._hot_timers = hot_timers or []
        self._wires: tuple[Callable[[], bool], ...] = tuple(getattr(node, "hot_wires", ()))
        self._hot_wait_set: Any = None
        self._on_quiet = on_quiet
        self._quiet_waits = 0
        self._served = 0
        self._desk = ServiceDesk(self.guard)
        self._rest: _Rest | None = None
        self._stale = True
        node.executor = self  # type: ignore[assignment]

    # What a node asks of its executor -------------------------------------------------------
    def add_node(self, node: Node) -> bool:
        """Accept the node that was given at construction."""
        return node is self._node

    def remove_node(self, node: Node) -> None:
        """Forget the entities: the node leaves."""
        self._stale = True

    def wake(self) -> None:
        """Look at the node's entities anew: they have changed."""
        self._stale = True
        self._waker.trigger()

    def create_task(self, callback: Callable[..., Any], *args: Any, **kwargs: Any) -> None:
        """Run a coroutine that takes long, an action's goal, in a thread of its own.

        The node goes on serving meanwhile; whoever starts a second one sees to it that they agree.
        """
        thread = threading.Thread(
            target=lambda: _finish(callback(*args, **kwargs)), name="task", daemon=True
        )
        thread.start()

    def end_wait(self) -> None:
        """End a wait, from any thread: something has come that is no message."""
        self._waker.trigger()

    # Spinning -------------------------------------------------------------------------------
    def spin(self) -> None:
        """Serve callbacks until `stop` is set or the context shuts down.

        Raises:
            ExternalShutdownException: always, at the end.
        """
        while True:
            self.spin_once()

    def spin_once(self) -> None:
        """Serve what is there, or wait a little for it."""
        if not (self._hot or self._hot_timers):
            self._look_whether_to_end()
            asked = self._look_at_rest().wait(_POLL_NS)
            self._serve_hot()  # a wire may carry an emergency stop
            self._look_at_rest().serve(asked=asked)
            return
        idle = self._quiet_waits > _IDLE_AFTER
        if idle:
            # It stays so until something hot comes.
            asked = self._look_at_rest().wait(_IDLE_NS)
            self._look_at_rest().serve(asked=asked)
        self._serve_hot_or_wait()
        if self._served >= _REST_EVERY or (self._quiet_waits > 0 and not idle):
            self._served = 0
            self._look_at_rest().serve()

    def drain_hot(self) -> None:
        """Serve what the hot subscriptions hold right now; a callback may call this."""
        while self._serve_hot():
            pass

    def spin_hot_until(self, done: Callable[[], bool]) -> None:
        """Serve only the hot entities until `done()`; a callback may call this."""
        while not done():
            self._serve_hot_or_wait()

    def _look_whether_to_end(self) -> None:
        if self._stop.is_set() or not self._context.ok():
            raise ExternalShutdownException()

    def _serve_hot_or_wait(self) -> None:
        self._look_whether_to_end()
        if self._serve_hot():
            self._quiet_waits = 0
        elif self._hot_wait_set is None:
            self._make_hot_wait_set()
        elif self._wait_hot():
            if self._serve_hot():
                self._quiet_waits = 0
        else:
            self._quiet_waits += 1
            if self._on_quiet is not None:
                self._on_quiet()

    def _serve_hot(self) -> bool:
        """Serve the hot message that came first, what is on wires, and the timers that are due.

        Returns:
            True for a message, or bytes on a wire: timers alone make no node busy.
        """
        served = False
        first = self._first()
        if first is not None:
            first.serve()
            self._served += 1
            served = True
        for wire in self._wires:
            if wire():
                self._served += 1
                served = True
        for timer in self._hot_timers:
            if _serve_timer(timer):
                self._served += 1
        return served

    def _first(self) -> HeldSubscription | None:
        """Return the hot subscription whose next message came before any other, None for none."""
        first = min(self._hot, key=HeldSubscription.received, default=None)
        if first is None or first.received() == math.inf:
            return None
        # What came before it is here by now, also where nothing was a moment ago.
        return min(self._hot, key=HeldSubscription.received)

    def _make_hot_wait_set(self) -> None:
        self._hot_wait_set = _rclpy.WaitSet(
            len(self._hot), 1, len(self._hot_timers), 0, 0, 0, self._context.handle
        )

    def _wait_hot(self) -> bool:
        """Wait for the hot entities; return whether something came."""
        wait_set = self._hot_wait_set
        wait_set.clear_entities()
        for hot in self._hot:
            wait_set.add_subscription(hot.handle)
        for timer in self._hot_timers:
            wait_set.add_timer(timer.handle)
        wait_set.add_guard_condition(self._waker.handle)
        wait_set.wait(_QUIET_NS)
        return bool(
            wait_set.get_ready_entities("subscription")
            or wait_set.get_ready_entities("timer")
            or (self._wires and wait_set.get_ready_entities("guard_condition"))
        )

    def _look_at_rest(self) -> _Rest:
        if self._stale or self._rest is None:
            self._stale = False
            if self._rest is not None:
                self._rest.close()
            self._rest = _Rest(self._node, self._waker, self._hot, self._hot_timers, self._desk)
        return self._rest

    def close(self) -> None:
        """Give every handle back."""
        if self._rest is not None:
            self._rest.close()
            self._rest = None
        for hot in self._hot:
            hot.close()
        self._hot = []


class HeldSubscription:
    """The parts of a subscription that a loop touches, looked up once."""

    def __init__(self, subscription: Subscription, guard: MessageGuard):
        """Hold a subscription, whose messages the guard lets in or refuses."""
        self.subscription = subscription
        self.handle = subscription.handle
        self.handle.__enter__()
        kind: Any = subscription.msg_type
        topic, raw = subscription.topic_name, subscription.raw
        self._take = guard.taker(self.handle, topic, kind, raw=raw)
        self.callback = guard.guarded(subscription.callback, topic, kind, raw=raw)
        self._next: Any = None

    def received(self) -> float:
        """Return when the next message came by this machine's clock [ns], infinity for none."""
        if self._next is None:
            self._next = self._take()
        # An integer as it is: as a float it would be rounded to a quarter of a microsecond.
        return math.inf if self._next is None else int(self._next[1]["received_timestamp"])

    def serve(self) -> None:
        """Serve the message that `received` has told of."""
        (message, _), self._next = self._next, None
        self.callback(message)

    def serve_all(self) -> None:
        """Serve every message that has come."""
        while self.received() < math.inf:
            self.serve()

    def close(self) -> None:
        """Give the handle back."""
        self.handle.__exit__(None, None, None)


class _Rest:
    """Every entity of a node; the hot ones are waited for but not served."""

    def __init__(
        self,
        node: Node,
        waker: GuardCondition,
        hot: list[HeldSubscription],
        hot_timers: list[Timer],
        desk: ServiceDesk,
    ):
        self._desk = desk
        self._stack = contextlib.ExitStack()
        subscriptions = [s for s in node.subscriptions if self._enter(s.handle)]
        unawaited = getattr(node, "unawaited", ())
        timers = [t for t in node.timers if self._enter(t.handle)]
        self._clients = [c for c in node.clients if self._enter(c.handle)]
        self._services = [s for s in node.services if self._enter(s.handle)]
        # Data wakes whoever waits for events of its subscription, too (rmw_fastrtps).
        unheard = [event for s in unawaited for event in s.event_handlers]
        self._waitables = [w for w in node.waitables if w not in unheard and self._enter(w)]
        self._guards = [waker, *(g for g in node.guards if self._enter(g.handle))]
        self._awaited = [s for s in subscriptions if s not in unawaited]
        self._all_timers = timers
        hot_subscriptions = [h.subscription for h in hot]
        self._subscriptions = [
            HeldSubscription(s, desk.guard) for s in subscriptions if s not in hot_subscriptions
        ]
        self._timers = [t for t in timers if t not in hot_timers]
        events = [w.get_num_entities() for w in self._waitables]
        context: Any = node.context.handle
        self._stack.enter_context(context)
        self._wait_set = _rclpy.WaitSet(
            len(self._awaited) + sum(e.num_subscriptions for e in events),
            len(self._guards) + sum(e.num_guard_conditions for e in events),
            len(timers) + sum(e.num_timers for e in events),
            len(self._clients) + sum(e.num_clients for e in events),
            len(self._services) + sum(e.num_services for e in events),
            sum(e.num_events for e in events),
            node.context.handle,
        )

    def _enter(self, handle: Any) -> bool:
        """Hold a handle; return False for one that has just been destroyed."""
        try:
            self._stack.enter_context(handle)
        except InvalidHandle:
            return False
        return True

    def wait(self, timeout_ns: int) -> bool:
        """Wait for anything, hot or not; what waitables have is handled at once.

        Returns:
            True if there is a request or a response to serve.
        """
        wait_set = self._wait_set
        wait_set.clear_entities()
        for subscription in self._awaited:
            wait_set.add_subscription(subscription.handle)
        for client in self._clients:
            wait_set.add_client(client.handle)
        for service in self._services:
            wait_set.add_service(service.handle)
        for timer in self._all_timers:
            wait_set.add_timer(timer.handle)
        for guard in self._guards:
            wait_set.add_guard_condition(guard.handle)
        for waitable in self._waitables:
            waitable.add_to_wait_set(wait_set)
        wait_set.wait(0 if self._desk.busy else timeout_ns)
        for waitable in [w for w in self._waitables if w.is_ready(wait_set)]:
            self._desk.guard.run("action", partial(_execute, waitable))
        ready = wait_set.get_ready_entities
        return bool(self._desk.busy or ready("service") or ready("client"))

    def serve(self, *, asked: bool = True) -> None:
        """Serve what is there without waiting: all messages, and one request of each service.

        Args:
            asked: False if `wait` has just found no request and no response: to look for them costs
                as much as all the rest.
        """
        for subscription in self._subscriptions:
            subscription.serve_all()
        if asked:
            self._serve_services()
        self._desk.send_again()
        for timer in self._timers:
            _serve_timer(timer)

    def _serve_services(self) -> None:
        """Serve one request of each service, and the response that each client has."""
        for service in self._services:
            self._desk.serve(service)
        for client in self._clients:
            kind: Any = client.srv_type
            header, response = client.handle.take_response(kind.Response)
            if header is not None:
                with contextlib.suppress(KeyError):
                    sequence = header.request_id.sequence_number
                    client.get_pending_request(sequence).set_result(response)

    def close(self) -> None:
        for subscription in self._subscriptions:
            subscription.close()
        self._stack.close()


def _serve_timer(timer: Timer) -> bool:
    """Call a timer if it is due; return whether it was."""
    if not timer.handle.is_timer_ready():
        return False
    timer.handle.call_timer()
    timer.callback()
    return True


def wake(node: Node) -> None:
    """Have a node's thread look at its wires, from any thread."""
    executor = executor_of(node)
    if executor is not None:
        executor.end_wait()


def executor_of(node: Node) -> WaitSetExecutor | None:
    """Return the executor that spins a node, None before it does."""
    executor: Any = node.executor
    assert executor is None or isinstance(executor, WaitSetExecutor)
    return executor


def _execute(waitable: Any) -> None:
    """Let a waitable handle what it has."""
    _finish(waitable.execute(waitable.take_data()))


def _finish(coroutine: Any) -> None:
    """Run a coroutine that never waits to its end, as waitables' handlers are."""
    try:
        coroutine.send(None)
    except StopIteration:
        return
    coroutine.close()
