"""`python -m cfjax.simulate FOLDER`: experiments with a certified run."""
