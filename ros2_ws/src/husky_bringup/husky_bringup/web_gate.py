"""The door of a web server: who comes shows a token, a page of somebody else stays outside.

Servers for browsers, of viser and of foxglove-sdk, have no notion of who may come in. So they
listen where only this machine gets to, at a port of their own, and a gate stands before them. It
reads the head of the first request of each connection, and answers it itself or connects it
through; what follows it carries unseen, both ways, no faster than it is taken. A connection that
becomes no websocket has one request only, so that none goes by unread.

What it asks:

- a token, where it is opened to other machines: in the address as `?token=...`, which a browser
  exchanges for a cookie, or as `Authorization: Bearer ...`;
- that a page which opens a connection (the header `Origin`) came from here or is allowed: any page
  in the operator's browser can reach this machine's ports;
- that it is called by a name of this machine, where it is not opened: a stranger's name may lead to
  us (DNS rebinding);
- that its pages stand in no frame of a stranger's page, which could have the operator click there.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import ipaddress
import re
import secrets
import socket
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from urllib.parse import unquote

_HEAD = 16_384
"""Longest head of a request [bytes]."""
_PATIENCE = 10.0
"""Wall time within which the head has come, and the last words are taken [s]."""
_CHUNK = 65_536
"""Read at once [bytes]; no more than a few of these wait for either side."""
_WAITING = 64
"""Connections at once that are not let in: their head is awaited, or they have had an answer."""

_ANY = ("", "0.0.0.0", "::")
"""Addresses to listen on that are all of this machine's."""

_WORD = r"[!#$%&'*+.^_`|~0-9A-Za-z-]+"
_FIRST = re.compile(rf"{_WORD} (/[!-~]*) HTTP/1\.[0-9]")
_HEADER = re.compile(rf"({_WORD}):([\t -~\x80-\xff]*)")  # what is not ASCII is in cookies of others
_HOST = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[0-9A-Za-z._-]+)(:[0-9]{1,5})?")
_CONNECTION = re.compile(r"(?<=\r\n)connection:.*\r\n", re.IGNORECASE)
_ORIGIN = re.compile(rf"[A-Za-z][0-9A-Za-z+.-]*://({_HOST.pattern})?")
_FRAMES = ("iframe", "frame", "embed", "object")
_SHOWN = re.compile(r"(?<=[?&])token=([^&]*)&?")


@dataclass(frozen=True)
class Request:
    """The head of a request: as it came; path and query; headers by name in lower case."""

    head: str
    target: str
    headers: Mapping[str, str]

    @property
    def is_upgrade(self) -> bool:
        """Whether it opens a websocket."""
        words = self.headers.get("connection", "").lower().split(",")
        asked = self.headers.get("upgrade", "").lower()
        return asked == "websocket" and "upgrade" in [word.strip() for word in words]

    def token(self, cookie: str) -> str:
        """Return what it shows as token, also in a cookie; "" for nothing."""
        if shown := _SHOWN.search(self.target):
            return unquote(shown[1])
        scheme, _, word = self.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            return word.strip()
        for each in self.headers.get("cookie", "").split(";"):
            name, _, value = each.strip().partition("=")
            if name == cookie:
                return value
        return ""

    @property
    def is_framed(self) -> bool:
        """Whether a page of somebody else wants it in a frame, as a browser tells."""
        foreign = self.headers.get("sec-fetch-site") in ("cross-site", "same-site")
        return foreign and self.headers.get("sec-fetch-dest") in _FRAMES

    def leads_to(self, place: str) -> bool:
        """Return whether the target is at a place or below it."""
        return re.fullmatch(rf"{re.escape(place)}([/?].*)?", self.target) is not None

    def forwarded(self, place: str = "") -> bytes:
        """Return the head as the inner server gets it, without the token in the target.

        Args:
            place: which the target leads to; the server knows nothing of it.
        """
        bare = _SHOWN.sub("", self.target).removeprefix(place)
        bare = bare if bare.startswith("/") else f"/{bare}"
        head = self.head.replace(self.target, bare, 1)
        if not self.is_upgrade:
            head = _CONNECTION.sub("", head)[:-2] + "Connection: close\r\n\r\n"
        return head.encode("latin-1")


def read_head(head: bytes) -> Request:
    """Read the head of a request, with the empty line at its end.

    Raises:
        ValueError: it is none of HTTP/1.x, or has characters that cannot be printed.
    """
    text = head.decode("latin-1")
    first, *lines = text.removesuffix("\r\n\r\n").split("\r\n")
    words = _FIRST.fullmatch(first)
    if words is None or not text.endswith("\r\n\r\n"):
        raise ValueError("this is no request of HTTP/1.x")
    headers: dict[str, str] = {}
    for line in lines:
        header = _HEADER.fullmatch(line)
        if header is None:
            raise ValueError("a header has no name, or characters that cannot be printed")
        name, value = header[1].lower(), header[2].strip()
        headers[name] = f"{headers[name]}, {value}" if name in headers else value
    return Request(text, words[1], headers)


def is_loopback(host: str) -> bool:
    """Return whether only this machine gets to an address or a name."""
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host.lower() == "localhost"


class Refusal(Exception):
    """Who asks is not let in: the status of HTTP, and why."""


class WebGate:
    """Listens, lets in, connects through.

    Attributes:
        port: that it listens on.
        token: that it asks for, "" for none.
        connections: how many are let in now.
        refused: how often it has let nobody in.
    """

    def __init__(
        self,
        host: str,
        port: int,
        inner_port: int,
        *,
        places: Mapping[str, int] = {},
        token: str = "",
        origins: Sequence[str] = (),
        most: int = 64,
    ):
        """Open the gate.

        Args:
            host: address to listen on; one that other machines get to is guarded by a token.
            port: to listen on, 0 for any that is free.
            inner_port: where the server is, on this machine.
            places: ports of others, for what is asked below a path such as "/view".
            token: to ask for; "" for one made here where it is needed, else none.
            origins: pages that may connect, as scheme://host or file://, besides those from here.
            most: connections at once.

        Raises:
            OSError: it cannot listen there.
            ValueError: the token or an origin is none.
        """
        _check_settings(token, origins)
        self._host, self._most, self._ports = host, most, {**places, "": inner_port}
        self._is_open = not is_loopback(host)
        self.token = token or (secrets.token_urlsafe(16) if self._is_open else "")
        self._origins = frozenset(each.lower() for each in origins)
        self.connections = self.refused = 0
        self._tasks: set[asyncio.Task[None] | None] = set()
        self._loop, self._ending = asyncio.new_event_loop(), asyncio.Event()
        self._server = self._listen(port)
        self.port: int = self._server.sockets[0].getsockname()[1]
        self._cookie = f"husky_token_{self.port}"  # a browser sends it to all ports of a machine
        live, arguments = self._loop.run_until_complete, (self._live(),)
        self._thread = threading.Thread(target=live, args=arguments, name="gate", daemon=True)
        self._thread.start()

    def _listen(self, port: int) -> asyncio.Server:
        try:
            start = asyncio.start_server(self._serve, self._host, port, limit=_HEAD)
            return self._loop.run_until_complete(start)
        except BaseException:
            self._loop.close()
            raise

    def address(self, scheme: str) -> str:
        """Return where to go, with the token."""
        host = socket.gethostname() if self._host in _ANY else self._host
        host = f"[{host}]" if ":" in host else host
        return f"{scheme}://{host}:{self.port}" + (f"/?token={self.token}" if self.token else "")

    def close(self) -> None:
        """Close the gate and every connection."""
        with contextlib.suppress(RuntimeError):  # it is closed already
            self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join()
        self._loop.close()

    async def _live(self) -> None:
        """Let it serve until it is closed."""
        await self._ending.wait()
        for listening in self._server.sockets:
            self._loop.remove_reader(listening)
        await asyncio.sleep(0)  # who has come so far has a task
        self._server.close()
        while others := asyncio.all_tasks() - {asyncio.current_task()}:
            await asyncio.sleep(0)  # what is cancelled before its begin comes to no `finally`
            for task in others:  # repeatedly: an error at the same time hides that it is cancelled
                task.cancel()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve a connection to its end."""
        task = asyncio.current_task()
        self._tasks.add(task)  # once the client has said all, nothing else would keep it alive
        try:
            if len(self._tasks) > self._most + _WAITING:
                self.refused += 1  # without a word, which would have to wait too
                return
            await self._answer(reader, writer)
            await _part(reader, writer)
        except (OSError, EOFError, asyncio.CancelledError):
            pass  # it is over, whoever has ended it
        finally:
            self._tasks.discard(task)
            writer.transport.abort()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            request = await _request(reader)
            self._check(request)
            is_page = request.head.startswith("GET ") and not request.is_upgrade
            if self.token and is_page and _SHOWN.search(request.target):
                await self._send_on(request, writer)
            else:
                self.connections += 1
                try:
                    await self._connect_through(request, reader, writer)
                finally:
                    self.connections -= 1
        except Refusal as refusal:
            self.refused += 1
            await _say(writer, *refusal.args)

    def _check(self, request: Request) -> None:
        """Let a request in, or raise a Refusal."""
        shown = request.token(self._cookie)
        if self.token and not hmac.compare_digest(shown.encode(), self.token.encode()):
            why = "the token is missing or wrong; it is in the address that the robot has told"
            raise Refusal(HTTPStatus.UNAUTHORIZED, why)
        called = request.headers.get("host", "").lower()
        name = _HOST.fullmatch(called)
        if name is None or not (self._is_open or is_loopback(name[1].strip("[]"))):
            raise Refusal(HTTPStatus.FORBIDDEN, f"{called[:80]!r} is no name of this machine")
        origin = request.headers.get("origin", f"://{called}").lower()
        if origin not in self._origins and origin.partition("://")[2] != called:
            why = f"pages of {origin[:80]!r} may not connect (parameter origins)"
            raise Refusal(HTTPStatus.FORBIDDEN, why)
        if request.is_framed:
            why = "pages of others may not show this one in a frame"
            raise Refusal(HTTPStatus.FORBIDDEN, why)
        if self.connections >= self._most:
            why = f"there are {self._most} connections already"
            raise Refusal(HTTPStatus.SERVICE_UNAVAILABLE, why)

    async def _send_on(self, request: Request, writer: asyncio.StreamWriter) -> None:
        """Send a browser to the same place, never to another machine, with the token as cookie."""
        bare = _SHOWN.sub("", request.target).lstrip("/\\").rstrip("?&")
        cookie = f"{self._cookie}={self.token}; HttpOnly; SameSite=Lax; Path=/"
        headers = f"Location: /{bare}\r\nSet-Cookie: {cookie}\r\n"
        await _say(writer, HTTPStatus.SEE_OTHER, "go on without the token", headers)

    async def _connect_through(
        self, request: Request, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Carry both ways until the inner server has said all, or a side is gone."""
        place = next(place for place in self._ports if not place or request.leads_to(place))
        try:
            inner = asyncio.open_connection("127.0.0.1", self._ports[place], limit=_CHUNK)
            inner_reader, inner_writer = await asyncio.wait_for(inner, _PATIENCE)
        except OSError as error:
            why = "the server behind this gate cannot be reached"
            raise Refusal(HTTPStatus.BAD_GATEWAY, why) from error
        try:
            inner_writer.write(request.forwarded(place))
            async with asyncio.TaskGroup() as ways:
                forth = ways.create_task(_carry(reader, inner_writer))
                inner_socket = inner_writer.get_extra_info("socket")
                await _carry(inner_reader, writer, lambda: _acknowledge(inner_socket))
                forth.cancel()
        except* OSError:
            pass
        finally:
            inner_writer.transport.abort()


def _check_settings(token: str, origins: Sequence[str]) -> None:
    odd = re.search(r"[^0-9A-Za-z_.~-]", token)
    if token and (odd or not 8 <= len(token) <= 128):
        has = repr(odd[0]) if odd else f"{len(token)} characters"
        raise ValueError(f"token has {has}, it must be 8 to 128 of a-z, A-Z, 0-9, _, -, . and ~")
    for origin in origins:
        if not _ORIGIN.fullmatch(origin):
            raise ValueError(f"origins has {origin!r}, it must be scheme://host or with :port")


async def _request(reader: asyncio.StreamReader) -> Request:
    """Read a request's head, or raise a Refusal, or EOFError where the connection ends before."""
    try:
        async with asyncio.timeout(_PATIENCE):
            return read_head(await reader.readuntil(b"\r\n\r\n"))
    except asyncio.LimitOverrunError as error:
        why = f"the head of the request is longer than {_HEAD} bytes"
        raise Refusal(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, why) from error
    except TimeoutError as error:
        why = f"no request has come within {_PATIENCE:g} s"
        raise Refusal(HTTPStatus.REQUEST_TIMEOUT, why) from error
    except ValueError as error:
        raise Refusal(HTTPStatus.BAD_REQUEST, str(error)) from error


def _acknowledge(inner: socket.socket) -> None:
    """Have the next bytes acknowledged at once; the kernel forgets it each time.

    A server that waits for that before it sends more, by Nagle's algorithm, would wait 40 ms.
    """
    inner.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)


async def _carry(
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
    each: Callable[[], None] = lambda: None,
) -> None:
    """Carry bytes one way until it ends, and its end; `each` is called after some have come."""
    while data := await reader.read(_CHUNK):
        each()
        writer.write(data)
        await writer.drain()
    writer.write_eof()


async def _say(
    writer: asyncio.StreamWriter, status: HTTPStatus, text: str, headers: str = ""
) -> None:
    body = f"{text}\n".encode()
    if status is HTTPStatus.UNAUTHORIZED:
        headers += "WWW-Authenticate: Bearer\r\n"
    head = (
        f"HTTP/1.1 {status.value} {status.phrase}\r\nContent-Type: text/plain; charset=utf-8\r\n"
        f"Content-Length: {len(body)}\r\nConnection: close\r\n{headers}\r\n"
    )
    writer.write(head.encode() + body)
    await writer.drain()


async def _part(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """End a connection once the last words are taken; bytes left unread would take them back."""
    async with asyncio.timeout(_PATIENCE):
        writer.write_eof()
        while await reader.read(_CHUNK):
            pass
        writer.close()
        await writer.wait_closed()
