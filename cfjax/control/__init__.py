"""From a funnel to inputs: the laws that a car runs."""

from cfjax.control.min_norm import (
    MinNormLaw,
    min_norm_input,
    min_norm_law,
    nearest_in_box,
    path_point,
)


__all__ = ["MinNormLaw", "min_norm_input", "min_norm_law", "nearest_in_box", "path_point"]
