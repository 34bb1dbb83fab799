"""What states and inputs are called in pictures and on the page, with their units."""

STATES = {"alpha": "heading α (rad)", "x": "lateral x (m)", "y": "longitudinal y (m)", "v": "speed v (m/s)"}
SHORT = {"alpha": "α (rad)", "x": "x (m)", "y": "y (m)", "v": "v (m/s)"}
INPUTS = {"u0": "timing u₀", "w": "steering w = tan γ", "thrust": "thrust (m/s²)"}


def short_label(name: str) -> str:
    """Of a column: the letter alone."""
    return SHORT.get(name, name)


def state_label(name: str) -> str:
    """A deviation's name, with its unit where it is one of the bicycle's."""
    return STATES.get(name, name)


def input_label(name: str) -> str:
    return INPUTS.get(name, name)
