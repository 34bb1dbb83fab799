"""Presets of sweeps: what is asked of each job, without running it."""

import pytest
from hydra import compose, initialize_config_dir
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from cfjax.conf import options_of, preset, preset_folder, problem_of
from cfjax.question import check_question


def _jobs(name: str, *given: str) -> list[list[str]]:
    with initialize_config_dir(str(preset_folder()), version_base="1.3"):
        params = compose("train", [f"experiment={name}"], return_hydra_config=True).hydra.sweeper.params
    lines = [f"{key}={value}" for key, value in OmegaConf.to_container(params).items()]  # pyright: ignore
    overrides = OverridesParser.create().parse_overrides([*lines, *given])
    return [list(job) for batch in BasicSweeper.split_arguments(overrides, None) for job in batch]


@pytest.mark.parametrize(("name", "jobs"), [("velocity", 10), ("timing", 5), ("shell", 18)])
def test_every_job_of_a_preset_is_a_question(name: str, jobs: int) -> None:
    found = _jobs(name)
    assert len(found) == jobs
    for job in found:
        config = preset("circle", [f"experiment={name}", *job])
        check_question(problem_of(config), options_of(config))


@pytest.mark.parametrize(
    "path",
    [
        *("straight", "straight_long", "straight_restricted", "oval", "ellipse", "figure_eight", "slalom", "tube"),
        *("obstacle", "obstacle_tight"),
    ],
)
def test_velocity_of_every_path_with_a_speed(path: str) -> None:
    for job in _jobs("velocity"):
        problem_of(preset(path, job))


def test_several_paths_in_one_sweep() -> None:
    assert len(_jobs("velocity", "+path=circle,straight")) == 20
