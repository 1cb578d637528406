"""What the flight controller tells about itself in files: MAVLink's component metadata, as JSON.

COMPONENT_METADATA names the general file, which names the others; a ground station fetches them
over MAVLink's file transfer protocol and knows each parameter's range, unit and meaning.

Source: mavlink.io/en/services/component_information.html.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from husky_pu.autopilot.flight_parameters import TABLE, FlightParameter, ParameterType
from husky_pu.autopilot.mavlink_ftp import crc32

GENERAL, PARAMETERS = "/general.json", "/parameters.json"
"""Paths of the files."""
_PARAMETER_METADATA = 1
"""COMP_METADATA_TYPE of PARAMETERS."""
_TYPES = {ParameterType.INT32: "Int32", ParameterType.REAL32: "Float"}
_UNIT = re.compile(r" \[([^\]]+)\]")


def uri(path: str) -> str:
    """Return the address of a file of ours on MAVLink."""
    return f"mftp://{path}"


def component_files(defaults: Mapping[str, float]) -> dict[str, bytes]:
    """Return the files by path; `defaults` hold before anybody has set a parameter."""
    parameters = _to_json([_parameter(row, defaults[name]) for name, row in TABLE.items()])
    general = {
        "version": 1,
        "metadataTypes": [
            {
                "type": _PARAMETER_METADATA,
                "uri": uri(PARAMETERS),
                "fileCrc": crc32(parameters),
            }
        ],
    }
    return {GENERAL: json.dumps(general).encode(), PARAMETERS: parameters}


def _to_json(parameters: list[dict[str, Any]]) -> bytes:
    return json.dumps({"version": 1, "parameters": parameters}, separators=(",", ":")).encode()


def _parameter(row: FlightParameter, default: float) -> dict[str, Any]:
    """Return a parameter as the schema has it."""
    entry = {
        "name": row.name,
        "type": _TYPES[row.type],
        "group": row.name.split("_", 1)[0],
        "shortDesc": row.description,
        "default": default,
        "min": row.lower,
        "max": row.upper,
    }
    unit = _UNIT.search(row.description)
    if unit is not None:
        entry["units"] = unit[1]
    return entry
