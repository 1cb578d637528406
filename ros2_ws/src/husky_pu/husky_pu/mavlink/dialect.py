"""Messages that MAVLink's common set has and the dialect of pymavlink 2.4.50 has not.

`added_messages.xml` defines them; pymavlink's own generator makes their classes of it, which takes
15 ms of each process. `install` puts them into the dialect's table, once, so that every codec of
the process knows them.
"""

from __future__ import annotations

import contextlib
import io
import runpy
import tempfile
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import common as mavlink
from pymavlink.generator import mavgen_python
from pymavlink.generator.mavparse import MAVXML, PROTOCOL_2_0

ESC_BATCH = 4
"""Speed controllers that one ESC_INFO or ESC_STATUS tells of, from its index on."""
ESC_FAILURE_GENERIC = 64
"""Bit of ESC_INFO.failure_flags."""


def _generate(definitions: Path) -> dict[str, Any]:
    """Return the classes of the messages in a file of definitions, by the messages' names."""
    parsed = MAVXML(str(definitions), PROTOCOL_2_0)
    with tempfile.TemporaryDirectory() as place, contextlib.redirect_stdout(io.StringIO()):
        mavgen_python.generate(f"{place}/added.py", [parsed])
        made = runpy.run_path(f"{place}/added.py")
    return {each.name: made[f"MAVLink_{each.name.lower()}_message"] for each in parsed.message}


ADDED = _generate(Path(__file__).with_name("added_messages.xml"))
"""The messages by name."""
SetAttitudeTarget = ADDED["SET_ATTITUDE_TARGET"]
EscInfo, EscStatus = ADDED["ESC_INFO"], ADDED["ESC_STATUS"]
ProtocolVersion, ComponentMetadata = ADDED["PROTOCOL_VERSION"], ADDED["COMPONENT_METADATA"]
ESC_INFO, ESC_STATUS = EscInfo.id, EscStatus.id
PROTOCOL_VERSION, COMPONENT_METADATA = ProtocolVersion.id, ComponentMetadata.id


def install() -> None:
    """Put the messages into pymavlink's table, unless a newer pymavlink has them."""
    table = mavlink.mavlink_map
    for message in ADDED.values():
        known = table.get(message.id)
        if known is None or len(known.fieldnames) < len(message.fieldnames):
            table[message.id] = message
