"""What `--help` of the main command prints: how it is called, groups, keys as they stand, exit codes."""

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from cfjax.conf.build import preset_folder
from cfjax.conf.command_line import GROUPS, values_of
from cfjax.conf.messages import shown


WIDTH = 110  # columns of a line
OWN = ("name", "kind")  # keys of a path and a vehicle that are their preset's
TEXT = """\
Look for a certified funnel along a path, prove it, drive cars through it, and write a run's folder.

  cfjax train [+path=NAME] [group=choice] [key=value ...]          one run
  cfjax train -m [+path=NAME] [key=value,value ...]                a sweep over all combinations of values

Examples
  cfjax train +path=circle path.radius=2 path.speed=3
  cfjax train +path=waypoints path.file=points.csv vehicle.wheelbase=0.33
  cfjax train -m +path=circle method=pf,tt hydra/launcher=joblib hydra.launcher.n_jobs=2

Groups, each with its choices
{groups}

Keys, with the values that they have for this command (units and meanings: docs/keys.md)
{keys}

Launchers of a sweep: hydra/launcher=basic (one job after another), joblib, submitit_local, submitit_slurm, ray

Exit codes
  0 certified   1 not certified   2 bad input   3 the run could not be written   130 interrupted
  of a sweep: 0 every job ran to a verdict   1 one crashed   2 one had bad input   3 one could not be written

--cfg job prints the configuration as YAML, --config-dir FOLDER adds presets of your own, --hydra-help says more.\
"""


def help_text(overrides: Sequence[str], extra: Path | None = None) -> str:
    """The help for overrides in Hydra's own form, where those that a sweep varies do not count; `extra` is a folder
    with more presets.

    Raises:
        HydraException: where the overrides make no configuration.
    """
    fixed = [override for override in overrides if len(values_of(override)) < 2]
    path = [] if extra is None else [f"hydra.searchpath=[file://{extra.resolve()}]"]
    with initialize_config_dir(str(preset_folder()), version_base="1.3"):
        config = OmegaConf.to_container(compose("train", [*fixed, *path]))
    assert isinstance(config, Mapping)
    groups = "\n".join(f"  {group}: {', '.join(_choices(group, extra))}" for group in GROUPS)
    return TEXT.format(groups=groups, keys="\n".join(_keys({str(key): value for key, value in config.items()})))


def _choices(group: str, extra: Path | None) -> list[str]:
    folders = [preset_folder(), *([] if extra is None else [extra])]
    return sorted({file.stem for folder in folders for file in (folder / group).glob("*.yaml")})


def _keys(config: Mapping[str, Any]) -> Iterator[str]:
    """Lines of key=value, the keys of each group together; first those that are in none."""
    plain = {key: value for key, value in config.items() if not isinstance(value, Mapping)}
    groups = {key: value for key, value in config.items() if isinstance(value, Mapping)}
    for name, keys in {"": plain, **groups}.items():
        written = [
            f"{name}.{key}={shown(value)}".lstrip(".").replace(" ", "\N{NO-BREAK SPACE}")
            for key, value in keys.items()
            if not (name in GROUPS and name in ("path", "vehicle") and key in OWN)
        ]
        text = textwrap.fill("  ".join(written), WIDTH, initial_indent="  ", subsequent_indent="  ")
        yield text.replace("\N{NO-BREAK SPACE}", " ")
