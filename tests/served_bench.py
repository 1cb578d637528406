"""The process of a node that serves a website or websockets, wherever it does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from node_bench import NodeBench, values_of
from websockets.exceptions import InvalidStatus

from husky_runtime.nodes.diagnostics import PERIOD


class ServedBench(NodeBench):
    """A bench whose process reports an address.

    Attributes:
        address: where it serves, without a token.
        clients: that have been made; whoever makes them adds them.
    """

    def __init__(self, domain: int, directory: Path, module: str):
        """Join the domain; the process is started by `serve`."""
        super().__init__(domain, directory, module)
        self.clients: list[Any] = []
        self.address = self._told = ""
        self._parameters: dict[str, Any] | None = None

    def serve(self, **parameters: Any) -> None:
        """Let the process run with these parameters; wait until it serves."""
        if parameters == self._parameters and self.process and self.process.poll() is None:
            return
        self.end()
        self._parameters = parameters
        self.start(**{PERIOD: 0.05, "port": 0, **parameters})

        def is_new(report: DiagnosticStatus) -> bool:  # one of the process before may come late
            return values_of(report).get("address", "") not in ("", self._told)

        self._told = self.address = self.wait_for_report(is_new, "a report")["address"]

    def leave(self) -> None:
        """Let the clients go."""
        for client in self.clients:
            client.close()
        self.clients.clear()

    def value(self, name: str) -> int:
        """Return a number of the newest report."""
        return int(values_of(self.reports[-1])[name]) if self.reports else 0

    def crowd(self, connect: Callable[[], object], count: int = 50) -> tuple[int, int]:
        """Let many come at once; return how many are served, and how many are refused."""
        served = 0
        for _ in range(count):
            try:
                connect()
                served += 1
            except InvalidStatus as error:
                assert error.response.status_code == 503
        return served, count - served

    def resident_mb(self) -> float:
        """Return the process's resident memory [MB]."""
        assert self.process is not None
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(status.split("VmRSS:")[1].split()[0]) / 1e3

    def begin_anew(self) -> None:
        """Let the clients go; the process serves on, as if none had been there."""
        self.leave()
        if self.process is not None and self.process.poll() is None:
            self.wait_for_report(lambda each: values_of(each)["connections"] == "0", "their end")

    def _give_back(self) -> None:
        self.leave()
        super()._give_back()
