"""MAVLink's two parameter protocols on one link, of the same parameters.

PARAM_*: a value stands in a float field, an integer's bytes as they are (PX4's way). PARAM_EXT_*: a
value's bytes stand in a text of 128. What cannot be done is answered PARAM_ERROR and, where a value
was to be set, with the value that holds, for clients that do not know PARAM_ERROR.

Source: mavlink.io/en/services/parameter.html, parameter_ext.html.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from husky_pu.autopilot.flight_parameters import (
    TABLE,
    FlightParameters,
    ParameterError,
    ParameterType,
    UnknownParameterError,
    from_wire,
    to_wire,
)
from husky_pu.autopilot.mavlink_ftp import crc32

HASH_CHECK = "_HASH_CHECK"
"""Stands for all parameters: its value changes when any of them does (PX4, QGroundControl)."""
_NAMES = tuple(TABLE)
_INDEX = {name: index for index, name in enumerate(_NAMES)}
_NO_INDEX = 0xFFFF
_FORMATS = {ParameterType.INT32: "<i", ParameterType.REAL32: "<f"}
_TEXT_SIZE = 128


class ParameterTalk:
    """The parameter protocols' side of a link."""

    def __init__(self, parameters: FlightParameters, send: Callable[[Any], None]):
        """Begin without a list under way; `send` puts a message on the link."""
        self._parameters = parameters
        self._send = send
        self._listed = self._listed_extended = len(_NAMES)
        self.listing = False

    def send_next(self) -> None:
        """Send one parameter of each list under way."""
        if self._listed < len(_NAMES):
            self.tell(_NAMES[self._listed])
            self._listed += 1
        if self._listed_extended < len(_NAMES):
            self._tell_extended(_NAMES[self._listed_extended])
            self._listed_extended += 1
        self.listing = min(self._listed, self._listed_extended) < len(_NAMES)

    # PARAM_* ------------------------------------------------------------------------------------
    def request_list(self, m: Any) -> None:
        """Answer PARAM_REQUEST_LIST: every parameter, one a tick."""
        self._listed = 0
        self.listing = True

    def request_read(self, m: Any) -> None:
        """Answer PARAM_REQUEST_READ: by index, or by name when that is -1."""
        name = _named(m)
        if name in TABLE:
            self.tell(name)
        elif m.param_id == HASH_CHECK and m.param_index == -1:
            self._tell_hash()
        else:
            self._refuse(m, UnknownParameterError(name))

    def set(self, m: Any) -> str:
        """Carry PARAM_SET out and answer with the value that holds; return why it was refused."""
        name = m.param_id
        if name == HASH_CHECK:
            # "I have them all": no answer, or the two would go on for ever.
            if struct.pack("<f", m.param_value) == struct.pack("<I", self._hash()):
                self._listed = len(_NAMES)
            return ""
        problem = ""
        try:
            _check_type(name, m.param_type)
            self._parameters.keep(name, from_wire(m.param_value, m.param_type))
        except ParameterError as error:
            problem = str(error)
            self._refuse(m, error)
        if name in TABLE:
            self.tell(name)
        return problem

    def tell(self, name: str) -> None:
        """Send PARAM_VALUE."""
        self._send_value(name, to_wire(self._parameters[name]), TABLE[name].type, _INDEX[name])

    def _tell_hash(self) -> None:
        field = struct.unpack("<f", struct.pack("<I", self._hash()))[0]
        self._send_value(HASH_CHECK, field, mavlink.MAV_PARAM_TYPE_UINT32, _NO_INDEX)

    def _send_value(self, name: str, field: float, type_: int, index: int) -> None:
        self._send(
            mavlink.MAVLink_param_value_message(name.encode(), field, type_, len(_NAMES), index)
        )

    def _hash(self) -> int:
        """Return the checksum of names and values, by name, as PX4 makes it."""
        state = 0
        for name in sorted(_NAMES):
            state = crc32(name.encode() + self._bytes(name), state)
        return state

    def _refuse(self, m: Any, error: ParameterError) -> None:
        self._send(
            mavlink.MAVLink_param_error_message(
                m.get_srcSystem(),
                m.get_srcComponent(),
                bytes(m._param_id_raw),
                getattr(m, "param_index", -1),
                error.number,
            )
        )

    # PARAM_EXT_* --------------------------------------------------------------------------------
    def request_extended_list(self, m: Any) -> None:
        """Answer PARAM_EXT_REQUEST_LIST: every parameter, one a tick."""
        self._listed_extended = 0
        self.listing = True

    def request_extended_read(self, m: Any) -> None:
        """Answer PARAM_EXT_REQUEST_READ; this protocol has no word for a name that is unknown."""
        name = _named(m)
        if name in TABLE:
            self._tell_extended(name)
        else:
            self._refuse(m, UnknownParameterError(name))

    def set_extended(self, m: Any) -> str:
        """Carry PARAM_EXT_SET out and answer PARAM_EXT_ACK; return why it was refused."""
        name, problem = m.param_id, ""
        value = bytes(m._param_value_raw).ljust(_TEXT_SIZE, b"\0")  # the decoder strips zeros
        result = mavlink.PARAM_ACK_ACCEPTED
        try:
            _check_type(name, m.param_type)
            form = _FORMATS[TABLE[name].type]
            self._parameters.keep(name, struct.unpack_from(form, value)[0])
        except ParameterError as error:
            problem = str(error)
            unknown = isinstance(error, UnknownParameterError)
            result = mavlink.PARAM_ACK_FAILED if unknown else mavlink.PARAM_ACK_VALUE_UNSUPPORTED
        held = self._bytes(name) if name in TABLE else value
        self._send(
            mavlink.MAVLink_param_ext_ack_message(
                bytes(m._param_id_raw), held.ljust(_TEXT_SIZE, b"\0"), m.param_type, result
            )
        )
        return problem

    def _tell_extended(self, name: str) -> None:
        self._send(
            mavlink.MAVLink_param_ext_value_message(
                name.encode(),
                self._bytes(name).ljust(_TEXT_SIZE, b"\0"),
                TABLE[name].type,
                len(_NAMES),
                _INDEX[name],
            )
        )

    def _bytes(self, name: str) -> bytes:
        return struct.pack(_FORMATS[TABLE[name].type], self._parameters[name])


def _named(m: Any) -> str:
    """Return the name that a request means, "" for an index that there is not."""
    if m.param_index < 0:
        return str(m.param_id)
    return _NAMES[m.param_index] if m.param_index < len(_NAMES) else ""


def _check_type(name: str, type_: int) -> None:
    """Raise ParameterError unless a parameter is there and of a type."""
    row = TABLE.get(name)
    if row is None:
        raise UnknownParameterError(name)
    if row.type != type_:
        raise ParameterError(f"{name}: type must be {row.type.name}")
