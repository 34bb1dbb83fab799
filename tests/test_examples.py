"""Examples in docstrings of public names run, and print what they say."""

import doctest

import numpy as np
import pytest

import cfjax


NAMES = sorted(cfjax.__all__)
WITH_EXAMPLES = ("Funnel", "Problem", "ball", "circle", "ellipse", "follow", "straight", "tube", "waypoints")


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_an_example_prints_what_it_says(name: str) -> None:
    public = getattr(cfjax, name)
    (example,) = doctest.DocTestFinder(recurse=False).find(public, name, globs={name: public, "np": np})
    assert example.examples
    report: list[str] = []
    doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example, out=report.append)
    assert not report, "".join(report)


def test_every_example_is_run() -> None:
    having = {name for name in NAMES if ">>> " in (getattr(cfjax, name).__doc__ or "")}
    assert having == set(WITH_EXAMPLES)
