"""Tables of experiments: a cell claims no more than what is proven."""

import dataclasses
from fractions import Fraction

from cfjax.report.lines import AT_LEAST, AT_MOST, markdown
from experiments import paper_table, path_table, tube_frontier, tube_table, vehicle_table


@dataclasses.dataclass(frozen=True)
class Line:
    margin: float | None = dataclasses.field(metadata=AT_LEAST)
    width: float | None = dataclasses.field(metadata=AT_MOST)
    share: float | None
    name: str = "circle"


def cells(line: object) -> list[str]:
    return markdown([line]).splitlines()[2].strip("| ").split(" | ")


def test_proven_figures_are_rounded_in_the_safe_direction() -> None:
    assert cells(Line(1.79899, 0.70001, 1.79899)) == ["1.798", "0.7001", "1.799", "circle"]
    assert cells(Line(None, float("nan"), None)) == ["–", "–", "–", "circle"]


def test_the_tables_of_the_documents_know_which_figures_are_proven() -> None:
    value = 1.79851234
    for kind in (paper_table.Line, path_table.Line, tube_table.Line, tube_frontier.Point, vehicle_table.Line):
        line = kind(**dict.fromkeys([field.name for field in dataclasses.fields(kind)], value))  # pyright: ignore
        names = markdown([line]).splitlines()[0].strip("| ").split(" | ")
        shown = dict(zip(names, cells(line), strict=True))
        for name in ("certified", "falsified"):
            assert shown[name] == "1.798" and Fraction(shown[name]) <= Fraction(value)
        for name in ("half width", "lateral"):
            assert shown.get(name, "1.799") == "1.799"
