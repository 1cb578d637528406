"""The sweep over frames that bend: how soft a frame may be, and what has to hold."""

from argparse import Namespace

import pytest

from husky_experiments.catalogue import compliance
from husky_experiments.catalogue.compliance import softest
from husky_experiments.run import Run

FREQUENCIES = [40.0, 15.0, 10.0]


@pytest.mark.parametrize(
    ("holds", "lowest"),
    [
        ((0.0, 40.0, 15.0, 10.0), "10_hz"),
        ((0.0, 40.0, 10.0), "40_hz"),
        ((0.0,), "stiff"),
        ((40.0, 15.0, 10.0), "none"),
    ],
)
def test_the_softest_frame_is_the_last_before_a_criterion_fails(holds, lowest):
    found = {hz: {"ok": hz in holds} for hz in (10.0, 0.0, 40.0, 15.0)}
    assert softest(found) == lowest


def swept(monkeypatch, tmp_path, holds_from, **options):
    """The sweep with runs whose criteria hold from a frequency on, by case; 0: with none."""

    runs = []

    def run_case(run, case, hz):
        least = holds_from[case]
        roll = None if case == "hover" else 0.5
        runs.append((case, hz))
        return {"ok": bool(least) and (hz == 0.0 or hz >= least), "roll_rms_deg": roll}

    monkeypatch.setattr(compliance, "_run_case", run_case)
    chosen = {"compliance": FREQUENCIES, "cases": 2 * list(holds_from), "seed": 0}
    run = Run(
        "compliance", Namespace(output=tmp_path / "out", no_figures=False, **(chosen | options))
    )
    compliance.run(run)
    assert len(runs) == len(set(runs)) == (1 + len(chosen["compliance"])) * len(holds_from)
    return run


@pytest.mark.parametrize(
    ("holds_from", "ok"),
    [
        ({"trot": 10.0, "wair_30": 15.0, "hover": 40.0}, True),
        ({"trot": 40.0, "wair_30": 10.0}, False),
        ({"trot": 10.0, "hover": 0.0}, False),
        ({"wair_45": 100.0, "hover": 100.0}, True),
    ],
)
def test_trot_and_gentle_climb_have_to_hold_at_15_hz(monkeypatch, tmp_path, holds_from, ok):
    run = swept(monkeypatch, tmp_path, holds_from)
    assert run.ok is ok
    assert (run.output / "figures/compliance.png").stat().st_size > 10_000


def test_a_part_of_a_run_has_criteria_of_its_own(tmp_path):
    run = Run("compliance", Namespace(output=tmp_path / "out", seed=3, speed=1.0))
    part = run.part("trot", Namespace(speed=0.5))
    part.metrics["falls"] = 1
    part.require("falls", upper=0)
    assert (part.options.seed, part.options.speed, run.options.speed) == (3, 0.5, 1.0)
    assert part.output == run.output / "trot"
    assert not part.ok and not run.criteria and not run.metrics
