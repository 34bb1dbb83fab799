"""Programs that are traced once per machine."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import ClosedJaxpr

import cfjax.traced
from cfjax.control import MinNorm
from cfjax.falsifier.minimax import Schedule
from cfjax.funnel.conditions import shell_points
from cfjax.identity import identity
from cfjax.problem import KinematicBicycle
from cfjax.problem.traced_vehicle import traced_vehicle
from cfjax.traced import FOLDER, traced
from experiments.vehicles.steered_car import SteeredCar
from experiments.vehicles.unicycle import Unicycle


calls: list[str] = []


def doubled(name: str, values: tuple[jax.Array, int]) -> tuple[jax.Array, jax.Array]:
    calls.append(name)
    return 2 * values[0], jnp.asarray(values[1])


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty one; `doubled` counts as the package's own."""
    monkeypatch.setattr(doubled, "__module__", "cfjax.doubled")
    before = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    traced.cache_clear()
    calls.clear()
    yield tmp_path / FOLDER
    jax.config.update("jax_compilation_cache_dir", before)
    traced.cache_clear()


def is_right(name: str, size: int = 3) -> bool:
    first, second = traced(doubled, name)((np.arange(size), 7))
    return first.tolist() == [2 * k for k in range(size)] and int(second) == 7


def test_a_program_is_traced_once_for_each_shape_and_static_value() -> None:
    assert is_right("one")
    assert is_right("one")
    assert calls == ["one"]
    assert is_right("one", size=5)
    assert is_right("two")
    assert calls == ["one", "one", "two"]


def test_a_version_of_xla_may_lack_an_option() -> None:
    first, _ = traced(doubled, "one", options=(("xla_cpu_nothing_of_the_kind", False),))((np.arange(3), 7))
    assert first.tolist() == [0, 2, 4]


def test_shares_are_answered_in_their_order() -> None:
    shares = traced(doubled, "one").side_by_side([((np.arange(3) + k, k),) for k in range(5)])
    assert [(first.tolist(), int(second)) for first, second in shares] == [
        ([2 * k, 2 * k + 2, 2 * k + 4], k) for k in range(5)
    ]


def test_threads_that_ask_at_once_make_it_once() -> None:
    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(lambda _: is_right("one"), range(8)))
    assert calls == ["one"]


def test_what_is_prepared_has_not_run_and_is_not_made_again() -> None:
    traced(doubled, "one").prepare((np.zeros(3, int), 0))
    assert calls == ["one"]
    assert is_right("one")
    assert calls == ["one"]


def test_another_process_finds_it(cache: Path) -> None:
    assert is_right("one")
    traced.cache_clear()  # all that a process remembers
    assert is_right("one")
    assert calls == ["one"]
    assert len(list(cache.iterdir())) == 1


def test_other_code_is_another_program(monkeypatch: pytest.MonkeyPatch) -> None:
    assert is_right("one")
    traced.cache_clear()
    monkeypatch.setattr(cfjax.traced, "source_hash", lambda: "other")
    assert is_right("one")
    assert calls == ["one", "one"]


@pytest.mark.parametrize("content", [b"", b"no program", None], ids=["empty", "something else", "cut"])
def test_a_broken_file_is_written_again(cache: Path, content: bytes | None) -> None:
    assert is_right("one")
    (file,) = cache.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2] if content is None else content)
    traced.cache_clear()
    assert is_right("one")
    assert calls == ["one", "one"]
    traced.cache_clear()
    assert is_right("one")
    assert calls == ["one", "one"]


def test_a_folder_that_takes_nothing_is_no_matter(cache: Path) -> None:
    cache.write_text("a file in its place")
    assert is_right("one")


def test_without_a_cache_it_is_compiled_all_the_same() -> None:
    jax.config.update("jax_compilation_cache_dir", None)
    assert is_right("one")


def test_what_makes_a_difference_is_in_the_name() -> None:
    assert identity(KinematicBicycle()) == identity(KinematicBicycle())
    assert identity(KinematicBicycle()) != identity(KinematicBicycle(wheelbase=0.4))
    assert identity((KinematicBicycle(), 3, shell_points, MinNorm)) is not None
    assert identity(MinNorm()) != identity(MinNorm)
    assert identity(1) != identity("1") != identity(True)


def test_code_from_elsewhere_has_no_name(cache: Path) -> None:
    @dataclass(frozen=True)
    class Own(KinematicBicycle):
        pass

    assert identity(Unicycle()) is None
    assert identity(Own()) is None
    assert identity((Schedule, np.sin)) is None
    assert identity(lambda: None) is None
    traced(doubled, Unicycle())((np.arange(3), 7))
    assert not cache.exists()


def test_another_process_finds_a_program_of_a_vehicle_from_elsewhere() -> None:
    for vehicle in (SteeredCar(), SteeredCar(), SteeredCar(wheelbase=0.4)):
        traced(doubled, traced_vehicle(vehicle))((np.arange(3), 7))
        traced.cache_clear()
        traced_vehicle.cache_clear()
    assert len(calls) == 2


def drawn(value: jax.Array) -> jax.Array:
    return jax.random.uniform(jax.random.key(0)) * value


def called_back(value: jax.Array) -> jax.Array:
    return jax.pure_callback(np.sin, value, value)


@jax.custom_jvp
def own_slope(value: jax.Array) -> jax.Array:
    return 2 * value


own_slope.defjvp(lambda primals, tangents: (own_slope(*primals), 3 * tangents[0]))


def jaxpr_of(function: Callable, *shapes: tuple[int, ...]) -> ClosedJaxpr:
    return jax.make_jaxpr(function)(*(jnp.zeros(shape) for shape in shapes or [()]))


def test_a_jaxpr_is_told_by_what_it_does() -> None:
    def program(factor: float, table: list[float]) -> ClosedJaxpr:
        return jaxpr_of(lambda v: jnp.where(v > 0, jnp.sin(factor * v), v**2) + jnp.asarray(table) @ jnp.ones(2))

    first = identity(program(0.1, [1.0, 2.0]))
    assert first is not None
    assert first == identity(program(0.1, [1.0, 2.0]))
    assert first != identity(program(np.nextafter(0.1, 1), [1.0, 2.0]))
    assert first != identity(program(0.1, [1.0, np.nextafter(2.0, 3)]))
    others = [lambda v: v**2, lambda v: v**3, jnp.sin, jnp.cos, lambda v: -v + 0 * 1.0]
    assert len({identity(jaxpr_of(each)) for each in others}) == len(others)
    assert identity(jaxpr_of(jnp.sin)) != identity(jaxpr_of(jnp.sin, (2,)))
    swapped = jaxpr_of(lambda a, b: a - b, (), ()), jaxpr_of(lambda a, b: b - a, (), ())
    assert identity(swapped[0]) != identity(swapped[1])
    branches = [jaxpr_of(lambda v, k=k: jax.lax.cond(v > 0, lambda: v, lambda: k * v)) for k in (1.0, 2.0)]
    assert None not in map(identity, branches) and identity(branches[0]) != identity(branches[1])


@pytest.mark.parametrize("function", [drawn, called_back, own_slope])
def test_what_a_jaxpr_does_not_say_whole_has_no_text(function: Callable) -> None:
    assert identity(jaxpr_of(function)) is None
