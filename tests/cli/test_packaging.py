"""The pins: exact versions and nothing that names a place."""

import importlib
import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement


ROOT = Path(__file__).parents[2]
MARKER = "[a-z_]+ [<>=!]+ '[0-9A-Za-z.]+'"


@pytest.mark.parametrize("name", ["requirements.txt", "requirements-dev.txt", "requirements-ray.txt"])
def test_every_requirement_is_pinned_and_names_no_place(name: str) -> None:
    lines = (ROOT / name).read_text().splitlines()
    assert lines
    for line in lines:
        assert re.fullmatch(r"[a-z0-9-]+==[0-9a-z.]+( ; MARKER( and MARKER)*)?".replace("MARKER", MARKER), line), line


@pytest.mark.parametrize("python", ["3.11", "3.12"])
def test_pins_satisfy_the_project_on_both_pythons(python: str) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *(extra for group in extras.values() for extra in group)]
    place = {"python_full_version": f"{python}.0", "python_version": python}
    pinned = {}
    for line in (ROOT / "requirements-ray.txt").read_text().splitlines():
        pin = Requirement(line)
        if pin.marker is None or pin.marker.evaluate(place):
            assert pin.name not in pinned
            pinned[pin.name] = pin.specifier
    for requirement in (one for one in map(Requirement, wanted) if one.name != project["name"]):
        (version,) = pinned[requirement.name]
        assert version.version in requirement.specifier


def test_each_set_holds_the_smaller_ones() -> None:
    names = ("requirements.txt", "requirements-dev.txt", "requirements-ray.txt")
    run, dev, ray = (set((ROOT / name).read_text().splitlines()) for name in names)
    assert run < dev < ray


def test_every_command_that_is_installed_is_there() -> None:
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    assert scripts.keys() == {"cfjax", "cfjax-train", "cfjax-check", "cfjax-simulate", "cfjax-export", "cfjax-gather"}
    for target in scripts.values():
        module, _, name = target.partition(":")
        assert callable(getattr(importlib.import_module(module), name))
