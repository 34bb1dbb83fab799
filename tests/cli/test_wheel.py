"""The wheel, in an environment of its own and outside the checkout: what it holds, and that the commands work.

The environment sees the pinned packages of the one that runs the tests, and cfjax from the wheel alone: seconds
instead of the gigabyte that `scripts/newcomer` installs.
"""

import json
import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from cfjax.export.ros2 import FILES


ROOT = Path(__file__).parents[2]
PRESETS = "cfjax/conf/presets"  # where the wheel carries conf/
Command = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel", "--quiet", "--no-deps"]
    subprocess.run([*pip, "--wheel-dir", str(folder), str(ROOT)], check=True)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def command(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Command:
    """A command of the environment that the wheel is installed in, run in a folder that holds nothing."""
    env, elsewhere = tmp_path_factory.mktemp("env"), tmp_path_factory.mktemp("elsewhere")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(env)], check=True)
    python = env / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", str(python), "install", "--quiet"]
    subprocess.run([*pip, "--no-deps", "--no-index", str(wheel)], check=True)
    (site,) = env.glob("lib/python*/site-packages")
    (site / "conf").mkdir()  # somebody else's, beside the package: no presets of ours
    # a path in such a file is searched for packages, but not for more such files: the editable cfjax stays unseen
    (site / "pinned.pth").write_text(sysconfig.get_path("purelib") + "\n")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def run(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        line = [str(env / "bin" / name), *arguments]
        return subprocess.run(line, cwd=elsewhere, env=environment, capture_output=True, text=True, check=False)

    return run


def test_the_wheel_holds_the_package_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
        told = {name.split(".dist-info/")[1] for name in archive.namelist() if ".dist-info/" in name}
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "cfjax", "cfcheck", "conf"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    there = {re.sub("^conf/", f"{PRESETS}/", name) for name in listed.stdout.splitlines() if (ROOT / name).exists()}
    assert held == there
    # what users were promised that travels: presets, tubes, templates of the controller
    templates = {f"cfjax/export/controller.{kind}.in" for kind in ("c", "h")}
    templates |= {f"cfjax/export/ament/{name}" for name in FILES}
    assert {f"{PRESETS}/train.yaml", f"{PRESETS}/path/circle.yaml"} | templates <= held
    assert sum(name.startswith("cfjax/tubes/library/") for name in held) == 12
    assert told == {"METADATA", "WHEEL", "RECORD", "entry_points.txt", "licenses/LICENSE"}


def test_the_commands_work_outside_the_checkout(command: Command) -> None:
    where = command("python", "-c", "import cfjax.conf, jax; print(cfjax.__file__, cfjax.conf.preset_folder())")
    package, presets = map(Path, where.stdout.split())
    assert "site-packages" in package.parts and not package.is_relative_to(ROOT)
    assert presets == package.parent.resolve() / "conf" / "presets"

    # a tube that travels with the package holds the circle: nothing is learned
    question = ("+path=circle", "certificate=tube", "sets.inlet=0.2", "cars=10", "hydra.run.dir=run")
    trained = command("python", "-m", "cfjax.train", *question)
    assert trained.returncode == 0, trained.stderr
    folder = Path(trained.stdout.splitlines()[-1].removeprefix("run: "))
    assert json.loads((folder / "result.json").read_text())["verdict"] == "certified"

    checked = command("cfjax-check", "run")
    assert checked.returncode == 0, checked.stdout + checked.stderr
    for kind in ([], ["--ros2"]):
        exported = command("cfjax-export", "run", *kind)
        assert exported.returncode == 0, exported.stderr
    simulated = command("cfjax-simulate", "nowhere")
    assert simulated.returncode == 2, simulated.stderr
    assert (folder / "controller" / "cfjax_controller.c").exists()
    assert (folder / "ros2" / "src" / "node.cpp").exists()


def test_the_installed_command_knows_the_presets(command: Command) -> None:
    wrong = command("cfjax-train", "+path=circel")
    assert wrong.returncode == 2
    assert len(wrong.stderr.splitlines()) == 1 and "circle" in wrong.stderr
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    for name in scripts:
        assert command(name, "--help").returncode == 0, name
