"""Command lines as people type them: what Hydra reads of them, and one line of ours for what nobody can read."""

from collections.abc import Callable
from pathlib import Path

import pytest

from cfjax.conf import config_of, hydra_overrides, preset, values_of, yaml_of
from cfjax.errors import InputError
from cfjax.report.resume import sweep_identity
from cfjax.report.run_folder import read_config
from cfjax.report.table import frame, gather


NAMES = [
    "großer Rundkurs_ä.csv",
    "track(1),final.csv",
    "a=b.csv",
    "[1].csv",
    "{lap}.csv",
    "it's.csv",
    'a "quoted" name.csv',
    "a:b.csv",
    "a#1&2!.csv",
    "back\\slash\\",
    "007",
    "1e3",
    "true",
    " blank.csv ",
    "日本.csv",
    "50 %.csv",
    "x;y^z.csv",
    "tab\t.csv",
]


@pytest.mark.parametrize("name", NAMES)
def test_a_text_is_what_was_typed(name: str) -> None:
    (path, file) = hydra_overrides(["+path=waypoints", f"path.file={name}"], sweep=False)
    assert path == "+path=waypoints"
    assert values_of(file) == [name]
    for key in ("wandb.name", "hydra.run.dir"):
        assert values_of(hydra_overrides([f"{key}={name}"], sweep=False)[1]) == [name]


def test_what_hydra_reads_as_it_stands_is_not_touched() -> None:
    given = ["+path=waypoints", "path.file=a.csv", "wandb.name=null", "wandb.group='a, b'", "hydra.run.dir=x/${now:%Y}"]
    assert hydra_overrides(given, sweep=False) == given


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ([], ["+path=oval"]),
        (["path.speed=2", "sets.safe=null"], ["+path=oval", "path.speed=2", "sets.safe=null"]),
        (["seed=3", "+path=circle"], ["seed=3", "+path=circle"]),
        (["path=circle", "+cars=5", "++seed=1"], ["+path=circle", "cars=5", "seed=1"]),
        (["++path=circle", "+vehicle=custom"], ["+path=circle", "vehicle=custom"]),
        (["vehicle.parameters.mass=2"], ["+path=oval", "++vehicle.parameters.mass=2"]),
        (["+vehicle.parameters={mass:2}"], ["+path=oval", "++vehicle.parameters={mass:2}"]),
        (
            ["hydra/launcher=joblib", "+hydra.job.env_set.A=1"],
            ["+path=oval", "hydra/launcher=joblib", "+hydra.job.env_set.A=1"],
        ),
    ],
)
def test_path_and_plus_are_filled_in(given: list[str], expected: list[str]) -> None:
    assert hydra_overrides(given, sweep=False) == expected


def test_home_is_expanded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    for text in ("~/a (1).csv", "'~/a (1).csv'"):
        assert values_of(hydra_overrides([f"path.file={text}"], sweep=False)[1]) == [f"{tmp_path}/a (1).csv"]
    assert hydra_overrides(["hydra.run.dir=~/run"], sweep=False)[1] == f"hydra.run.dir={tmp_path}/run"
    assert hydra_overrides(["wandb.name=~me"], sweep=False)[1] == "wandb.name='~me'"
    two = hydra_overrides(["path.file=~/a.csv,~/b.csv"], sweep=True)[1]
    assert values_of(two) == [f"{tmp_path}/a.csv", f"{tmp_path}/b.csv"]


def test_commas_part_the_values_of_a_sweep_unless_a_file_has_the_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (given,) = ["path.file=lap (1),final.csv"]
    assert values_of(hydra_overrides([given], sweep=True)[1]) == ["lap (1)", "final.csv"]
    assert values_of(hydra_overrides(["path.file=a.csv,b.csv"], sweep=True)[1]) == ["a.csv", "b.csv"]
    assert values_of(hydra_overrides(["wandb.name=a,b"], sweep=False)[1]) == ["a,b"]
    (tmp_path / "lap (1)").touch()
    (tmp_path / "final.csv").touch()
    with pytest.raises(InputError, match=r"path\.file: expected one name, got lap \(1\),final.csv; with -m"):
        hydra_overrides([given], sweep=False)
    (tmp_path / "lap (1),final.csv").touch()
    for sweep in (False, True):
        (file,) = hydra_overrides([given], sweep=sweep)[1:]
        assert values_of(file) == ["lap (1),final.csv"]
        assert list(sweep_identity([file])["files"]) == ["lap (1),final.csv"]  # pyright: ignore


def test_a_file_of_any_name_through_the_command(train: Callable[..., int], quick: None, tmp_path: Path) -> None:
    name, content = "Rundkurs ä=[1],(2).csv", b"0,0\n2,0\n"
    (tmp_path / name).write_bytes(content)
    assert train("+path=waypoints", f"path.file={name}", "hydra.run.dir=lauf {1}, zwei") == 1
    folder = tmp_path / "lauf {1}, zwei"
    assert (folder / "waypoints.csv").read_bytes() == content
    assert read_config(folder).path.file == str(folder / "waypoints.csv")
    (tmp_path / "b c.csv").write_bytes(content)
    assert train("-m", "+path=waypoints", f"path.file='{name}','b c.csv'", "hydra.sweep.dir=all") == 0
    swept = frame(gather(tmp_path / "all"), tmp_path / "all")["swept.path.file"].to_list()
    assert swept == [name, "b c.csv"]


WRONG = [
    ("path.radius", "expected key=value"),
    ("=3", "expected key=value"),
    ("path..radius=3", "expected key=value"),
    ("path.radius:3", "expected key=value"),
    ("+vehicle@x=custom", "expected key=value"),
    ("path.radius==3", "path.radius: expected a number, got =3"),
    ("path.radius=1,5", "path.radius: expected a number, got 1,5; with -m it is a sweep over its values"),
    ("path.radius=range(1,3)", "path.radius: expected a number, got range(1,3); with -m"),
    ("path.radius=int(a)", "path.radius: expected a number, got int(a)"),
    ("path.radius=foo(a)", "path.radius: expected a number, got foo(a)"),
    ("path.radius=3,", "path.radius: expected a number, got 3,"),
    ("path.radius=„3“", "path.radius: expected a number, got „3“"),
    ("path.radius=${sets.inlet", "path.radius: expected a number, got ${sets.inlet"),
    ('sets.goal="0.5', 'sets.goal: expected a number or a list of numbers, one a state, got "0.5'),
    ("vehicle.parameters={a:b:c", "vehicle.parameters: expected names with values, like {mass: 2}, got {a:b:c"),
    ("größe=3", "größe: no such key"),
    ("vehicle=3", "vehicle: expected the name of a preset, got 3"),
    ("method=pf,tt", "method: expected a name, got pf,tt; with -m it is a sweep over its values"),
    ("polytope.centre=mve,analytic", "polytope.centre: expected a name, got mve,analytic; with -m it is a sweep"),
    ("objective=margin,width", "objective: expected the name of a preset, got margin,width; with -m"),
    ("path.file=", "path.file: expected a name, got nothing"),
    ("hydra.run.dir=", "hydra.run.dir: expected a name, got nothing"),
    ("hydra.verbose=maybe", "hydra.verbose: expected true, false or a list of loggers, like [hydra], got maybe"),
    ("hydra.verbose=[", "hydra.verbose: expected a value that Hydra's grammar reads, got ["),
    # composed
    ("path.radius=1.5m", "path.radius: expected a number, got 1.5m"),
    ("path.radius=null", "path.radius: expected a number, got null"),
    ("path.radius=[1]", "path.radius: expected a number, got [1]"),
    ("path.radius={a:1}", "path.radius: expected a number, got {a:1}"),
    ("path.radius.x=3", "path.radius: expected a number, got path.radius.x=3"),
    ("path.radius=${sets.nope}", "path.radius: expected ${...} to name what there is, got ${sets.nope}"),
    ("sets=0.5", "sets: expected a value for one of its keys, like sets.inlet, got 0.5"),
    ("sets.inlet.x=3", "sets.inlet.x: no such key; sets.inlet: expected a number or a list of numbers, one a state"),
    ("sets.safe={alpha:1}", "sets.safe: expected a number or a list of numbers, one a state, or null, got {alpha:1}"),
    ("sets.obstacles={disc:[5,5,1]}", "sets.obstacles: expected a list, like [{disc: [x, y, radius]}], got {disc:[5"),
    ("cars=1e4", "cars: expected a whole number, got 1e4"),
    ("cars=ten", "cars: expected a whole number, got ten"),
    ("robustness=maybe", "robustness: expected true or false, got maybe"),
    ("beta_inner=low", "beta_inner: expected a number or null, got low"),
    ("timing=1", "timing: expected a list of numbers, like [0.5, 2], got 1"),
    ("timing=[a,b]", "timing: expected a list of numbers, like [0.5, 2], got [a,b]"),
    ("timing={a:1}", "timing: expected a list of numbers, like [0.5, 2], got {a:1}"),
    ("timing=null", "timing: expected a list of numbers, like [0.5, 2], got null"),
    ("wandb.tags=hello", "wandb.tags: expected a list of texts, like [a, b], got hello"),
    ("wandb=null", "wandb: expected a value for one of its keys, like wandb.mode, got null"),
    ("experiment=nope", "experiment: expected one of shell, timing, velocity, got nope"),
    ("Cars=3", "Cars: no such key; expected one of path, vehicle, sets"),
]


@pytest.mark.parametrize(("override", "message"), WRONG, ids=[override for override, _ in WRONG])
def test_what_cannot_be_is_one_line(override: str, message: str) -> None:
    with pytest.raises(InputError) as refused:
        preset("circle", [override])
    assert str(refused.value).startswith(message)
    assert "\n" not in str(refused.value)
    for foreign in ("hydra.cc", "Config'", "OmegaConf", "DictConfig", "Optional", "Exception"):
        assert foreign not in str(refused.value)


@pytest.mark.parametrize(
    ("typed", "columns"),
    [
        ("x_cm,y_cm", ["x_cm", "y_cm"]),
        ("x_cm, y_cm", ["x_cm", "y_cm"]),
        ("[x_cm,y_cm,_]", ["x_cm", "y_cm", "_"]),
        ("[x [cm],y [cm]]", ["x [cm]", "y [cm]"]),
        ("x [cm],y (cm),it's", ["x [cm]", "y (cm)", "it's"]),
        ("['x [cm]',\"y [cm]\"]", ["x [cm]", "y [cm]"]),
    ],
)
def test_lists_of_texts_as_people_type_them(typed: str, columns: list[str]) -> None:
    assert preset("waypoints", ["path.file=a.csv", f"path.columns={typed}"]).path.columns == columns


def test_a_file_whose_name_has_a_dollar_sign(train: Callable[..., int], quick: None, tmp_path: Path) -> None:
    (tmp_path / "${x}.csv").write_text("0,0\n4,0\n")
    assert train("+path=waypoints", "path.file=${x}.csv", "hydra.run.dir=run") == 1
    assert (tmp_path / "run" / "waypoints.csv").exists()


def test_flags_stand_wherever_one_types_them(train: Callable[..., int], quick: None, tmp_path: Path) -> None:
    for arguments in (
        ["+path=circle", "method=pf,tt", "-m", "hydra.sweep.dir=all"],
        ["+path=circle", "-m", "method=pf,tt", "hydra.sweep.dir=other"],
    ):
        assert train(*arguments) == 0
        assert len(gather(tmp_path / arguments[-1].partition("=")[2])) == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--config-dir=nope"], "--config-dir: expected a folder, got nope"),
        (["--config-name=nope"], "--config-name: expected the name of a configuration, got nope"),
        (["--cfg", "nope"], "--cfg/-c: expected as --help says, got --cfg nope"),
        (["hydra.run.dir=${nope:x}"], "hydra.run.dir: expected ${...} to name what there is"),
        (["path.speed=${sets.nope}"], "path.speed: expected ${...} to name what there is, got ${sets.nope}"),
        (["path.speed=fast", "-m", "method=pf,tt"], "path.speed: expected a number, got fast"),
        (["+path=waypoints", "path.file=${x}.csv"], "path.file: expected ${...} to name what there is, got ${x}.csv\n"),
        (["hydra.run.dir=null"], "hydra.run.dir: expected a text, got null"),
        (["hydra/launcher=nope"], "hydra/launcher: expected one of basic"),
        (["hydra.nope=2"], "hydra.nope: no such key; expected one of run, sweep"),
    ],
)
def test_flags_and_hydras_own_keys(
    arguments: list[str], message: str, train: Callable[..., int], quick: None, capfd: pytest.CaptureFixture[str]
) -> None:
    assert train(*arguments) == 2
    error = capfd.readouterr().err
    assert error.startswith(f"error: {message}") and error.count("\n") == 1


def test_the_former_name_of_a_key_works_with_a_line_of_warning(capsys: pytest.CaptureFixture[str]) -> None:
    """On the command line, and in the config.yaml of a run that an earlier version wrote."""
    said = "warning: {}authority is called input_share now; the old name works until version 0.2\n"
    config = preset("circle", ["authority=0.5"])
    assert config.input_share == 0.5 and capsys.readouterr().err == said.format("")
    assert config_of(yaml_of(config).replace("input_share:", "authority:")) == config
    assert capsys.readouterr().err == said.format("config.yaml: ")
