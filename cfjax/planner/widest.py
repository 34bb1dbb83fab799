"""Where a map is too narrow: the widest way between two places, and its narrowest gap."""

import numpy as np
from scipy import ndimage

from cfjax.planner.field import Field


HALVINGS = 12  # of the interval in which the gap's half-width lies


def widest_gap(field: Field, first: complex, second: complex) -> tuple[float, complex]:
    """Half the width (m) of the narrowest gap on the widest way, below zero where obstacles block every way, and where.

    As far as the grid tells.
    """
    rows, columns = field.distance.shape
    cells = [
        (int(np.clip(round(at.imag), 0, rows - 1)), int(np.clip(round(at.real), 0, columns - 1)))
        for at in ((first - field.origin) / field.step, (second - field.origin) / field.step)
    ]

    def regions(least: float) -> np.ndarray:
        """Numbers of the regions with so much room, 0 where there is less."""
        found = np.zeros(field.distance.shape, int)
        ndimage.label(field.distance >= least, np.ones((3, 3)), found)
        return found

    low, high = float(field.distance.min()), min(float(field.distance[cell]) for cell in cells)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        found = regions(middle)
        low, high = (middle, high) if found[cells[0]] == found[cells[1]] != 0 else (low, middle)
    found = regions(high)
    apart = [np.asarray(ndimage.distance_transform_edt(found != found[cell])) for cell in cells]
    row, column = np.unravel_index(np.argmin(sum(apart) + 1e3 * (field.distance < low)), found.shape)
    return low, field.origin + field.step * complex(float(column), float(row))
