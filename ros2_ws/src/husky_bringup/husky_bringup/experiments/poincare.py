"""Fixed point and eigenvalues of the closed loop's return map, for the trot on the flat (T14)."""

from __future__ import annotations

import argparse

import numpy as np

from husky_bringup import metrics
from husky_bringup.run import Run
from husky_bringup.scripts import finish, push, stand_up, walk
from husky_bringup.section import STATE, crossings, section_states, undisturbed_pairs
from husky_control.stability import fit_return_map

_PUSH = 0.1
"""Duration of a push [s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare speed, duration, perturbations and seed."""
    parser.add_argument("--speed", type=float, default=0.3, help="forward speed [m/s]")
    parser.add_argument("--duration", type=float, default=60.0, help="time to trot [s]")
    parser.add_argument("--impulse", type=float, default=2.0, help="greatest perturbation [N s]")
    parser.add_argument("--period", type=float, default=1.6, help="between perturbations [s]")
    parser.add_argument("--seed", type=int, default=0, help="of sensor noise and perturbations")


def run(run: Run) -> None:
    """Every eigenvalue inside the unit circle, from steps that follow small random pushes."""
    options = run.options
    random = np.random.default_rng(options.seed)
    velocity = (options.speed, 0.0, 0.0)
    pushes = []
    with run.session({"plant": {"seed": options.seed}}, expected=options.duration + 12) as session:
        stand_up(session)
        session.set_gait("trot")
        walk(session, 3.0, velocity)
        start = session.time
        while session.time < start + options.duration:
            angle, size = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.3, 1.0)
            impulse = size * options.impulse
            pushes.append(session.time)
            push(session, (impulse * float(np.cos(angle)), impulse * float(np.sin(angle))), _PUSH)
            walk(session, options.period, velocity)
        end = session.time
        falls = finish(session)
        run.metrics["trajectory_sha256"] = session.trajectory_sha256
    recording = run.recording()
    times = crossings(recording, start, end)
    states = section_states(recording, times)
    pairs = undisturbed_pairs(times, np.array(pushes), _PUSH)
    result = fit_return_map(states[pairs], states[pairs + 1])
    moduli = np.abs(result.eigenvalues)
    run.metrics |= metrics.summary(recording, run.robot(), start, end)
    run.metrics["steps_used"] = len(pairs)
    run.metrics["fixed_point"] = dict(zip(STATE, result.fixed_point.tolist(), strict=True))
    run.metrics["residual_rms"] = dict(zip(STATE, result.residual.tolist(), strict=True))
    run.metrics["eigenvalue_moduli"] = moduli.tolist()
    run.metrics["eigenvalues"] = [[z.real, z.imag] for z in result.eigenvalues.tolist()]
    run.require("falls", falls, upper=0)
    run.require("largest_eigenvalue_modulus", float(moduli[0]), upper=0.999)
    run.illustrate()
