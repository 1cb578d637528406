"""The map of slopes over friction."""

from matplotlib.axes import Axes

from husky_bringup.figure_incline import friction_map


def test_every_cell_of_the_map_is_drawn(tmp_path, monkeypatch):
    drawn, draw = {}, Axes.text

    def text(self, x, y, words, **options):
        drawn[x, y] = words
        return draw(self, x, y, words, **options)

    monkeypatch.setattr(Axes, "text", text)
    climbed = {(0.4, 30.0): 1, (0.4, 60.0): None, (0.7, 30.0): 3, (0.7, 60.0): 0}
    file = friction_map(climbed, 3, tmp_path / "figures")
    assert file.stat().st_size > 10_000
    cells = {(0, 0): "1 of 3", (1, 0): "3 of 3", (0, 1): "not tried", (1, 1): "0 of 3"}
    assert cells.items() <= drawn.items()
