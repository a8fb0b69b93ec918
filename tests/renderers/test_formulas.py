"""Parts of the formulas' renderer beside their definitions, pixel by pixel."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from malus.renderers.torrance_sparrow import masking, sphere_normals
from malus.scenes import Camera


@pytest.mark.parametrize("half_width", [1.05, 0.6])
def test_a_pixel_is_the_spheres_where_all_its_corners_are(half_width: float) -> None:
    camera = Camera(resolution=9, half_width=half_width)
    normals, mask = sphere_normals(camera)
    step = 2 * half_width / 9
    for row, column in itertools.product(range(9), repeat=2):
        corners = itertools.product((row, row + 1), (column, column + 1))
        inside = all(
            np.hypot(x * step - half_width, y * step - half_width) <= 1 for y, x in corners
        )
        assert mask[row, column] == inside, (row, column)
        if inside:
            x, y = (column + 0.5) * step - half_width, half_width - (row + 0.5) * step
            np.testing.assert_allclose(normals[row, column], [x, y, np.sqrt(1 - x * x - y * y)])


def test_v_cavities_hide_as_much_of_the_light_as_of_the_view() -> None:
    """Torrance and Sparrow's G, and Helmholtz: light and viewer may change places."""
    random = np.random.default_rng(0)
    n_h, n_v, n_l = random.uniform(0.05, 1, (3, 50))
    v_h = 0.8
    expected = [
        min(1.0, 2 * h * v / v_h, 2 * h * lit / v_h)
        for h, v, lit in zip(n_h, n_v, n_l, strict=True)
    ]
    np.testing.assert_allclose(masking(n_h, n_v, n_l, v_h), expected, rtol=1e-14)
    np.testing.assert_array_equal(masking(n_h, n_l, n_v, v_h), masking(n_h, n_v, n_l, v_h))
