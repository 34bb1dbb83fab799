"""The paper's figures, and a comparison that goes further: `python -m experiments.figures NAME`."""
