"""Mermaid drawings of the documents: the running graph, and the controller's mode machine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from husky_bringup.interfaces import Interface
from husky_control.modes import TRANSITIONS, Event, Mode, Transition
from husky_description import graph

_WIRES = (
    f'{graph.PLANT} == "serial line" ==> {graph.VN200_DRIVER}',
    f'{graph.PLANT} == "poses" ==> {graph.T265_DRIVER}',
    f'{graph.PIXHAWK_BRIDGE} <== "MAVLink" ==> {graph.FLIGHT_CONTROLLER}',
    f'{graph.RC_TRANSMITTER} == "SBUS" ==> {graph.FLIGHT_CONTROLLER}',
)
"""Edges of the graph that are no topics."""


def graph_drawing(nodes: Mapping[str, Interface]) -> list[str]:
    """Return the graph; the recorder, which listens to everything, is left out."""
    edges: dict[tuple[str, str], list[str]] = {}
    drawn = [node for node in nodes.values() if node.name != graph.RECORDER]
    for source in drawn:
        for target in drawn:
            heard = set(source.publishes) & set(target.subscribes)
            if heard and source is not target:
                edges[source.name, target.name] = sorted(name for name, _ in heard)
    lines = [f'{a} -- "{"<br>".join(names)}" --> {b}' for (a, b), names in edges.items()]
    return ["flowchart LR", *(f"    {line}" for line in [*sorted(lines), *_WIRES])]


def mode_drawing() -> list[str]:
    """Return the mode machine: what is asked for, in brackets what must hold, or what happens."""
    lines, groups = [f"[*] --> {Mode.PASSIVE.value}"], dict[str, str]()
    for row in TRANSITIONS:
        source = _members(row.sources)
        if len(row.sources) > 1:  # drawn as one state, or the arrows hide the machine
            name = groups.setdefault(source, f"several_{len(groups) + 1}")
            source, shown = name, source
            lines.append(f'state "{shown}" as {name}')
        lines.append(f"{source} --> {row.target.value}: {_label(row)}")
    return ["stateDiagram-v2", *(f"    {line}" for line in lines)]


def _members(modes: Iterable[Mode]) -> str:
    """Name modes in the order of their declaration, or those that are missing."""
    chosen = [mode.value for mode in Mode if mode in set(modes)]
    missing = [mode.value for mode in Mode if mode.value not in chosen]
    return f"any but {missing[0]}" if len(missing) == 1 else ", ".join(chosen)


def _label(row: Transition) -> str:
    # A semicolon would end the line in Mermaid.
    what = " or ".join(row.requests) if row.event is Event.REQUEST else row.label.replace(";", ",")
    needed = ", ".join(condition.replace("_", " ") for condition in row.conditions)
    return f"{what} [{needed}]" if needed else what
