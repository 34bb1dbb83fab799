"""One table for a sweep: a row per job, printed, as CSV and as Parquet."""

import dataclasses
import io
import shlex
from dataclasses import dataclass
from pathlib import Path

import polars as pl
from omegaconf import OmegaConf
from rich.console import Console
from rich.table import Table
from yaml import YAMLError

from cfjax.conf import Config, preset, problem_of, values_of
from cfjax.errors import InputError
from cfjax.report.files import COMMAND, ERROR, RESULT, TABLE, is_job, read_json, write_whole
from cfjax.report.paper_rows import agreement, paper_found
from cfjax.report.run_folder import read_config
from cfjax.rounded import NOTHING, margin_text
from cfjax.verdict import Verdict


PARQUET = "table.parquet"
SWEPT = "swept."  # before the names of columns that hold what a sweep varied


@dataclass(frozen=True)
class Row:
    """One job. Margins in 1/s; `verdict` is `bad input`, `not written` or `crashed` where it reached none."""

    job: str
    path: str
    method: str
    template: str
    overrides: str
    verdict: str
    certified: float | None = None
    falsified: float | None = None
    seconds: float | None = None
    paper: str = ""  # found, not found: where the job is one of the paper's rows
    agreement: str = ""
    message: str = ""
    folder: str = ""

    @property
    def has_verdict(self) -> bool:
        return self.verdict in {verdict.value for verdict in Verdict}


def gather(sweep: Path) -> list[Row]:
    """The jobs of a sweep, finished or not, in the order of their numbers."""
    folders = [folder for folder in sweep.iterdir() if folder.is_dir() and is_job(folder)]
    return [_row(folder) for folder in sorted(folders, key=_job_order)]


def frame(rows: list[Row], sweep: Path) -> pl.DataFrame:
    """The rows, and a column `swept.KEY` for every key of which jobs have different values."""
    types = {"certified": pl.Float64, "falsified": pl.Float64, "seconds": pl.Float64}
    schema = {field.name: types.get(field.name, pl.String) for field in dataclasses.fields(Row)}
    table = pl.DataFrame([dataclasses.asdict(row) for row in rows], schema=schema)
    given = [dict(_key_and_value(override) for override in overrides_of(sweep / row.folder)) for row in rows]
    keys = dict.fromkeys(key for overrides in given for key in overrides)
    columns = [pl.Series(f"{SWEPT}{key}", [own.get(key) for own in given], pl.String) for key in keys]
    return table.with_columns(column for column in columns if column.n_unique() > 1)


def _key_and_value(override: str) -> tuple[str, str]:
    key, _, value = override.lstrip("+~").partition("=")
    return key, "".join(values_of(override)) if value[:1] in ("'", '"') else value


def unfinished(rows: list[Row]) -> int:
    """How many of the jobs have no verdict."""
    return sum(not row.has_verdict for row in rows)


def write_table(rows: list[Row], sweep: Path) -> Path:
    """Write the rows as CSV into the sweep's folder; full precision, folders relative to it."""
    write_whole(sweep / TABLE, frame(rows, sweep).write_csv().encode())
    return sweep / TABLE


def write_frame(table: pl.DataFrame, folder: Path) -> list[Path]:
    """The table as CSV and as Parquet."""
    parquet = io.BytesIO()
    table.write_parquet(parquet)
    write_whole(folder / TABLE, table.write_csv().encode())
    write_whole(folder / PARQUET, parquet.getvalue())
    return [folder / TABLE, folder / PARQUET]


def print_table(rows: list[Row]) -> None:
    """Print the rows for people; columns that say nothing are left out."""
    columns = [
        field.name
        for field in dataclasses.fields(Row)
        if field.name not in ("folder", "message") and any(getattr(row, field.name) not in ("", None) for row in rows)
    ]
    table = Table(*columns, box=None, header_style="bold", pad_edge=False)
    for row in rows:
        table.add_row(*(_cell(column, getattr(row, column)) for column in columns))
    console = Console()
    if not console.is_terminal:
        console = Console(width=200)  # in a file nothing is gained by narrow columns
    console.print(table)
    for row in rows:
        if not row.has_verdict:
            print(f"job {row.job}: {row.verdict}: {row.message}")


def _job_order(folder: Path) -> tuple[int, str]:
    return (int(folder.name), "") if folder.name.isdigit() else (1 << 30, folder.name)


def _cell(column: str, value: object) -> str:
    if value is None:
        return NOTHING
    if isinstance(value, float):
        return margin_text(value) if column in ("certified", "falsified") else f"{value:.4g}"
    return str(value)


def _row(folder: Path) -> Row:
    overrides = " ".join(overrides_of(folder))
    row = Row(folder.name, "", "", "", overrides, "crashed", folder=folder.name, message="the job did not end")
    try:
        if (folder / ERROR).exists() or not (folder / RESULT).exists():
            row = dataclasses.replace(row, **_choices(folder / ".hydra" / "config.yaml"))
            if (folder / ERROR).exists():
                error = read_json(folder / ERROR)
                row = dataclasses.replace(row, verdict=str(error["kind"]), message=str(error["message"]))
            return row
        config = read_config(folder)
        data = read_json(folder / RESULT)
        verdict = Verdict(data["verdict"])
        found = _paper_found(config)
        return Row(
            job=folder.name,
            path=config.path.name,
            method=config.method,
            template=config.template,
            overrides=overrides,
            verdict=verdict.value,
            certified=data["margin"]["certified"],
            falsified=data["margin"]["falsified"],
            seconds=data["seconds"].get("total"),
            paper="" if found is None else "found" if found else "not found",
            agreement=agreement(verdict, found) if config.template == "paper" else "",
            message=data["message"],
            folder=folder.name,
        )
    except (InputError, KeyError, TypeError, ValueError, OSError, YAMLError) as error:
        return dataclasses.replace(row, verdict="crashed", message=f"unreadable: {error}")


def overrides_of(folder: Path) -> list[str]:
    """The overrides of a job: those of its command where it is finished, else as far as Hydra wrote them down.

    Hydra writes its files anew each time, and not whole: a finished job's row does not depend on them.
    """
    try:
        if (folder / RESULT).exists() and (command := read_json(folder / RESULT).get("command")):
            return shlex.split(command)[len(COMMAND) :]
        return [str(override) for override in OmegaConf.load(folder / ".hydra" / "overrides.yaml")]
    except (OSError, TypeError, ValueError, AttributeError, YAMLError):
        return []


def _choices(path: Path) -> dict[str, str]:
    """Path, method and template as far as Hydra wrote them down before the job began."""
    if not path.exists():
        return {}
    data = OmegaConf.load(path)
    keys = {"path": "path.name", "method": "method", "template": "template"}
    return {name: str(OmegaConf.select(data, key, default="")) for name, key in keys.items()}


def _paper_found(config: Config) -> bool | None:
    try:
        return paper_found(problem_of(config), problem_of(preset(config.path.name)))
    except InputError:
        return None  # a preset of the user's own, waypoints, or a vehicle that a folder does not load
