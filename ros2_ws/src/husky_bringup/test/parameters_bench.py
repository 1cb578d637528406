"""What tests of the page's parameters share: nodes that are made up, a panel, a browser."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from gate_bench import until
from page_client import PageClient
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterEvent, ParameterType, ParameterValue

from husky_bringup.console.parameter_panel import ParameterPanel
from husky_bringup.console.server import PageServer
from husky_bringup.node_parameter import NodeParameter


def parameter(
    name: str,
    value: Any,
    lower: float | None = None,
    upper: float | None = None,
    *,
    description: str = "",
    read_only: bool = False,
    choices: tuple[str, ...] = (),
) -> NodeParameter:
    allowed = ", ".join(choices)
    return NodeParameter(name, value, description, lower, upper, read_only, allowed, choices)


HEIGHT = "gait.trot.height"
WALKER = (
    parameter(HEIGHT, 0.4, 0.1, 0.6, description="of the base [m]"),
    parameter("gait.trot.steps", 4, 1, 20),
    parameter("gait.walk.height", 0.3, 0.1, 0.6),
    parameter("free", 2.5),
    parameter("on", True),
    parameter("robot", "carbon", read_only=True, description="which it is"),
    parameter("sensing", "ideal", choices=("ideal", "noisy")),
    parameter("frame", "odom"),
    parameter("legs", ["a", "b"]),
    parameter("gains", [1.0, 2.5]),
    parameter("blob", b"\1\2"),
    parameter("unset", None),
)


Say = Callable[..., None]
"""Sends a message of a browser."""


class Refused(RuntimeError):
    """Why a node does not answer."""


class Source:
    """Nodes that are made up.

    Attributes:
        found: parameters by name, by node.
        written: what has been asked for, in its order.
        refusals: why a value is not taken.
        mute: nodes that do not answer.
        may_write: holds writes up while it is not set.
        may_describe: holds answers of nodes up while it is not set.
        quick: nodes that nothing holds up.
        described: how often a node has said what it has.
        threads: names of those in which something has been asked.
    """

    def __init__(self) -> None:
        self.found = {"/walker": {each.name: each for each in WALKER}, "/other": {}}
        self.written: list[tuple[str, Any]] = []
        self.refusals: dict[Any, str] = {}
        self.mute: set[str] = set()
        self.may_write = threading.Event()
        self.may_write.set()
        self.may_describe = threading.Event()
        self.may_describe.set()
        self.quick: set[str] = set()
        self.described = 0
        self.threads: set[str] = set()

    def nodes(self) -> list[str]:
        self.threads.add(threading.current_thread().name)
        if "*" in self.mute:
            raise Refused("nobody is there")
        return sorted(self.found)

    def describe(self, node: str) -> list[NodeParameter]:
        self.threads.add(threading.current_thread().name)
        if node in self.mute or node not in self.found:
            raise Refused(f"{node} is silent")
        found = list(self.found[node].values())
        self.described += 1
        self._hold_up(node, self.may_describe)
        return found

    def write(self, values: Mapping[str, Any]) -> list[str]:
        ((full_name, value),) = values.items()
        self.written.append((full_name, value))
        node, _, name = full_name.partition(".")
        self._hold_up(node, self.may_write)
        if repr(value) in self.refusals:
            return [f"{full_name}: {self.refusals[repr(value)]}"]
        self.has(node, name, value)
        return []

    def _hold_up(self, node: str, may_go_on: threading.Event) -> None:
        if node not in self.quick:
            may_go_on.wait()

    def has(self, node: str, name: str, value: Any) -> None:
        self.found[node][name] = replace(self.found[node][name], value=value)


class Bench:
    """A panel, and a browser that looks at it."""

    def __init__(self, server: PageServer, say: Say, source: Source):
        server.gui.reset()
        self.source, self.gui, self.say = source, server.gui, say
        self.browsers = server.get_clients
        self.panel = ParameterPanel(server.gui, source)

    def until(self, true: Callable[[], bool]) -> None:
        """Draw until something is true."""

        def look() -> bool:
            self.panel.draw(0.0)
            return true()

        until(look)

    def settle(self) -> None:
        """Draw until nothing is under way."""
        worker = self.panel._worker
        self.until(lambda: not (worker._waiting or self.panel._stale))
        self.panel.draw(0.0)

    def give(self, handle: Any, value: Any) -> None:
        """Send a value as a browser does."""
        updates = {"value": value}
        self.say(type="GuiUpdateMessage", uuid=handle._impl.uuid, updates=updates)

    def change(self, name: str, value: Any) -> None:
        """Change an input, and press Enter if it needs it."""
        shown = self.panel._inputs[name]
        self.give(shown._handle, value)
        if shown._whole is not shown._handle:
            self.say(type="GuiFormSubmitMessage", uuid=shown._whole._impl.uuid)

    def change_and_hear(self, name: str, value: Any) -> str:
        """Change an input, and return what the panel says of it."""
        self.panel._outcome.content = ""
        self.change(name, value)
        self.until(lambda: self.outcome() != "")
        return self.outcome()

    def shown(self, name: str) -> Any:
        return self.panel._inputs[name]._handle.value

    def state(self) -> str:
        return words(self.panel._state)

    def outcome(self) -> str:
        return words(self.panel._outcome)

    def folders(self) -> dict[str, list[str]]:
        """Labels of what stands in each folder of parameters."""

        def labels(handle: Any) -> list[str]:
            children = list(getattr(handle, "_children", {}).values())
            found = [handle.label] if hasattr(handle, "value") else []
            return found + [label for child in children for label in labels(child)]

        return {each.label: labels(each) for each in self.panel._groups.values()}


def words(html: Any) -> str:
    return html.content.partition(">")[2].removesuffix("</div>")


def event(node: str, kind: str = "changed", **values: float) -> ParameterEvent:
    made = [
        ParameterMessage(
            name=name.replace("__", "."),
            value=ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value),
        )
        for name, value in values.items()
    ]
    return ParameterEvent(node=node, **{f"{kind}_parameters": made})


@contextlib.contextmanager
def browser(server: PageServer) -> Iterator[Say]:
    """Look at the page, and send messages."""
    client = PageClient(f"http://127.0.0.1:{server.get_port()}")
    until(lambda: bool(server.get_clients()))
    yield client.say
    client.close()
