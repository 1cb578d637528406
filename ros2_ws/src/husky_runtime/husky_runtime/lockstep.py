"""Lockstep: who has answered for a tick, who is awaited, who is lost.

The protocol. The plant publishes the state of tick k and steps only when every *expected* peer has
answered with the stamp of k. The same rule holds one step further down: the drive bridge sends
frame k only when the controller's command of tick k - 1 is in it, and the controller computes tick
k only when the newest IMU sample due by k has arrived. Nobody waits for a time, so the trajectory
does not depend on how fast anything ran.

A peer that stays silent for the grace period (wall time) is declared lost: ticks go on without it,
so that watchdogs act. One whose process is known to have ended is lost at once. Nobody is lost
because the machine is slow: time in which its process works, or waits for a processor, or one that
it has started does, is no silence, for ten grace periods at most. Nor is time in which the process
that waits did not run (`PatientClock`). Every tick still asks one that is lost, and a world that
stands still does now and then: it is expected again as soon as it answers. Determinism ends at a
loss, and `losses` says so. At the start a peer gets a longer grace, because processes come up in
any order and discovery takes its time. One that need not be in the graph (the IMU's driver) is
awaited from the first tick on where its process is seen then, else once it has been heard.

Messages are best effort. The plant says its last word again when it has waited for a moment, and
the bridge hands that on. Whoever hears a word twice says its own last word again: the answer, if
that was lost, or the one before as a sign of life, if it waits for somebody itself. So along the
chain only the one that is really silent is declared lost. The driver of a sensor repeats the newest
of its first samples.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum

from husky_runtime.patient_clock import LONGEST_LOOK, PatientClock

START_GRACE = 30.0
"""Wall time for the first answer of a process that starts [s]."""
_BUSY_FACTOR = 10.0
"""One that is busy gets so many grace periods: it may hang."""
_LOOK = 0.1
"""Between two looks at its process: nearly all answers have come by the first [s of wall time]."""


class Presence(Enum):
    """What is known of a peer."""

    ABSENT = "absent"
    """Not heard yet, and not waited for."""
    EXPECTED = "expected"
    """Takes part: its answer is awaited."""
    LOST = "lost"
    """Took part and fell silent for longer than the grace period."""


class Peer:
    """One peer whose answer a tick waits for.

    Attributes:
        name: for reports.
        presence: see `Presence`.
        answered: stamp of its last answer [ns], -1 before the first.
        losses: how often it has been declared lost.
    """

    def __init__(
        self,
        name: str,
        grace: float = 1.0,
        start_grace: float | None = START_GRACE,
        busy: Callable[[], float | None] = lambda: 0.0,
        longest_look: float = LONGEST_LOOK,
    ):
        """Start as expected, or as absent.

        Args:
            name: for reports.
            grace: wall time that it may take to answer [s].
            start_grace: the same for its first answer [s]; None for not waiting before that.
            busy: tells for how long its process has worked or waited for a processor so far [s]; 0
                for one that cannot be seen from here, None for one that has ended.
            longest_look: most that the time between two calls of `expire` counts [s].

        Raises:
            ValueError: a grace period that is not above 0.
        """
        for period in (grace, start_grace if start_grace is not None else grace):
            if not period > 0.0:
                raise ValueError(f"grace of peer {name!r} is {period!r} s, it must be above 0")
        self.name = name
        self.grace = grace
        self.presence = Presence.ABSENT if start_grace is None else Presence.EXPECTED
        self.answered = -1
        self.losses = 0
        self._patience = grace if start_grace is None else max(grace, start_grace)
        self._busy = busy
        self._clock = PatientClock(longest_look)
        self._waiting_since: float | None = None
        self._looked_at: tuple[float, float] | None = None  # when, and how busy it was then [s]
        self._was_busy = 0.0  # since it is waited for [s]

    def expect(self, start_grace: float = 0.0) -> None:
        """From now on answers of a peer that was absent are waited for, each for the grace.

        Args:
            start_grace: wall time for the first of them, if longer [s].
        """
        if self.presence is Presence.ABSENT:
            self.presence = Presence.EXPECTED
            self._patience = max(self.grace, start_grace)
            self._wait_no_more()

    def answer(self, stamp: int) -> None:
        """The peer has answered for the tick with this stamp [ns]; a lost one is back.

        It may be an earlier tick than the one that is awaited: the peer is alive, and catches up.
        """
        if self.answered < 0:
            self._busy()  # that there is such a process can be seen now
        self.answered = max(self.answered, stamp)
        self.presence = Presence.EXPECTED
        self._patience = self.grace
        self._wait_no_more()

    def owes(self, stamp: int) -> bool:
        """Return whether it takes part, or took part, and has not answered for `stamp` [ns]."""
        return self.presence is not Presence.ABSENT and self.answered < stamp

    def ready(self, stamp: int) -> bool:
        """Return whether a tick that needs the answer for `stamp` [ns] or later may go on."""
        return self.presence is not Presence.EXPECTED or self.answered >= stamp

    def expire(self, now: float) -> bool:
        """Its answer is awaited at a monotonic wall time [s]; return whether it is just lost.

        The grace period runs from the first call after its last answer. Take in what has arrived
        before a call; calls follow one another at least twice in `longest_look`.
        """
        now = self._clock.read(now)
        if self._waiting_since is None:
            self._waiting_since = now
        if self.presence is not Presence.EXPECTED or not self._is_silent(now - self._waiting_since):
            return False
        self.presence = Presence.LOST
        self.losses += 1
        return True

    def _is_silent(self, waited: float) -> bool:
        """Return whether it has been waited for long enough [s], by what its process did."""
        looked_at, before = self._looked_at or (0.0, None)
        if waited <= min(looked_at + min(_LOOK, 0.5 * self._patience), self._lost_after):
            return False
        now = self._busy()
        if now is None:
            return True
        if before is not None:  # less than before when one that it has started has ended
            self._was_busy += min(max(0.0, now - before), waited - looked_at)
        self._looked_at = waited, now
        return waited > self._lost_after

    @property
    def _lost_after(self) -> float:
        """So long it is waited for, by what is known of its process [s]."""
        return min(self._patience + self._was_busy, _BUSY_FACTOR * self._patience)

    def _wait_no_more(self) -> None:
        self._waiting_since = self._looked_at = None
        self._was_busy = 0.0

    def restart(self, answered: int = -1) -> None:
        """Time starts again at zero: old answers no longer count.

        Args:
            answered: stamp of an answer that is already of the new time [ns], -1 for none.
        """
        self.answered = answered
        self._wait_no_more()


class Heard(Enum):
    """What an answer to the questions of an `Exchange` is."""

    NEW = "new"
    """The first answer to this question, or to a later one than the last."""
    AGAIN = "again"
    """An answer that was given before, because its question was told again."""
    COPY = "copy"
    """A second answer that nobody asked for."""
    EARLY = "early"
    """To a question that has not been asked: of a time before a restart."""


class Exchange:
    """Questions that one peer is asked tick by tick, and its answers.

    Each time that a question is told again the peer says its last word again, which answers that
    question or one before it. Whatever else comes twice is from somebody else. A slow peer may be
    told the next question again before what it owes for the last one has come, so they are counted
    by question.

    Attributes:
        peer: who answers.
        asked: stamp of the last question [ns], -1 before the first.
        answered: stamp of the newest answer [ns], -1 before the first.
    """

    def __init__(self, peer: Peer):
        """Nothing has been asked."""
        self.peer = peer
        self.asked = self.answered = -1
        self._told_again: list[int] = []

    @property
    def complete(self) -> bool:
        """Whether the last question is answered, or its answer is not waited for."""
        return self.peer.ready(self.asked)

    def ask(self, stamp: int) -> None:
        """A question with this stamp [ns] has been told."""
        self.asked = stamp

    def ask_again(self) -> None:
        """The last question has been told again."""
        self._told_again.append(self.asked)

    def hear(self, stamp: int, now: int) -> Heard:
        """Return what an answer with this stamp is; a new one counts from now on.

        Args:
            stamp: of the question that it answers [ns].
            now: stamp of the present tick [ns].
        """
        if stamp > now:
            return Heard.EARLY
        if stamp > self.answered:
            self.answered = stamp
            # It answers in order: what it owes for earlier questions will not come any more.
            self._told_again = [told for told in self._told_again if told >= stamp]
            return Heard.NEW
        owed = next((told for told in self._told_again if told >= stamp), None)
        if owed is None:
            return Heard.COPY
        self._told_again.remove(owed)
        self.peer.answer(stamp)
        return Heard.AGAIN

    def has_expired(self, now: float) -> bool:
        """Return whether the peer owes an answer and is just lost, at a monotonic wall time [s]."""
        return not self.complete and self.peer.expire(now)

    def restart(self) -> None:
        """Time starts again: nothing has been asked."""
        self.peer.restart()
        self.asked = self.answered = -1
        self._told_again.clear()
