"""The walls of the house: docs/architecture.md says what each room may import, and its modules import that.

A room is a row of the table: a folder, a module, or several. A module belongs to the row with its longest path. Imports
within functions and for type checkers count: they say what a room knows of. A name that a package loads on first use
counts as the module that it comes from.
"""

import ast
import functools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest


ROOT = Path(__file__).parents[1]
DOCUMENT = ROOT / "docs" / "architecture.md"
HEADING = "| room | what it is for | may import |"


class Room(NamedTuple):
    """A row of the table: paths, and of each room it may import the modules, or all."""

    paths: tuple[str, ...]
    may: dict[str, tuple[str, ...]]


def read_rooms(document: str) -> dict[str, Room]:
    """The rows by name: `problem`, `report/page`, `train`; of several modules the word before the colon."""
    rows = document.partition(HEADING)[2].partition("\n\n")[0].strip().splitlines()[1:]
    rooms = {}
    for row in rows:
        first, _, last = (cell.strip() for cell in row.strip("|").split(" | "))
        paths = tuple(
            path.rstrip("/").removesuffix(".py") for path in re.findall(r"`(?:cfjax/)?([\w/]+?(?:/|\.py))`", first)
        )
        name = first.partition(":")[0] if ":" in first else paths[0]
        entries = re.findall(r"([\w/]+)(?: \(([^)]*)\))?", last)
        may = {room: tuple(re.findall(r"[\w/]+", modules)) for room, modules in entries if room != "nothing"}
        rooms[name] = Room(paths, may)
    return rooms


def path_of(file: Path) -> str:
    """Where a module lies, from `cfjax` or beside it, without suffix; of a package its folder."""
    path = file.relative_to(ROOT).with_suffix("").as_posix()
    return path.removeprefix("cfjax/").removesuffix("/__init__")


PACKAGES = ("cfcheck", "cfjax")
MODULES = {path_of(file): file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))}


def room_of(module: str, rooms: dict[str, Room]) -> str | None:
    """The room of a module: that of the longest path of the table which it begins with."""
    found = {path: name for name, room in rooms.items() for path in room.paths if f"{module}/".startswith(f"{path}/")}
    return found[max(found, key=len)] if found else None


@functools.cache
def lazy_homes(package: str) -> dict[str, str]:
    """Of each name that a package imports for type checkers and loads on first use, the module that it comes from."""
    blocks = [node for node in ast.parse(MODULES[package].read_text()).body if isinstance(node, ast.If)]
    statements = [node for block in blocks for node in block.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: module_named(f"{each.module}.{alias.name}") for each in statements for alias in each.names}


def module_named(dotted: str) -> str:
    """The module of the package that a dotted name, `cfjax.problem.path.Path`, leads to."""
    names = dotted.removeprefix("cfjax.").split(".") if dotted != "cfjax" else []
    module = max((path for k in range(len(names) + 1) if (path := "/".join(names[:k])) in MODULES), key=len, default="")
    if not module and names and names[0] in lazy_homes("__init__"):
        return lazy_homes("__init__")[names[0]]
    return module or "__init__"


def imports_of(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and dotted name of all that a module takes from the package."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert not node.level, "relative imports are not read here"
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.Import):  # `import cfjax` itself says nothing yet: what is taken from it does
            yield from ((node.lineno, alias.name) for alias in node.names if alias.name != "cfjax")
        elif isinstance(node, ast.Attribute) and re.fullmatch(r"cfjax[\w.]+", dotted := ast.unparse(node)):
            yield node.lineno, dotted
        elif isinstance(node, ast.arg | ast.AnnAssign | ast.FunctionDef):
            quoted = node.returns if isinstance(node, ast.FunctionDef) else node.annotation
            if isinstance(quoted, ast.Constant) and isinstance(quoted.value, str):
                yield from ((quoted.lineno, dotted) for _, dotted in imports_of(ast.parse(quoted.value)))
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "_ROOMS":  # of a package, on first use
            rooms = [part.value for part in ast.walk(node.value) if isinstance(part, ast.Constant)]
            yield from ((node.lineno, f"cfjax.{room}") for room in rooms)


def taken(source: str) -> list[tuple[int, str]]:
    """Line and module of all that a source takes from the package."""
    named = imports_of(ast.parse(source))
    return sorted({(line, module_named(dotted)) for line, dotted in named if dotted.split(".")[0] in PACKAGES})


def crossings(module: str, source: str, rooms: dict[str, Room]) -> Iterator[str]:
    """A line for each import that the row of the module's room does not have."""
    own = room_of(module, rooms)
    if own is None:
        yield f"cfjax/{module}.py: no row of the table has it"
        return
    for line, target in taken(source):
        other = room_of(target, rooms)
        if other != own and (other is None or not is_allowed(rooms[own], other, target)):
            yield f"cfjax/{module}.py:{line}: imports {target}, which the row `{own}` does not have ({other})"


def is_allowed(room: Room, other: str, target: str) -> bool:
    """A row that allows a folder allows the rows within it."""
    named = max((each for each in room.may if f"{other}/".startswith(f"{each}/")), key=len, default=None)
    return named is not None and (not room.may[named] or target.removeprefix(f"{named}/") in room.may[named])


@pytest.fixture(scope="module")
def rooms() -> dict[str, Room]:
    return read_rooms(DOCUMENT.read_text(encoding="utf-8"))


def test_no_wall_is_crossed(rooms: dict[str, Room]) -> None:
    found = [line for module, file in MODULES.items() for line in crossings(module, file.read_text(), rooms)]
    assert not found, "\n".join(found)


def test_no_door_is_unused(rooms: dict[str, Room]) -> None:
    """A row says no more than what is imported: else it would allow what nobody has thought of."""
    used = {
        (own, other, detail)
        for module, file in MODULES.items()
        for _, target in taken(file.read_text())
        for own in [room_of(module, rooms)]
        for other in (rooms[own].may if own else ())
        if f"{target}/".startswith(f"{other}/") or room_of(target, rooms) == other
        for detail in (None, target.removeprefix(f"{other}/"))
    }
    allowed = {
        (name, other, module)
        for name, room in rooms.items()
        for other in room.may
        for module in room.may[other] or [None]
    }
    unused = sorted(f"row `{own}`: nobody imports {other} {module or ''}" for own, other, module in allowed - used)
    assert not unused, "\n".join(unused)


def test_rooms_import_each_other_in_no_circle(rooms: dict[str, Room]) -> None:
    left = {name: set(room.may) for name, room in rooms.items()}
    while free := {name for name, others in left.items() if not others & left.keys()}:
        left = {name: others for name, others in left.items() if name not in free}
    assert not left, f"in a circle, or in front of one: {sorted(left)}"


def test_modules_import_each_other_in_no_circle() -> None:
    left = {module: {target for _, target in taken(file.read_text())} - {module} for module, file in MODULES.items()}
    while free := {module for module, others in left.items() if not others & left.keys()}:
        left = {module: others for module, others in left.items() if module not in free}
    assert not left, f"in a circle, or in front of one: {sorted(left)}"


@pytest.mark.parametrize(
    "source",
    [
        "from cfjax.certificate.plan import Cuts",
        "from cfjax import certificate",
        "import cfjax.certificate.plan",
        "def f():\n    from cfjax.certificate import certify",
        "if TYPE_CHECKING:\n    from cfjax.certificate import certify",
        "import cfjax\n\ncfjax.certify",
        "def f() -> 'cfjax.certificate.Certification | None': ...",
    ],
)
def test_a_wrong_import_is_seen(source: str, rooms: dict[str, Room]) -> None:
    (line,) = crossings("control/law", source, rooms)
    assert re.fullmatch(r"cfjax/control/law\.py:\d: imports certificate\S*, which the row `control` .*", line)


FORMS = re.compile(r"path\.tube|isinstance\([^)]*(Tube|Segment|Course)|isinf\([^)]*duration")
MOST_FORMS = 25


def test_few_places_ask_which_form_a_path_has() -> None:
    """What segments and tubes both know is asked of either (`last_theta`, `samples`, `middle`, `top_speed`)."""
    files = [file for room in ("cfjax", "experiments", "scripts") for file in sorted((ROOT / room).rglob("*.py"))]
    found = [
        f"{file.relative_to(ROOT)}:{number}"
        for file in files
        for number, line in enumerate(file.read_text().splitlines(), start=1)
        if FORMS.search(line)
    ]
    assert len(found) <= MOST_FORMS, found
