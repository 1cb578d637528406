"""Parameters that are refused."""

import pytest

from husky_navigation.map_parameters import MapParameters


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"resolution": 0.0}, r"resolution: 0\.0"),
        ({"gate": float("nan")}, "gate: nan"),
        ({"least_support": 2.5}, "least_support: 2.5"),
        ({"least_depth": 1.9, "most_depth": 0.6}, "least_depth: 1.9 is not below most_depth, 0.6"),
        ({"length": 8.02}, "length: 8.02 is not an even number of cells of 0.04 m"),
        ({"resolution": 0.01, "length": 40.0}, "length: 40.0 is 4000 cells of 0.01 m, .* 1000 at"),
        ({"length": 8.04}, "length: 8.04 is not an even number of cells"),
    ],
)
def test_a_bad_parameter_is_named(changed, message):
    with pytest.raises(ValueError, match=message):
        MapParameters(**changed)


def test_map_has_the_size_of_the_issue():
    assert MapParameters().cells == 200
