"""A client of Foxglove's websocket protocol that knows no ROS: it decodes by what it is told."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from websocket_client import WebsocketClient

PROTOCOL = "foxglove.sdk.v1"
_MESSAGE = struct.Struct("<BIQ")
_CALL = struct.Struct("<BIII")
_ANSWER = struct.Struct("<BIII")


@dataclass(frozen=True)
class Received:
    """A message, by the schema that the server has given.

    Attributes:
        log_time: that it was sent with [ns].
        data: as it came, with its header of 4 bytes [CDR].
        message: decoded, with the fields of its type.
    """

    log_time: int
    data: bytes
    message: Any


class FoxgloveClient(WebsocketClient):
    """A connection, and everything that has come over it.

    Attributes:
        channels: topics that are offered, by name, as the server describes them.
        services: the same of services.
        received: by topic.
        statuses: texts of the server, in order.
        parameters: newest value by name.
        answers: payload by number of the call, or the reason of a failure.
        time: newest time that the server has told [ns].
    """

    def __init__(self, address: str, **options: Any):
        """Connect; options are those of `websockets.sync.client.connect`.

        Raises:
            websockets.exceptions.InvalidHandshake: it is refused.
        """
        self.channels: dict[str, dict[str, Any]] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.received: dict[str, list[Received]] = {}
        self.statuses: list[str] = []
        self.parameters: dict[str, Any] = {}
        self.answered: set[str] = set()
        self.answers: dict[int, bytes | str] = {}
        self.time = 0
        self._topics: dict[int, str] = {}
        self._stores: dict[str, Any] = {}
        self._calls = 0
        super().__init__(address, subprotocols=[PROTOCOL], **options)

    # What it asks ---------------------------------------------------------------------------
    def say(self, **message: Any) -> None:
        """Send a message of the protocol."""
        self._socket.send(json.dumps(message))

    def subscribe(self, topic: str) -> list[Received]:
        """Listen to a topic; return the list that its messages will be in."""
        number = len(self._topics) + 1
        self._topics[number] = topic
        channel = self.channels[topic]
        self._stores[topic] = _typestore(channel["schema"], channel["schemaName"])
        heard = self.received.setdefault(topic, [])
        subscription = {"id": number, "channelId": channel["id"]}
        self.say(op="subscribe", subscriptions=[subscription])
        return heard

    def unsubscribe(self, topic: str) -> None:
        """Listen no longer."""
        numbers = [number for number, name in self._topics.items() if name == topic]
        self.say(op="unsubscribe", subscriptionIds=numbers)

    def call(self, service: str, payload: bytes = b"\0\1\0\0\0") -> int:
        """Call a service; return the number of the call.

        Args:
            service: its name.
            payload: the request [CDR]; by default one without fields.
        """
        self._calls += 1
        head = _CALL.pack(2, self.services[service]["id"], self._calls, 3)
        self._socket.send(head + b"cdr" + payload)
        return self._calls

    def get_parameters(self, *names: str) -> str:
        """Ask for parameters; return what will be in `answered`."""
        self._calls += 1
        self.say(op="getParameters", parameterNames=names, id=str(self._calls))
        return str(self._calls)

    def set_parameter(self, name: str, value: Any) -> str:
        """Set a parameter; return what will be in `answered`."""
        self._calls += 1
        parameters = [{"name": name, "value": value}]
        self.say(op="setParameters", parameters=parameters, id=str(self._calls))
        return str(self._calls)

    def advertise(self, topic: str, schema: str, number: int = 1, encoding: str = "cdr") -> None:
        """Say that it will publish."""
        channel = {"id": number, "topic": topic, "encoding": encoding, "schemaName": schema}
        self.say(op="advertise", channels=[channel])

    def publish(self, data: bytes, number: int = 1) -> None:
        """Publish on what it has advertised."""
        self._socket.send(struct.pack("<BI", 1, number) + data)

    # What comes -----------------------------------------------------------------------------
    def _take(self, data: str | bytes) -> None:
        if isinstance(data, str):
            self._texts[json.loads(data)["op"]](self, json.loads(data))
        else:
            self._binaries[data[0]](self, data)

    def _on_advertise(self, message: dict[str, Any]) -> None:
        self.channels |= {channel["topic"]: channel for channel in message["channels"]}

    def _on_services(self, message: dict[str, Any]) -> None:
        self.services |= {service["name"]: service for service in message["services"]}

    def _on_gone(self, message: dict[str, Any]) -> None:
        gone = message["serviceIds"]
        self.services = {n: s for n, s in self.services.items() if s["id"] not in gone}

    def _on_parameters(self, message: dict[str, Any]) -> None:
        self.parameters |= {each["name"]: each.get("value") for each in message["parameters"]}
        self.answered.add(message.get("id", ""))

    def _on_failure(self, message: dict[str, Any]) -> None:
        self.answers[message["callId"]] = message["message"]

    def _on_data(self, message: bytes) -> None:
        _, number, log_time = _MESSAGE.unpack_from(message)
        topic, data = self._topics[number], message[_MESSAGE.size :]
        store, kind = self._stores[topic], self.channels[topic]["schemaName"]
        self.received[topic].append(Received(log_time, data, store.deserialize_cdr(data, kind)))

    def _on_time(self, message: bytes) -> None:
        self.time = struct.unpack_from("<Q", message, 1)[0]

    def _on_answer(self, message: bytes) -> None:
        _, _, call, length = _ANSWER.unpack_from(message)
        self.answers[call] = message[_ANSWER.size + length :]

    _texts: ClassVar[dict[str, Callable[..., None]]] = {
        "serverInfo": lambda self, message: None,
        "advertise": _on_advertise,
        "unadvertise": lambda self, message: None,
        "advertiseServices": _on_services,
        "unadvertiseServices": _on_gone,
        "parameterValues": _on_parameters,
        "serviceCallFailure": _on_failure,
        "status": lambda self, message: self.statuses.append(message["message"]),
    }
    _binaries: ClassVar[dict[int, Callable[..., None]]] = {1: _on_data, 2: _on_time, 3: _on_answer}


def _typestore(schema: str, kind: str) -> Any:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema, kind))
    return store
