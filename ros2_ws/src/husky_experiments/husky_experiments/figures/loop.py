"""Figure of a walk as the robot believes it, beside the truth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from husky_experiments.figures.style import label, make_figure, save
from husky_experiments.metrics.loop import Track


def draw_loop(tracks: Mapping[str, Track], directory: Path) -> Path:
    """Draw the ways from above, and their errors over time; return the PNG's path.

    Args:
        tracks: by the name of the frame.
        directory: that gets `loop.png`.
    """
    figure, axes = make_figure(2, 1, "The loop, as the robot believes it and as it is", (11.0, 8.0))
    above, errors = axes[:, 0]
    truth = next(iter(tracks.values()))
    above.plot(truth.true[:, 0], truth.true[:, 1], color="black", linewidth=2.5, label="truth")
    for name, told in tracks.items():
        above.plot(told.believed[:, 0], told.believed[:, 1], linewidth=1.0, label=name)
        errors.plot(told.time, told.error, label=f"{name}, at the end {told.error[-1]:.2f} m")
    above.plot([0.0], [0.0], marker=">", color="black", markersize=9)
    above.set_aspect("equal", adjustable="datalim")
    label(above, "y [m]", "x [m]", "from above")
    label(errors, "error [m]", "time [s]", "distance of the believed base from the true one")
    for axis in (above, errors):
        axis.legend(loc="best")
    directory.mkdir(parents=True, exist_ok=True)
    return save(figure, directory, "loop")
