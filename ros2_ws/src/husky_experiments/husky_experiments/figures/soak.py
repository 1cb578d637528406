"""What the processes of a soak held, over simulated time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np

from husky_experiments.figures.style import label_rows, make_figure, save
from husky_experiments.metrics.resources import Sample
from husky_experiments.metrics.soak import MEMORY_LIMIT


def draw_soak(samples: Sequence[Sample], begin: float, directory: Path) -> Path:
    """Draw memory by node as growth since the judgement begins, and descriptors, files, logs.

    Args:
        samples: of the whole soak.
        begin: time from which growth is judged [s].
        directory: where the PNG file goes; made if need be.

    Returns:
        The file written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    figure, grid = make_figure(4, 1, "What the processes hold", (13.0, 10.0), sharex=True)
    axes = grid[:, 0]
    time = np.array([sample.time for sample in samples])
    first = samples[min(int(np.searchsorted(time, begin)), len(samples) - 1)]
    names = sorted(first.nodes)
    palette = matplotlib.colormaps["tab20"]
    for index, name in enumerate(names):
        own = [(s.time, s.nodes[name].memory) for s in samples if name in s.nodes]
        times, memory = np.array(own, dtype=float).T
        colour = palette(index % 20)
        grown = (memory - first.nodes[name].memory) / 1e6
        axes[0].plot(times, grown, color=colour, linewidth=1.2, label=name)
    axes[0].axhline(MEMORY_LIMIT / 1e6, color="#d1495b", linewidth=0.8, linestyle="--")
    axes[0].set_ylim(-1.5, 1.5)
    axes[0].legend(loc="lower right", ncols=4, fontsize=8, frameon=False)
    rows = (
        [sum(usage.descriptors for usage in s.nodes.values()) for s in samples],
        [s.shared_bytes / 1e6 for s in samples],
        [s.log_bytes / 1e3 for s in samples],
    )
    for axis, values in zip(axes[1:], rows, strict=True):
        axis.plot(time, values, color="#222222", linewidth=1.2)
        axis.set_ylim(bottom=0.0)
    for axis in axes:
        axis.axvline(begin, color="#d1495b", linewidth=1.0, linestyle=":")
    label_rows(
        axes,
        ("own memory, growth [MB]", "descriptors", "/dev/shm [MB]", "log files [kB]"),
        "growth is judged from the dotted line on, against the dashed one",
    )
    return save(figure, directory, "soak")
