"""Which worker runs which test file, where there are several (`pytest -n 2`, `scripts/test.sh`).

A file is run by one worker, so that its tests share their graph. Beyond that

- the tests across containers have a worker to themselves, from the start: Fast DDS looks for
  network interfaces once a process, and these tests make one;
- one worker begins with the first file, where the graphs are, the others with the last one: a
  graph keeps two processors busy, and two take as long side by side as one after the other;
- files with real time in their name come last, when all other workers have gone: what they judge
  would be late for want of a processor.
"""

from __future__ import annotations

from typing import Any

from xdist.scheduler.loadfile import LoadFileScheduling

DOCKER = "in containers"
_DIRECTORIES = ("tests/docker/", "tests/bare/")
REALTIME = "realtime"


class SideBySide(LoadFileScheduling):  # type: ignore[misc]
    """Hands out the files from both ends of the order in which they were collected."""

    def __init__(self, config: Any, log: Any = None):
        """Prepare, with pytest's configuration and xdist's log."""
        super().__init__(config, log)
        config.option.loadscopereorder = False  # xdist's own order is by the number of tests
        self._first: Any = None  # who begins with the first file

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.split("::", 1)[0]
        if file.startswith(_DIRECTORIES):
            return DOCKER
        return REALTIME if REALTIME in file.rsplit("/", 1)[-1] else file

    def _too_early(self) -> bool:
        """Whether all that is left must wait until one worker is alone."""
        return list(self.workqueue) == [REALTIME] and len(self.nodes) > 1

    def _assign_work_unit(self, node: Any) -> None:
        if not self._too_early():
            self.workqueue.move_to_end(self._next_for(node), last=False)
            super()._assign_work_unit(node)

    def _next_for(self, node: Any) -> str:
        """Return what a worker gets next."""
        waiting = [scope for scope in self.workqueue if scope != REALTIME] or [REALTIME]
        if waiting[0] == DOCKER:
            return DOCKER
        if self._first not in self.nodes:
            self._first = node
        return waiting[0 if node is self._first else -1]

    def _reschedule(self, node: Any) -> None:
        """Give a worker that has little left its next file, or let it go when it is done."""
        if node.shutting_down or node not in self.registered_collections:
            return  # one that replaces another has its tests to collect first
        if DOCKER in self.assigned_work[node]:
            node.shutdown()
        elif not self._too_early():
            super()._reschedule(node)
        elif sum(not one.shutting_down for one in self.nodes) > 1:
            node.shutdown()  # the last one stays, and is called again when the others have gone

    def remove_node(self, node: Any) -> str | None:
        """Forget a worker that has ended; return the test that has crashed it, or None.

        The others get what that worker had not begun: not the test too, as xdist's own has it.
        """
        work = self.assigned_work.pop(node)
        left = [(unit, test) for unit in work.values() for test, over in unit.items() if not over]
        crashed = None
        if left:
            unit, crashed = left[0]
            unit[crashed] = True
            self.workqueue.update({n: u for n, u in work.items() if not all(u.values())})
        for one in self.nodes:
            self._reschedule(one)
        return crashed
