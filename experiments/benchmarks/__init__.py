"""The field's own benchmarks, and what is proven of them; `python -m experiments.benchmarks` prints the table."""
