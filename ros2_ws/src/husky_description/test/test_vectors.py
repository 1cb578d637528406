"""Vectors of kernels against NumPy."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from husky_description.vectors import column, cross, dot, product, product_plus, scaled, vector

NUMBER = st.floats(-1e3, 1e3)
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER)
CLOSE = {"rtol": 1e-12, "atol": 1e-6}  # sums of three products of numbers up to 1e3


@given(VECTOR, VECTOR, NUMBER)
def test_products_of_vectors(a, b, factor):
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), **CLOSE)
    np.testing.assert_allclose(dot(a, b), np.dot(a, b), **CLOSE)
    np.testing.assert_allclose(scaled(factor, a), factor * np.array(a), **CLOSE)


@given(VECTOR, VECTOR, VECTOR, VECTOR)
def test_products_with_a_matrix(first, second, third, a):
    matrix = np.array([first, second, third])
    np.testing.assert_allclose(product(matrix, a), matrix @ a, **CLOSE)
    np.testing.assert_allclose(product_plus(matrix, a, first), matrix @ a + first, **CLOSE)
    assert column(matrix, 1) == (first[1], second[1], third[1])
    assert vector(matrix[2]) == third
