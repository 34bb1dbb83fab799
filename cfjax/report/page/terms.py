"""What states and inputs are called on the page, with their units."""

STATES = {"alpha": "heading α (rad)", "x": "lateral x (m)", "y": "longitudinal y (m)", "v": "speed v (m/s)"}
INPUTS = {"u0": "timing u₀", "w": "steering w = tan γ", "thrust": "thrust T (m/s²)"}


def state_label(name: str) -> str:
    """A deviation's name, with its unit where it is one of the bicycle's."""
    return STATES.get(name, name)


def input_label(name: str) -> str:
    return INPUTS.get(name, name)
