"""`python -m husky_bringup.document`: writes the tables of the documents from the running graph.

A table stands between `<!-- begin NAME -->` and `<!-- end -->`. Its last column, where it has the
head "what it is", is written by hand and kept; everything else comes from the graph, and from the
controller's table of modes. NAME is one of graph, nodes, topics, services, interface NODE,
parameters NODE, gaits NODE, modes, mode_meanings, mode_conditions.
"""

from __future__ import annotations

import argparse
import difflib
import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from husky_bringup.interfaces import Interface, all_nodes, running
from husky_bringup.node_parameter import NodeParameter, meaning, unit
from husky_control.modes.behaviour import Event
from husky_control.modes.table import CONDITIONS, TRANSITIONS, Mode, Transition
from husky_runtime import graph
from husky_runtime.domain_locks import OccupiedError

Graph = Mapping[str, Interface]
Table = list[tuple[str, ...]]
"""Head and rows; cells are Markdown."""

BY_HAND = "what it is"
EVERY_TOPIC = "every topic of the graph"
EVERY_SERVICE = "every service of the graph"
_WHILE_ASKED: Mapping[str, Table] = {
    graph.FOXGLOVE_GATEWAY: [
        ("subscribes to", EVERY_TOPIC, ""),
        ("calls service", EVERY_SERVICE, ""),
    ],
    graph.CONSOLE: [
        ("publishes", "velocities that operators hold, on `/cmd_vel`", ""),
        ("publishes", "goals that operators click, on `/goal_pose`", ""),
        ("subscribes to", "what the page shows", ""),
        ("calls service", "those of modes, gaits, drives, fans, parameters and navigation", ""),
    ],
}
"""Interfaces of nodes that are not in the graph before a client asks for them."""
_BLOCK = re.compile(r"(<!-- begin (?P<name>[^>]+?) -->\n)(?P<body>.*?)(<!-- end -->)", re.DOTALL)
_GAIT = re.compile(r"gait\.(?P<gait>\w+)\.(?P<column>\w+)")


# Files ----------------------------------------------------------------------------------------
def documents(root: Path) -> list[Path]:
    """Return the documents of the project."""
    return sorted([*root.glob("*.md"), *root.glob("docs/*.md"), *root.glob("ros2_ws/src/*/*.md")])


def block_names(text: str) -> list[str]:
    """Return the names of the tables in a document."""
    return [match["name"] for match in _BLOCK.finditer(text)]


def rewrite(text: str, nodes: Graph) -> str:
    """Return a document with its tables as the graph has them.

    Raises:
        ValueError: a block has an unknown name.
    """

    def block(match: re.Match[str]) -> str:
        return f"{match[1]}{_body(match['name'], nodes, match['body'])}{match[4]}"

    return _BLOCK.sub(block, text)


def _body(name: str, nodes: Graph, before: str) -> str:
    kind, _, node = name.partition(" ")
    if name in ("graph", "modes"):
        drawing = graph_drawing(nodes) if name == "graph" else mode_drawing()
        return "\n".join(("```mermaid", *drawing, "```", ""))
    if kind in _TABLES and not node:
        table = _TABLES[kind](nodes)
    elif kind in _TABLES_OF_NODE and node in nodes:
        table = _TABLES_OF_NODE[kind](nodes[node])
    else:
        raise ValueError(f"there is no table {name!r} of a graph with {', '.join(nodes)}")
    return _markdown(_with_notes(table, before))


def _markdown(table: Table) -> str:
    head, *rows = table
    lines = [head, ("---",) * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _with_notes(table: Table, before: str) -> Table:
    """Take over the hand-written last column of a table's rows, which are known by their keys."""
    head, *rows = table
    if head[-1] != BY_HAND:
        return table
    keys = 2 if head[0] == "" else 1
    notes: dict[tuple[str, ...], str] = {}
    for line in before.splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if len(cells) > keys:
            notes[tuple(cells[:keys])] = cells[-1]
    return [head, *((*row[:-1], notes.get(row[:keys], "")) for row in rows)]


# Tables ---------------------------------------------------------------------------------------
def _nodes(nodes: Graph) -> Table:
    rows = [
        (_code(n.name), n.package, "life cycle" if n.lifecycle else "", "") for n in nodes.values()
    ]
    return [("node", "package", "kind", BY_HAND), *rows]


def _topics(nodes: Graph) -> Table:
    found = {t for node in nodes.values() for t in (*node.publishes, *node.subscribes)}
    known = {topic.name: topic for topic in graph.TOPICS}
    rows: Table = []
    for name, kind in sorted(found):
        sources = [n.name for n in nodes.values() if (name, kind) in n.publishes]
        targets = [
            n.name
            for n in nodes.values()
            if (name, kind) in n.subscribes and n.name != graph.RECORDER
        ]
        row = known.get(name)
        traffic = f"{row.qos}, {row.rate:g} Hz" if row and row.rate else row.qos if row else ""
        rows.append((_code(name), _code(kind), ", ".join(sources), ", ".join(targets), traffic, ""))
    return [("topic", "type", "from", "to", "quality of service, rate", BY_HAND), *rows]


def _services(nodes: Graph) -> Table:
    rows = [
        (_code(name), _code(kind), node.name, "")
        for node in nodes.values()
        for name, kind in node.offers
    ]
    return [("service", "type", "node", BY_HAND), *sorted(rows)]


def _interface(node: Interface) -> Table:
    if {topic.name for topic in graph.TOPICS} <= {name for name, _ in node.subscribes}:
        return [("", "name", BY_HAND), ("subscribes to", EVERY_TOPIC, "")]
    if node.name in _WHILE_ASKED:
        return [("", "name", BY_HAND), *_WHILE_ASKED[node.name]]
    rows = [
        (
            verb.replace("service", "action") if "/action/" in kind else verb,
            _code(name),
            _code(kind),
            "",
        )
        for verb, found in (
            ("publishes", node.publishes),
            ("subscribes to", node.subscribes),
            ("offers service", node.offers),
            ("calls service", node.calls),
        )
        for name, kind in found
    ]
    return [("", "name", "type", BY_HAND), *rows]


def _parameters(node: Interface) -> Table:
    rows = [
        (
            _code(p.name),
            default_text(p),
            unit(p),
            _allowed(p),
            "" if p.read_only else "yes",
            _plain(meaning(p)),
        )
        for p in node.parameters
        if not _GAIT.fullmatch(p.name)
    ]
    return [("parameter", "default", "unit", "allowed", "live", "meaning"), *rows]


def _gaits(node: Interface) -> Table:
    """Parameters gait.<gait>.<column>, a column for each gait: its value and what is allowed."""
    columns: dict[str, dict[str, NodeParameter]] = {}
    for parameter in node.parameters:
        match = _GAIT.fullmatch(parameter.name)
        if match:
            columns.setdefault(match["column"], {})[match["gait"]] = parameter
    names = sorted({name for of_gait in columns.values() for name in of_gait})
    rows: Table = []
    for column, of_gait in columns.items():
        values = [_with_range(of_gait[name]) if name in of_gait else "" for name in names]
        one = next(iter(of_gait.values()))
        what = _plain(one.description.partition(" (")[0])
        rows.append((_code(f"gait.<gait>.{column}"), *values, unit(one), what))
    return [("parameter", *names, "unit", "meaning"), *rows]


def _mode_meanings(_: Graph) -> Table:
    rows = [(_code(mode.value), mode.meaning) for mode in Mode]
    return [("mode", "meaning"), *rows]


def _mode_conditions(_: Graph) -> Table:
    rows = [(name.replace("_", " "), refusal) for name, refusal in CONDITIONS.items()]
    return [("condition", "refused when"), *rows]


_TABLES = {
    "nodes": _nodes,
    "topics": _topics,
    "services": _services,
    "mode_meanings": _mode_meanings,
    "mode_conditions": _mode_conditions,
}
_TABLES_OF_NODE = {"interface": _interface, "parameters": _parameters, "gaits": _gaits}


# Cells ----------------------------------------------------------------------------------------
def default_text(parameter: NodeParameter) -> str:
    """Return a value as it may be typed; the ROS domain in a path is left open."""
    value = parameter.value
    if isinstance(value, str):
        domain = re.escape(Path(graph.serial_port("x", 0)).parent.name).replace("0", r"\d+")
        return _code(re.sub(domain, "husky-<ROS_DOMAIN_ID>", value)) if value else "empty"
    if isinstance(value, list):
        return _code(f"[{', '.join(map(str, value))}]")
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _with_range(parameter: NodeParameter) -> str:
    if parameter.lower == parameter.upper:
        return default_text(parameter)
    return f"{default_text(parameter)} ({_allowed(parameter)})"


def _allowed(parameter: NodeParameter) -> str:
    if parameter.lower is not None and parameter.upper is not None:
        return f"{parameter.lower:.10g} to {parameter.upper:.10g}"
    return _plain(parameter.allowed)


def _code(text: str) -> str:
    return f"`{text}`"


def _plain(text: str) -> str:
    return re.sub(r"([|<])", r"\\\1", text)


# Drawings -------------------------------------------------------------------------------------
_WIRES = (
    f'{graph.PLANT} == "serial line" ==> {graph.VN200_DRIVER}',
    f'{graph.PLANT} == "poses" ==> {graph.T265_DRIVER}',
    f'{graph.PLANT} == "depth images" ==> {graph.D435_DRIVER}',
    f'{graph.PIXHAWK_BRIDGE} <== "MAVLink" ==> {graph.FLIGHT_CONTROLLER}',
    f'{graph.RC_TRANSMITTER} == "SBUS" ==> {graph.FLIGHT_CONTROLLER}',
)
"""Edges of the graph that are no topics."""


def graph_drawing(nodes: Graph) -> list[str]:
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
            if source not in groups:
                groups[source] = f"several_{len(groups) + 1}"
                lines.append(f'state "{source}" as {groups[source]}')
            source = groups[source]
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


# Command line ---------------------------------------------------------------------------------
def changes(root: Path, nodes: Graph) -> dict[Path, tuple[str, str]]:
    """Return text before and after of each document whose tables are not as the graph is."""
    texts = {path: path.read_text("utf-8") for path in documents(root)}
    new = {path: rewrite(text, nodes) for path, text in texts.items()}
    return {path: (texts[path], new[path]) for path in texts if new[path] != texts[path]}


def difference(before: str, after: str, path: Path) -> str:
    """Return what changes in a document, as a diff."""
    lines = difflib.unified_diff(
        before.splitlines(), after.splitlines(), str(path), "the running graph", lineterm="", n=0
    )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Rewrite the documents, or with --check tell what is out of date; return 1 if anything is."""
    parser = argparse.ArgumentParser(prog="python -m husky_bringup.document", description=__doc__)
    parser.add_argument("--check", action="store_true", help="change nothing, show differences")
    parser.add_argument("--root", type=Path, default=Path(os.environ.get("HUSKY_ROOT", ".")))
    options = parser.parse_args(arguments)
    specs = all_nodes()
    try:
        with running(specs) as reader:
            nodes = reader.read(specs)
    except OccupiedError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    changed = changes(options.root, nodes)
    for path, (before, after) in changed.items():
        print(difference(before, after, path.relative_to(options.root)))
        if not options.check:
            path.write_text(after, "utf-8")
    return 1 if changed and options.check else 0


if __name__ == "__main__":
    sys.exit(main())
