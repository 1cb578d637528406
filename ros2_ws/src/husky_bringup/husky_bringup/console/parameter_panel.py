"""The parameters of the robot's nodes: an input each, which shows and sets what the node has."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from html import escape
from typing import Any, Protocol

from rcl_interfaces.msg import ParameterEvent
from viser import GuiApi

from husky_bringup.console.parameter_inputs import ParameterInput, accepted
from husky_bringup.console.worker import Worker
from husky_bringup.node_parameter import NodeParameter, to_python

_MOST = 100
"""Inputs that are shown."""
_LOOK_PERIOD = 5.0
"""Wall time between two looks for nodes [s]."""
_LONGEST_PATTERN = 200
_LONGEST_LINE = 500
"""Characters of what a node says."""
_NO_NODE = "-"
_NODES = "nodes"
"""The lane in which it is asked which nodes there are; each node has one of its own name."""
_DESCRIPTION = ""
"""The call that asks for all parameters of a node; the others have a parameter's name."""
_STYLE = "font-size:0.85em;padding:0 0.9em 0.4em;overflow-wrap:anywhere"


class ParameterSource(Protocol):
    """What the panel asks; each of these blocks, and may raise an error that tells why."""

    def nodes(self) -> list[str]:
        """Return the full names of the nodes that have parameters."""

    def describe(self, node: str) -> list[NodeParameter]:
        """Return the parameters of a node."""

    def write(self, values: Mapping[str, Any]) -> list[str]:
        """Set parameters by full names; return why some have not been set."""


class ParameterPanel:
    """Shows the parameters of one node, which a dropdown chooses."""

    def __init__(self, gui: GuiApi, source: ParameterSource):
        """Show nothing yet; the panel will be where in the page it is made.

        Args:
            gui: of the page.
            source: is asked in threads of the panel, of one node one thing after the other: a node
                that does not answer holds up nobody but itself.
        """
        self._gui, self._source, self._worker = gui, source, Worker()
        self._chooser: Any = gui.add_dropdown(
            "node", (_NO_NODE,), hint="whose parameters are shown"
        )
        gui.add_button("look again", hint="for nodes and values").on_click(self._on_look)
        self._names = gui.add_text(
            "names", "*", hint="of the parameters that are shown; * stands for any text"
        )
        self._state, self._outcome = gui.add_html(""), gui.add_html("")
        self._place = gui.add_folder(None)
        self._looked, self._stale = -math.inf, False
        self._node, self._pattern, self._words = _NO_NODE, "*", "no nodes yet"
        self._known: dict[str, NodeParameter] = {}
        self._told: dict[str, Any] = {}
        self._inputs: dict[str, ParameterInput] = {}
        self._groups: dict[str, Any] = {}

    def take_event(self, event: ParameterEvent) -> None:
        """Take what a node tells of its parameters."""
        if event.node != self._node:
            return
        if event.new_parameters or event.deleted_parameters or self._is_busy(_DESCRIPTION):
            self._stale = True
        for each in event.changed_parameters:
            if each.name not in self._known:
                self._stale = True
                continue
            try:
                self._told[each.name] = to_python(each.value)
            except RuntimeError:  # of a type that there is not
                self._stale = True

    def draw(self, now: float) -> None:
        """Bring the page up to a wall time [s]."""
        if now >= self._looked + _LOOK_PERIOD and not self._worker.is_busy(_NODES, _NODES):
            self._looked = now
            self._look(again=False)
        self._worker.hand_over()
        self._choose()
        for name in [name for name in self._told if not self._is_busy(name)]:
            self._update(name, self._told.pop(name))
        if self._stale and not self._is_busy(_DESCRIPTION):
            self._ask_parameters()
        pattern = str(self._names.value).strip()
        if pattern != self._pattern:
            self._pattern = pattern
            self._build()
        _tell(self._state, self._words)

    def close(self) -> None:
        """Ask nothing any more; does not wait for a call that is under way."""
        self._worker.close()

    # Nodes ------------------------------------------------------------------------------------
    async def _on_look(self, _: object) -> None:
        self._look()

    def _look(self, *, again: bool = True) -> None:
        """Look for nodes, and at the values of the chosen one again if wanted."""
        take = partial(self._take_nodes, again=again)
        self._worker.ask(_NODES, _NODES, self._source.nodes, take, self._say)

    def _take_nodes(self, found: Sequence[str], *, again: bool) -> None:
        """Offer the nodes that there are, and the chosen one even if it has gone."""
        gone = self._node not in found and self._node != _NO_NODE
        options = (*found, self._node) if gone else tuple(found) or (_NO_NODE,)
        if options != tuple(self._chooser.options):
            self._chooser.options = options  # keeps its choice while that is one
        if gone:
            self._forget(f"{self._node} has gone")
        elif (again or not self._known) and self._node != _NO_NODE:
            self._ask_parameters()

    def _choose(self) -> None:
        """Turn to the node that the page chooses."""
        chosen = self._chooser.value  # whatever a client has sent
        if chosen == self._node:
            return
        if chosen not in self._chooser.options:
            self._report(f"there is no node {chosen!r:.80}")
            self._chooser.value = self._node
            return
        self._node = chosen
        self._forget(f"{chosen} is asked for its parameters")
        self._ask_parameters()

    def _ask_parameters(self) -> None:
        node, self._stale = self._node, False
        self._worker.ask(
            node,
            _DESCRIPTION,
            partial(self._source.describe, node),
            partial(self._take_parameters, node),
            partial(self._miss, node),
        )

    def _take_parameters(self, node: str, found: Sequence[NodeParameter]) -> None:
        if node != self._node:
            return
        before, self._known = self._known, {each.name: each for each in found}
        if [_form(each) for each in before.values()] != [_form(each) for each in found]:
            self._build()
        for each in found:
            self._update(each.name, each.value)
        self._say(self._count())

    def _miss(self, node: str, why: str) -> None:
        if node == self._node:
            self._forget(why)

    def _forget(self, why: str) -> None:
        self._known, self._stale = {}, False
        self._told.clear()
        self._build()
        self._say(why)

    # Values -----------------------------------------------------------------------------------
    def _send(self, node: str, parameter: NodeParameter, given: Any) -> None:
        """Have a value set, in viser's thread."""
        self._worker.ask(
            node,
            parameter.name,
            partial(self._set, node, parameter, given),
            partial(self._take_outcome, node, parameter.name),
            partial(self._take_failure, node, parameter.name),
        )

    def _set(
        self, node: str, parameter: NodeParameter, given: Any
    ) -> tuple[Sequence[str], NodeParameter | None]:
        """Set a value, in a thread of the worker; return why not, and what the node has now."""
        full_name = f"{node}.{parameter.name}"
        try:
            refused = self._source.write({full_name: accepted(parameter, given)})
        except ValueError as error:
            refused = [f"{full_name}: {error}"]
        found = [each for each in self._source.describe(node) if each.name == parameter.name]
        return refused, found[0] if found else None

    def _take_outcome(
        self, node: str, name: str, outcome: tuple[Sequence[str], NodeParameter | None]
    ) -> None:
        refused, now = outcome
        value = None if now is None else now.value
        self._report("; ".join(refused) or f"{node}.{name} = {value}")
        if node == self._node:
            # A change that was told meanwhile may be older than what was read, or newer.
            self._stale |= self._told.pop(name, value) != value
            self._update(name, value)

    def _take_failure(self, node: str, name: str, why: str) -> None:
        self._report(f"{node}.{name}: {why}")
        if node == self._node and name in self._known:
            self._update(name, self._known[name].value)

    def _is_busy(self, name: str) -> bool:
        return self._worker.is_busy(self._node, name)

    def _update(self, name: str, value: Any) -> None:
        """Show a value, unless a browser changes it just now."""
        before = self._known.get(name)
        if before is None or type(value) is not type(before.value):
            self._stale = True
            return
        self._known[name] = replace(before, value=value)
        if name in self._inputs and not self._is_busy(name):
            self._inputs[name].show(value)

    # The page ---------------------------------------------------------------------------------
    def _build(self) -> None:
        """Make the inputs anew."""
        for each in (*self._inputs.values(), *self._groups.values()):
            each.remove()
        self._inputs.clear()
        self._groups.clear()
        for parameter in self._fitting()[:_MOST]:
            with ExitStack() as where:
                where.enter_context(self._place)
                group = parameter.name.rpartition(".")[0]
                if group:
                    where.enter_context(self._group(group))
                send = partial(self._send, self._node, parameter)
                self._inputs[parameter.name] = ParameterInput(self._gui, parameter, send)
        self._say(self._count())

    def _fitting(self) -> list[NodeParameter]:
        if len(self._pattern) > _LONGEST_PATTERN:
            return []
        return [each for each in self._known.values() if fnmatchcase(each.name, self._pattern)]

    def _count(self) -> str:
        """Return in words how many parameters there are, and how many of them are shown."""
        if len(self._pattern) > _LONGEST_PATTERN:
            return f"names may have {_LONGEST_PATTERN} characters, not {len(self._pattern)}"
        fitting = len(self._fitting())
        words = f"{fitting} of {len(self._known)} parameters"
        left_out = f"; {fitting - _MOST} of them are left out, names chooses which are shown"
        return words + left_out if fitting > _MOST else words

    def _group(self, name: str) -> Any:
        if name not in self._groups:
            self._groups[name] = self._gui.add_folder(name)
        return self._groups[name]

    def _say(self, words: str) -> None:
        self._words = words

    def _report(self, words: str) -> None:
        _tell(self._outcome, words)


def _form(parameter: NodeParameter) -> tuple[NodeParameter, type]:
    """Return what decides about an input: everything but the value."""
    return replace(parameter, value=None), type(parameter.value)


def _tell(html: Any, words: str) -> None:
    text = words if len(words) <= _LONGEST_LINE else f"{words[:_LONGEST_LINE]}..."
    content = f'<div style="{_STYLE}">{escape(text)}</div>'
    if content != html.content:
        html.content = content
