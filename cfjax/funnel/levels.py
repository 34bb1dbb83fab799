"""Levels of V between which it decreases."""

from cfjax.coerce import real, refuse


def inner_level(value: object, beta_lower: float) -> float | None:
    """β_in; None where no lower level than β̲ is wanted.

    Raises:
        InputError: unless it is above 0 and at most β̲.
    """
    if value is None:
        return None
    level = real(value)
    if level is None or not 0 < level <= beta_lower:
        refuse("beta_inner", f"a number above 0 and at most beta_lower = {beta_lower}", value)
    return level
