"""Plans kept on disk: a bad one is dropped, and a disk that keeps none is done without."""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path

from husky_control.planning.collocation.request import PlanRequest
from husky_control.planning.plan import Plan, PlanFileError, load_plan

_log = logging.getLogger(__name__)


class PlanStore:
    """A directory of plan files, named by all that a plan depends on.

    Attributes:
        dropped: files that were damaged, or of another request than their name says.
        problem: why the last plan could not be kept; "" when it could.
    """

    def __init__(self, directory: Path) -> None:
        """Nothing is made before the first plan is kept."""
        self.dropped = 0
        self.problem = ""
        self._directory = directory

    def find(self, key: str, request: PlanRequest) -> Plan | None:
        """Return the plan of a request; None when there is none that can be used."""
        path = self._path(key)
        try:
            plan = load_plan(path)
        except FileNotFoundError:
            return None
        except (OSError, PlanFileError) as error:
            self._drop(path, str(error))
            return None
        if not _answers(plan, request):
            self._drop(path, f"{path} is the plan of another request")
            return None
        return plan

    def keep(self, key: str, plan: Plan) -> None:
        """Keep a plan, if the disk lets us."""
        problem = ""
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            plan.save(self._path(key))
        except OSError as error:
            problem = f"plans are not kept: {error}"
            if problem != self.problem:
                _log.warning("%s", problem)
        self.problem = problem

    def _path(self, key: str) -> Path:
        return self._directory / f"{key}.npz"

    def _drop(self, path: Path, reason: str) -> None:
        self.dropped += 1
        _log.warning("%s; dropped", reason)
        with contextlib.suppress(OSError):
            path.unlink()


def _answers(plan: Plan, request: PlanRequest) -> bool:
    """Return whether a plan is of a request, as far as it tells."""
    told = (plan.slope, plan.speed, plan.friction, plan.friction_margin, plan.thrust_mode)
    return plan.gait == request.gait_row.name and told == (
        request.slope,
        request.speed,
        request.friction,
        request.friction_margin,
        request.thrust_mode,
    )
