"""Who is let in by the gate: real sockets, http.client, the package websockets."""

from __future__ import annotations

import http.client
import socket
from concurrent.futures import ThreadPoolExecutor
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urljoin, urlsplit

import pytest
from gate_bench import (
    PAGE,
    PATIENCE,
    TOKEN,
    UPGRADE,
    MakeGate,
    ask,
    dial,
    get,
    head_for,
    inner_server,
    open_websocket,
    read_all,
    read_exactly,
    says_back,
    status,
    until,
)
from hypothesis import given
from hypothesis import strategies as st

from husky_bringup import web_gate
from husky_bringup.web_gate import WebGate, is_loopback, read_head


# Tokens -------------------------------------------------------------------------------------------
def test_loopback_without_a_token_is_served(gate_to: MakeGate, echo: int) -> None:
    gate = gate_to(echo)
    assert gate.token == "" and gate.address("ws") == f"ws://127.0.0.1:{gate.port}"
    with open_websocket(gate) as connection:
        assert says_back(connection) and gate.connections == 1
    until(lambda: gate.connections == 0)
    assert gate.refused == 0


def test_an_open_gate_makes_a_token_and_tells_it(gate_to: MakeGate, pages: int) -> None:
    gates = gate_to(pages, "0.0.0.0"), gate_to(pages, "0.0.0.0")
    assert len(gates[0].token) >= 16 and gates[0].token != gates[1].token
    port, token = gates[0].port, gates[0].token
    assert gates[0].address("http") == f"http://{socket.gethostname()}:{port}/?token={token}"


@pytest.mark.parametrize("host", ["0.0.0.0", "127.0.0.1"])
def test_who_shows_the_token_is_let_in(gate_to: MakeGate, echo: int, host: str) -> None:
    gate = gate_to(echo, host, token=TOKEN)
    cookie = f'other={{"a": "b, c"}}; husky_token_{gate.port}={TOKEN}; last=ü'
    ways: list[tuple[str, dict[str, str]]] = [
        (f"/?token={TOKEN}", {}),
        (f"/?token={TOKEN.replace('~', '%7E')}", {}),
        (f"/where?a=b&token={TOKEN}", {}),
        ("/", {"Authorization": f"Bearer {TOKEN}"}),
        ("/", {"Cookie": cookie.encode().decode("latin-1")}),
    ]
    for target, headers in ways:
        with open_websocket(gate, target, **headers) as connection:
            assert says_back(connection)
    assert gate.refused == 0


def test_who_shows_no_token_or_a_wrong_one_stays_outside(
    gate_to: MakeGate, pages: int, heads: list[bytes]
) -> None:
    gate = gate_to(pages, "0.0.0.0", token=TOKEN)
    wrong: list[tuple[str, dict[str, str]]] = [
        ("/", {}),
        ("/?token=", {}),
        (f"/?token={TOKEN}x", {}),
        ("/?token=%FF%00", {}),
        (f"/?xtoken={TOKEN}", {}),
        ("/", {"Authorization": f"Bearer {TOKEN[:-1]}"}),
        ("/", {"Authorization": f"Basic {TOKEN}"}),
        ("/", {"Cookie": f"husky_token_{gate.port}=no"}),
        ("/", {"Cookie": f"husky_token_1={TOKEN}"}),
    ]
    for target, headers in wrong:
        assert get(gate, target, **headers) == 401
        assert get(gate, target, **headers, **UPGRADE) == 401
    assert gate.refused == 2 * len(wrong) and gate.connections == 0 and not heads


def test_a_browser_exchanges_the_token_for_a_cookie(
    gate_to: MakeGate, pages: int, heads: list[bytes]
) -> None:
    gate = gate_to(pages, "0.0.0.0")
    client = http.client.HTTPConnection("127.0.0.1", gate.port, timeout=PATIENCE)
    client.request("GET", f"/view?a=1&token={gate.token}&b=2")
    answer = client.getresponse()
    assert answer.status == 303 and answer.headers["Location"] == "/view?a=1&b=2"
    cookie, *settings = answer.headers["Set-Cookie"].split("; ")
    assert cookie.endswith(f"={gate.token}") and {"HttpOnly", "SameSite=Lax"} < set(settings)
    client.close()
    assert not heads
    client.request("GET", answer.headers["Location"], headers={"Cookie": cookie})
    answer = client.getresponse()
    assert (answer.status, answer.read()) == (200, b"page\n")
    client.close()


@pytest.mark.parametrize(
    ("target", "location"),
    [
        ("/?token={}", "/"),
        ("/a/?token={}", "/a/"),
        ("/?token={}&token=2&b", "/?b"),
        ("//evil.example/?token={}", "/evil.example/"),
        (r"/\evil.example/?token={}", "/evil.example/"),
        (r"/\/\//evil.example/?token={}", "/evil.example/"),
    ],
)
def test_the_redirect_never_leads_to_another_machine(
    gate_to: MakeGate, pages: int, target: str, location: str
) -> None:
    gate = gate_to(pages, token=TOKEN)
    with dial(gate) as client:
        client.sendall(head_for(gate, target.format(TOKEN)))
        answer = read_all(client).decode()
    assert f"\r\nLocation: {location}\r\n" in answer
    # As browsers do it: a backslash is a slash.
    assert urlsplit(urljoin("http://us/", location.replace("\\", "/"))).netloc == "us"


@pytest.mark.parametrize(
    ("token", "wrong"),
    [
        ("seven_7", "token has 7 characters"),
        ("x" * 129, "token has 129 characters"),
        ("with space", "token has ' '"),
        ("semi;colon", "token has ';'"),
        ("übergroß", "token has 'ü'"),
        ("line_end\n", r"token has '\n'"),
    ],
)
def test_a_token_that_no_address_or_cookie_carries_is_refused(token: str, wrong: str) -> None:
    with pytest.raises(ValueError) as error:
        WebGate("127.0.0.1", 0, 1, token=token)
    assert wrong in str(error.value) and "it must be 8 to 128 of" in str(error.value)
    assert token not in str(error.value)


def test_the_shortest_and_the_longest_token_will_do(gate_to: MakeGate, pages: int) -> None:
    for token in ["-._~aZ09", "x" * 128]:
        assert get(gate_to(pages, token=token), Authorization=f"Bearer {token}") == 200


# Pages and names ----------------------------------------------------------------------------------
def test_pages_from_here_and_allowed_ones_may_connect(gate_to: MakeGate, echo: int) -> None:
    gate = gate_to(echo, origins=["https://App.example", "http://[fd00::1]:8080", "file://"])
    port = gate.port
    for origin in [
        f"http://127.0.0.1:{port}",
        "https://app.example",
        "http://[fd00::1]:8080",
        "file://",
    ]:
        with open_websocket(gate, Origin=origin) as connection:
            assert says_back(connection)


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_foreign_pages_may_not_connect(
    gate_to: MakeGate, pages: int, heads: list[bytes], host: str
) -> None:
    gate = gate_to(pages, host, token=TOKEN, origins=["https://app.example"])
    foreign = [
        "https://evil.example",
        "https://app.example.evil.example",
        "http://app.example",
        "https://app.example:444",
        f"http://127.0.0.1:{gate.port + 1}",
        f"http://evil.example/127.0.0.1:{gate.port}",
        "null",
        "",
        "file://",
    ]
    for origin in foreign:
        assert get(gate, Origin=origin, Authorization=f"Bearer {TOKEN}") == 403, origin
    assert gate.refused == len(foreign) and not heads


@pytest.mark.parametrize("origin", ["*", "https://*", "app.example", "https://a/", "a://b c", ""])
def test_origins_that_are_none_are_refused_by_name(origin: str) -> None:
    with pytest.raises(ValueError, match="origins has") as error:
        WebGate("127.0.0.1", 0, 1, origins=["https://app.example", origin])
    assert repr(origin) in str(error.value)


def test_a_loopback_gate_is_called_by_names_of_this_machine(gate_to: MakeGate, pages: int) -> None:
    gate = gate_to(pages)
    for name in ["localhost", "LocalHost:{}", "127.0.0.1:{}", "127.9.9.9", "[::1]:{}", "[::1]"]:
        assert get(gate, Host=name.format(gate.port)) == 200, name
    strange = ["evil.example:{}", "localhost.evil.example", "10.0.0.1:{}", "[fd00::1]", "", "::1"]
    strange += ["localhost, evil.example", "evil.example\\@localhost", "localhost:{}/", "[x"]
    for name in strange:
        assert get(gate, Host=name.format(gate.port)) == 403, name
    assert ask(gate, b"GET / HTTP/1.1\r\n\r\n") == 403
    two = b"GET / HTTP/1.1\r\nHost: evil.example\r\nHost: localhost\r\n\r\n"
    assert ask(gate, two) == 403
    assert gate.refused == len(strange) + 2


def test_an_open_gate_is_called_by_any_name(gate_to: MakeGate, pages: int) -> None:
    gate = gate_to(pages, "0.0.0.0", token=TOKEN)
    shown = f"Bearer {TOKEN}"
    assert (
        get(gate, Host="robot.local:1", Origin="http://robot.local:1", Authorization=shown) == 200
    )
    assert get(gate, Host="robot.local:1", Origin="http://other.local", Authorization=shown) == 403


def test_addresses_that_only_this_machine_gets_to() -> None:
    assert all(map(is_loopback, ["localhost", "LOCALHOST", "127.0.0.1", "127.1.2.3", "::1"]))
    others = ["0.0.0.0", "::", "", "10.0.0.1", "robot", "localhost.example", "127.0.0.1.example"]
    assert not any(map(is_loopback, others))


def test_ipv6(gate_to: MakeGate, pages: int) -> None:
    try:
        gate = gate_to(pages, "::1")
    except OSError:
        pytest.skip("this machine has no IPv6")
    assert gate.token == "" and gate.address("http") == f"http://[::1]:{gate.port}"
    client = http.client.HTTPConnection("::1", gate.port, timeout=PATIENCE)
    client.request("GET", "/")
    assert client.getresponse().read() == b"page\n"
    client.close()


# Heads --------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("sent", "answer"),
    [
        (b"\r\n\r\n", 400),
        (b"garbage\r\n\r\n", 400),
        (b"GET /\r\n\r\n", 400),
        (b"GET / HTTP/2.0\r\n\r\n", 400),
        (b"GET / HTTP/1.\r\n\r\n", 400),
        (b"GET / HTTP/1.1x\r\n\r\n", 400),
        (b"GET http://localhost/ HTTP/1.1\r\nHost: localhost\r\n\r\n", 400),
        (b"GET  / HTTP/1.1\r\nHost: localhost\r\n\r\n", 400),
        (b"GET /\x07 HTTP/1.1\r\nHost: localhost\r\n\r\n", 400),
        (b"GET /\xe9 HTTP/1.1\r\nHost: localhost\r\n\r\n", 400),
        (b"GET / HTTP/1.1\r\nHost: localhost\r\nX: a\x00b\r\n\r\n", 400),
        (b"GET / HTTP/1.1\r\nHost: localhost\r\nX: a\nOrigin: b\r\n\r\n", 400),
        (b"GET / HTTP/1.1\r\nHost: localhost\r\nX: a\x1b[31m\r\n\r\n", 400),
        (b"GET / HTTP/1.1\r\nHost: localhost\r\nX\x7f: a\r\n\r\n", 400),
        (b"GET / HTTP/1.1\r\nHost: localhost\r\n: a\r\n\r\n", 400),
        (b"GET / HTTP/1.1\r\nHost: localhost\r\nX a\r\n\r\n", 400),
        (b"GET / HTTP/1.1\r\nHost : localhost\r\n\r\n", 400),
        (b"\x16\x03\x01\x02\x00\x01\x00\xff\xfe\r\n\r\n", 400),
        (bytes(range(256)) * 100, 431),
        (b"GET / HTTP/1.1\r\nX: " + b"a" * 20_000 + b"\r\n\r\n", 431),
    ],
)
def test_what_is_no_request_is_refused_and_the_gate_goes_on(
    gate_to: MakeGate, pages: int, heads: list[bytes], sent: bytes, answer: int
) -> None:
    gate = gate_to(pages)
    assert ask(gate, sent) == answer
    assert gate.refused == 1 and not heads
    assert get(gate) == 200


@pytest.mark.parametrize("begun", [b"", b"GET / HTTP/1.1\r\nHost: loc", b"\x00\xff"])
def test_who_does_not_come_up_with_a_request_is_refused(
    gate_to: MakeGate, pages: int, monkeypatch: pytest.MonkeyPatch, begun: bytes
) -> None:
    monkeypatch.setattr(web_gate, "_PATIENCE", 0.05)
    gate = gate_to(pages)
    assert ask(gate, begun) == 408
    monkeypatch.undo()
    assert gate.refused == 1 and get(gate) == 200


def test_a_head_may_come_in_pieces_and_be_as_long_as_allowed(gate_to: MakeGate, pages: int) -> None:
    gate = gate_to(pages)
    head = head_for(gate, Filler="")[:-4]
    head += b"a" * (web_gate._HEAD - len(head)) + b"\r\n\r\n"
    with dial(gate) as client:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for byte in head[:200]:
            client.sendall(bytes([byte]))
        client.sendall(head[200:])
        assert status(read_all(client)) == 200


def test_every_request_on_http_meets_the_check(gate_to: MakeGate) -> None:
    """By a server that would keep the connection for more."""
    seen = []

    class KeepsAlive(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            seen.append((self.path, self.headers.get_all("Connection")))
            self.send_response(200)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), KeepsAlive) as server, ThreadPoolExecutor(1) as pool:
        pool.submit(server.serve_forever, 0.01)
        gate = gate_to(server.server_port)
        first = head_for(gate, "/1", Connection="keep-alive", connection="x")
        # It asks for a websocket by half.
        half = head_for(gate, "/2", Upgrade="websocket", Connection="keep-alive")
        unseen = head_for(gate, "/unseen", Origin="https://evil.example", Connection="close")
        try:
            for head in [first, half]:
                with dial(gate) as client:
                    client.sendall(head + unseen)
                    assert read_all(client).count(b"HTTP/1.1 200") == 1
        finally:
            server.shutdown()
    assert seen == [("/1", ["close"]), ("/2", ["close"])]


def test_the_head_of_an_upgrade_passes_unchanged_but_for_the_token(
    gate_to: MakeGate, pages: int, heads: list[bytes]
) -> None:
    gate = gate_to(pages, token=TOKEN)
    odd = {"sec-websocket-key": "x", "X_Odd": "\t two  spaces ", "x_odd": "again", **UPGRADE}
    for target, bare in [("/?token={}", "/?"), ("/a?token={}&b=/a", "/a?b=/a"), ("/?", "/?")]:
        headers = odd | {"Authorization": f"Bearer {TOKEN}"}
        assert get(gate, target.format(TOKEN), **headers) == 200
        assert heads.pop() == head_for(gate, bare, **headers)


def test_below_a_place_is_another_server(
    gate_to: MakeGate, pages: int, heads: list[bytes], echo: int
) -> None:
    gate = gate_to(echo, places={"/view": pages}, token=TOKEN)
    told = {"Authorization": f"Bearer {TOKEN}"} | UPGRADE
    for target, bare in [
        ("/view", "/"),
        ("/view/", "/"),
        ("/view?a=/view", "/?a=/view"),
        (f"/view?token={TOKEN}", "/?"),
        ("/view//x/view", "//x/view"),
    ]:
        assert get(gate, target, **told) == 200
        assert heads.pop() == head_for(gate, bare, **told)
    for target in ["/", "/viewer", "/a/view", "/View"]:
        with open_websocket(gate, target, **{"Authorization": told["Authorization"]}) as client:
            client.send(target)
            assert client.recv() == target
    assert get(gate, "/view", **UPGRADE) == 401


@pytest.mark.parametrize(
    ("site", "where", "expected"),
    [
        ("cross-site", "iframe", 403),
        ("same-site", "frame", 403),  # another port of this machine
        ("cross-site", "embed", 403),
        ("cross-site", "document", 200),  # a link that is followed
        ("same-origin", "iframe", 200),
        ("none", "document", 200),
    ],
)
def test_no_page_of_others_shows_this_in_a_frame(
    gate_to: MakeGate, pages: int, site: str, where: str, expected: int
) -> None:
    assert get(gate_to(pages), sec_fetch_site=site, sec_fetch_dest=where) == expected


def test_what_is_posted_arrives_behind_a_token_in_the_address(gate_to: MakeGate) -> None:
    def handler(peer: socket.socket, head: bytes) -> None:
        assert head.startswith(b"POST /up? HTTP/1.1\r\n")
        body = read_exactly(peer, 100_000)
        peer.sendall(PAGE.replace(b"page", str(body.count(b"x")).encode()[:4]))

    with inner_server(handler) as port:
        gate = gate_to(port, token=TOKEN)
        client = http.client.HTTPConnection("127.0.0.1", gate.port, timeout=PATIENCE)
        client.request("POST", f"/up?token={TOKEN}", b"x" * 100_000)
        assert client.getresponse().read() == b"1000\n"
        client.close()


_PIECES = [
    "GET",
    " ",
    "/",
    "?token=",
    "HTTP/1.1",
    "\r\n",
    "Host",
    ":",
    "Connection",
    "é",
    "\0",
    "\n",
]
_HEADS = st.lists(st.sampled_from(_PIECES) | st.text(max_size=3), max_size=30).map(
    lambda pieces: "".join(pieces).encode()
)
_LIKELY = _HEADS.map(
    lambda rest: b"GET /" + rest + b" HTTP/1.1\r\nHost: a\r\n" + rest + b"\r\n\r\n"
)


@given(st.binary(max_size=300) | _HEADS | _LIKELY)
def test_a_head_is_read_or_is_a_value_error(head: bytes) -> None:
    try:
        request = read_head(head)
    except ValueError:
        return
    assert request.target.isprintable() and request.target.startswith("/")
    shown = "".join([*request.headers, *request.headers.values()])
    assert not any(character < " " and character != "\t" for character in shown)
    again = read_head(request.forwarded())
    if not request.is_upgrade:
        assert again.headers == {**request.headers, "connection": "close"}
