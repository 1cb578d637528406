"""A node as the links of the controller see it, without ROS's graph."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any


class FakeNode:
    """Keeps the callback of the one subscription."""

    executor = None
    context = SimpleNamespace(get_domain_id=lambda: 103)  # in which nothing of ours is

    def get_namespace(self) -> str:
        """It is in no namespace."""
        return "/"

    def get_parameter(self, name: str) -> SimpleNamespace:
        """It is in a simulation: use_sim_time is true."""
        assert name == "use_sim_time"
        return SimpleNamespace(value=True)

    def resolve_topic_name(self, topic: str) -> str:
        """That of the graph."""
        return f"/{topic}"

    def create_subscription(
        self, kind: type, topic: str, callback: Any, profile: Any, *, raw: bool = False
    ) -> None:
        """Take a callback."""
        self.say = callback

    def create_publisher(self, kind: type, topic: str, profile: Any) -> None:
        """Nothing is published here."""
