"""The page around viser's picture, with which the robot is driven and stopped, and its websocket.

It has a server and a thread of its own: nothing that viser has to do, and no browser that does not
read, is between an operator and the emergency stop.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from importlib.resources import files

import msgspec
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from husky_bringup.console.clicked_goals import NAVIGATION, ClickedGoals
from husky_bringup.console.operators import Ask, Operator, Operators, read_word
from husky_bringup.teleop_mapping import ACTION_KEYS, MOTION_KEYS

PLACE = "/operator"
"""Where the websocket is."""
VIEW = "/view"
"""Where the page expects viser's."""

_PAGES = {
    "/": ("index.html", "text/html"),
    "/operator.js": ("operator.js", "text/javascript"),
    "/operator.css": ("operator.css", "text/css"),
}
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src data:; frame-ancestors 'self'",
    "Cache-Control": "no-cache",
}
_PERIOD = 0.1
"""Between two beats to a browser [s]."""
_BETWEEN = 0.002
"""Least time between two words of one browser [s]; who sends more has to wait."""
_MOST = 4096
"""Longest word [bytes]."""
_LOGGER = logging.getLogger(__name__)
_LOGGER.addHandler(logging.NullHandler())
_LOGGER.propagate = False  # who is no browser is told so, and counted


class OperatorServer:
    """Serves the page, and hears what operators hold and ask for.

    Each is told the outcome of his own requests alone.

    Attributes:
        port: that it listens on, on this machine.
        robot: what each of them is told of the robot, as JSON; whoever knows it may set it.
        refused: words that were none.
        goals: that operators click on the ground; None for a robot that takes none.
    """

    def __init__(self, operators: Operators, ask: Callable[[Operator, Ask, float], None]):
        """Serve.

        Args:
            operators: that hold something.
            ask: takes who asks, for what, and how old that is [s], in the server's thread.
        """
        self._operators, self._ask = operators, ask
        self.robot = b"{}"
        self.refused = 0
        self.goals: ClickedGoals | None = None
        website = files(__package__) / "website"
        self._pages = {
            path: ((website / name).read_text("utf-8"), f"{kind}; charset=utf-8")
            for path, (name, kind) in _PAGES.items()
        }
        self._loop, self._ending = asyncio.new_event_loop(), asyncio.Event()
        self._server: Server = self._loop.run_until_complete(self._listen())
        self.port: int = next(iter(self._server.sockets)).getsockname()[1]
        live, arguments = self._loop.run_until_complete, (self._live(),)
        self._thread = threading.Thread(target=live, args=arguments, name="operators", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End every connection."""
        with contextlib.suppress(RuntimeError):  # it is closed already
            self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join()
        self._loop.close()

    async def _listen(self) -> Server:
        return await serve(
            self._serve,
            "127.0.0.1",
            0,
            process_request=self._answer,
            compression=None,
            max_size=_MOST,
            max_queue=4,
            logger=_LOGGER,
        )

    async def _live(self) -> None:
        await self._ending.wait()
        self._server.close()
        await self._server.wait_closed()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request with a page, or None for a websocket."""
        path = request.path.partition("?")[0]
        if path == PLACE:
            return None
        if path not in self._pages:
            return connection.respond(HTTPStatus.NOT_FOUND, f"there is no {path[:80]}\n")
        text, kind = self._pages[path]
        response = connection.respond(HTTPStatus.OK, text)
        del response.headers["Content-Type"]
        response.headers.update(_HEADERS | {"Content-Type": kind})
        return response

    async def _serve(self, connection: ServerConnection) -> None:
        """Serve an operator to his end."""
        operator = self._operators.join()
        telling = asyncio.create_task(self._tell(connection, operator))
        try:
            async for data in connection:
                self._take(operator, data)
                # Words that waited for us are passed over quickly: new ones are behind them.
                await asyncio.sleep(0.0 if operator.has_waited else _BETWEEN)
        except ConnectionClosed:
            pass  # he is gone, whoever has ended it
        except ValueError as error:
            self.refused += 1
            await connection.close(1008, str(error).encode()[:120].decode(errors="ignore"))
        finally:
            telling.cancel()
            self._operators.leave(operator, time.monotonic())

    def _take(self, operator: Operator, data: str | bytes) -> None:
        word, now = read_word(data), time.monotonic()
        if isinstance(word, Ask):
            self._pass_on(operator, word, self._operators.age(operator, word.beat, now))
            return
        for action in self._operators.hold(operator, word, now):
            self._pass_on(operator, Ask("action", action.value), operator.delay)

    def _pass_on(self, operator: Operator, ask: Ask, age: float) -> None:
        """Have something done; it may be a stop, so the goals come after it."""
        if ask.what != NAVIGATION or self.goals is None:
            self._ask(operator, ask, age)
        if self.goals is not None:
            self.goals.hear(operator, ask, age)

    async def _tell(self, connection: ServerConnection, operator: Operator) -> None:
        """Tell a browser what keys mean, then again and again how things stand."""
        with contextlib.suppress(ConnectionClosed):
            await connection.send(_HELLO)
            while True:
                beat, outcome = self._operators.beat(operator, time.monotonic()), operator.outcome
                state = {
                    "beat": beat.number,
                    "delay": round(beat.delay, 3) if beat.delay < _LONG else None,
                    "driver": beat.driver,
                    "holds": beat.holds,
                    "obstacle": beat.obstacle,
                    "said": outcome.text,
                    "refused": outcome.refused,
                    "at": outcome.time,
                    "picks": self.goals is not None and self.goals.picker is operator,
                    "robot": msgspec.Raw(self.robot),
                }
                await connection.send(msgspec.json.encode(state).decode())
                await asyncio.sleep(_PERIOD)


_LONG = 60.0
"""A delay that is not told any more: of a beat that is not known, too [s]."""
_HELLO = msgspec.json.encode(
    {
        "motion_keys": {key: (v.forward, v.left, v.yaw) for key, v in MOTION_KEYS.items()},
        "action_keys": {key: action.value for key, action in ACTION_KEYS.items()},
    }
).decode()
