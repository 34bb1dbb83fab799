"""What is loaded before a command has something to do: no more than a refusal, a help text or a replay needs."""

import importlib
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import cfjax
from cfjax.tubes import library_files


HEAVY = {"jax", "jaxlib", "scipy", "cvxpy", "matplotlib", "plotly", "optax", "equinox", "polars", "shapely", "jinja2"}
LAZY = ("cfjax", "cfjax.problem", "cfjax.funnel", "cfjax.learner", "cfjax.solver", "cfjax.export", "cfjax.report.page")


def loaded(*arguments: str) -> tuple[int, str, set[str]]:
    """Exit code of a Python process, what it said, and the modules that it imported."""
    run = subprocess.run(
        [sys.executable, "-X", "importtime", *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        cwd=Path(cfjax.__file__).parents[1],
    )
    pattern = r"^import time: +\d+ \| +\d+ \| +(\S+)$"
    said = run.stdout + re.sub(pattern + "\n", "", run.stderr, flags=re.M)
    modules = set(re.findall(pattern, run.stderr, flags=re.M))
    assert "argparse" in modules or "numpy" in modules  # else nothing was seen
    return run.returncode, said, modules


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["cfjax.train", "--help"], 0, "path: circle, ellipse"),
        (["cfjax.train", "--method"], 2, "expected key=value or a flag"),
        (["cfjax.train", "+path=circl"], 2, "path: expected one of circle, ellipse"),
        (["cfjax.train", "+path=circle", "margn=3"], 2, "margn: no such key"),
        (["cfjax.train", "+path=circle", "path.radus=3"], 2, "path.radus: no such key"),
        (["cfjax.train", "+path=circle", "cars=many"], 2, "cars: expected a whole number, got many"),
        (["cfjax.train", "-m", "+path=circle", "margn=3,4"], 2, "margn: no such key"),
        (["cfjax.simulate", "--help"], 0, "plants, NAME"),
        (["cfjax.export", "--help"], 0, "usage"),
        (["cfjax.gather", "nowhere"], 2, "SWEEP: expected the folder of a sweep"),
        (["cfjax.report", "nowhere"], 2, "folder: expected a run's folder or a sweep's"),
        (["cfjax.gather", "--help"], 0, "usage"),
        (["cfjax.report", "--help"], 0, "usage"),
    ],
)
def test_help_and_refusals_load_nothing_heavy(arguments: list[str], code: int, said: str) -> None:
    returned, text, modules = loaded("-m", *arguments)
    assert (returned, said in text) == (code, True), text
    assert not {name.partition(".")[0] for name in modules} & HEAVY


def test_a_replay_loads_the_checker_alone() -> None:
    returned, text, modules = loaded("-m", "cfjax.check", str(library_files()[0]))
    assert returned == 0 and "PROVEN" in text
    assert not {name.partition(".")[0] for name in modules} & (HEAVY | {"numpy", "hydra"})


def test_a_run_begins_without_what_only_its_end_needs() -> None:
    returned, _, modules = loaded("-c", "import cfjax, cfjax.synthesis; cfjax.Problem(cfjax.circle())")
    assert returned == 0 and "jax" in modules
    assert not {name.partition(".")[0] for name in modules} & {"cvxpy", "matplotlib", "plotly", "polars", "jinja2"}
    assert not {"scipy.interpolate", "scipy.ndimage", "scipy.stats"} & modules


@pytest.mark.parametrize("name", LAZY)
def test_rooms_have_their_names_on_first_use(name: str) -> None:
    room = importlib.import_module(name)
    modules = {module.name for module in pkgutil.iter_modules(room.__path__)}
    for public in room.__all__:
        if public in modules:  # which would stand in the name's place
            importlib.import_module(f"{name}.{public}")
        assert not isinstance(getattr(room, public), ModuleType)
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'nothing'"):
        importlib.import_module(name).__getattr__("nothing")
