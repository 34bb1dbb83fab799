"""One of each that docs/contributing.md says can be made without a change in the package: it goes in as an object."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from flint import arb, arb_series, fmpq

import cfjax
from cfcheck import Outcome, check_document
from cfcheck.exact.rational import Range, exp_bounds, sqrt_upper
from cfcheck.kernel.level import LEVELS, Affine, Level, LevelPiece
from cfcheck.replay import stated_and_proven
from cfjax.certificate import certify, proof_size, refute, robustness_of, statement_of
from cfjax.conf import options_of, preset, problem_of
from cfjax.conf.build import command_vehicle
from cfjax.errors import InputError
from cfjax.export.controller import sources_of
from cfjax.falsifier import falsify
from cfjax.funnel import TEMPLATES, Contracting, Objective, Template
from cfjax.learner import Found, Learned, Learner, LearningTask, learn
from cfjax.options import Options
from cfjax.problem import Problem, ball, tube
from cfjax.problem.vehicle import Scalar
from cfjax.question import check_question, doubts
from cfjax.solver import Program, Solution, Solver, solver_named
from cfjax.solver.program import Shape


CIRCLE, EIGHT = problem_of(preset("circle")), problem_of(preset("figure_eight"))


class Counting:
    """A third solver: another one's answers, counted."""

    def __init__(self) -> None:
        self.name, self.count, self.inner = "counting", 0, solver_named("batched")

    def solve(self, programs: Sequence[Program]) -> list[Solution]:
        self.count += len(programs)
        return [replace(solution, solver=self.name) for solution in self.inner.solve(programs)]

    def prepare(self, shape: Shape) -> None:
        self.inner.prepare(shape)


@dataclass(frozen=True)
class Remembering:
    """A third learner: it knows an answer."""

    learned: Learned | None
    name: str = "remembering"
    rounds: int = 1
    tubes: bool = False
    chains: bool = False
    objectives: bool = False

    def learn(self, task: LearningTask, progress: Callable[[int, int], None] | None = None) -> Found:
        return Found(task.problem, self.learned, "nothing is remembered", {"remembered": 1})


class Shifted(Template):
    """A third template, between the two: V = e^{kθ} (q + b) − b. Contracting for b = 0, Paper for b → ∞."""

    name = "shifted"
    rate_name = "rate"
    shift = 0.25  # b

    def level(self, rate: Scalar, theta: Scalar) -> Scalar:
        return (1 + self.shift) * jnp.exp(-rate * theta) - self.shift

    def value(self, rate: Scalar, theta: Scalar, q: Scalar) -> Scalar:
        return jnp.exp(rate * theta) * (q + self.shift) - self.shift

    def scale(self, rate: Scalar, theta: Scalar) -> Scalar:
        return jnp.exp(rate * theta)

    def timing(self, rate: Scalar, q: Scalar) -> Scalar:
        return rate * (q + self.shift)

    def shell(self, rate: Scalar, begin: Scalar, end: Scalar, beta_inner: Scalar) -> tuple[Scalar, Scalar]:
        first, last = jnp.exp(-rate * begin), jnp.exp(-rate * end)
        low = (beta_inner + self.shift) * jnp.minimum(first, last) - self.shift
        return low, (1 + self.shift) * jnp.maximum(first, last) - self.shift

    def drop(self, rate: Scalar, begin: Scalar, end: Scalar, beta_lower: Scalar, q: Scalar) -> Scalar:
        first, last = jnp.exp(-rate * begin), jnp.exp(-rate * end)
        at_lower = (q + self.shift) / (beta_lower + self.shift)  # 1/σ where V = β̲
        below = (q + self.shift - self.shift * jnp.minimum(first, last)) / beta_lower
        return jnp.minimum(jnp.minimum(at_lower, below), jnp.maximum(first, last))

    def change_bounds(self, beta_lower: float, may_grow: bool) -> tuple[float, float]:
        # the shell must not hold x = 0
        return (-2.0 if may_grow else 1e-3), 0.98 * math.log((beta_lower + self.shift) / self.shift)

    def first_change(self, share: Scalar) -> Scalar:
        return 0.2 + 0.6 * share

    def reaching(self, rate: Scalar, q: Scalar, level: Scalar) -> Scalar:
        return math.log((level + self.shift) / (q + self.shift)) / rate


class ShiftedLevel(Level):
    """The same in exact numbers, for the checker; 1/σ = e^{−kθ}, and ρ = (1 + b)/σ − b."""

    name = Shifted.name
    rate_name = Shifted.rate_name
    shift = fmpq(*Shifted.shift.as_integer_ratio())

    def _contraction(self, span: Range) -> Range:
        ends = [exp_bounds(-self.rate * theta) for theta in span]
        return min(low for low, _ in ends), max(high for _, high in ends)

    def form_bounds(self, value: fmpq, theta: fmpq) -> Range:
        low, high = exp_bounds(-self.rate * theta)
        return (value + self.shift) * low - self.shift, (value + self.shift) * high - self.shift

    def series(self, theta: arb, terms: int) -> arb_series:
        contraction = arb_series([-self.rate * theta, arb(-self.rate)], prec=terms).exp()
        return contraction * arb(1 + self.shift) - arb(self.shift)

    def value_rate(self, theta: fmpq, form: fmpq, form_rate: arb, u0: arb) -> arb:
        return arb(self.rate * theta).exp() * (form_rate + arb(self.rate * (form + self.shift)) * u0)

    def deviation_scale(self, least: fmpq, peak: fmpq) -> tuple[fmpq, fmpq]:
        return sqrt_upper(1 + self.shift), 1 / least  # σ q ≤ 1 + b − σ b

    def inside(self, span: Range) -> list[LevelPiece]:
        timing = Affine(self.rate * self.shift, self.rate)
        weight = Affine(self._contraction(span)[0], fmpq(0))
        return [LevelPiece(fmpq(0), self.extent(span)[1], timing, weight)]

    def _shell(self, span: Range, beta_lower: fmpq, beta_inner: fmpq) -> list[LevelPiece]:
        (least, peak), b = self._contraction(span), self.shift
        start, end = (beta_inner + b) * least - b, (1 + b) * peak - b
        rising = Affine(b / (beta_lower + b), 1 / (beta_lower + b))  # 1/σ where V = β̲: no θ asks more
        timing, kink = Affine(self.rate * b, self.rate), (beta_lower + b) * peak - b
        inner = LevelPiece(start, kink, timing, rising)
        return [inner, LevelPiece(kink, end, timing, Affine(peak, fmpq(0)))]


@pytest.fixture
def named(monkeypatch: pytest.MonkeyPatch) -> None:
    """What steps 2 and 3 of the recipe do: the template has a name, in floats and in the checker."""
    monkeypatch.setitem(TEMPLATES, Shifted.name, Shifted())
    monkeypatch.setitem(LEVELS, Shifted.name, ShiftedLevel)


@pytest.fixture(scope="module")
def learned() -> Learned:
    found = learn(CIRCLE, Contracting(), candidates=1)
    assert found is not None and found.margin > 0
    return found


def test_a_third_solver_proves(learned: Learned) -> None:
    solver = Counting()
    assert isinstance(solver, Solver)
    found = certify(CIRCLE, learned.funnels, solver=solver)
    assert found.verdict is cfjax.Verdict.CERTIFIED, found.message
    assert "counting" in found.solvers and solver.count > 0


def test_a_third_learner_is_certified_for(learned: Learned) -> None:
    learner = Remembering(learned)
    assert isinstance(learner, Learner)
    found = cfjax.search(CIRCLE, Options(learner=learner, cars=0, robustness=False))
    assert found.verdict is cfjax.Verdict.CERTIFIED, found.message
    assert (found.iterations, found.search["learner"], found.search["remembered"]) == (1, "remembering", 1)


def test_a_third_learner_that_finds_nothing_says_why() -> None:
    found = cfjax.search(CIRCLE, Options(learner=Remembering(None)))
    assert (found.verdict, found.message) == (cfjax.Verdict.INCONCLUSIVE, "nothing is remembered")


def test_a_third_learner_is_asked_for_what_it_serves() -> None:
    options = Options(learner=Remembering(None), restarts=8)
    any_path = Problem(tube(), goal=ball(0.6))
    for problem, message in (
        (any_path, "expected a path, got a tube"),
        (EIGHT, "expected one distinct segment, got 2"),
    ):
        with pytest.raises(InputError, match=f"learner=remembering: {message}"):
            check_question(problem, options)
    with pytest.raises(InputError, match="expected margin with learner=remembering, got width"):
        Options(learner=Remembering(None), objective=Objective("width", 1.0))
    everything = Remembering(None, tubes=True, chains=True, objectives=True)
    for problem in (any_path, EIGHT):
        check_question(problem, Options(learner=everything, objective=Objective("width", 1.0)))
    assert doubts(CIRCLE, options) == ["restarts=8 does nothing with learner=remembering"]


@pytest.mark.parametrize("rate", [0.3, -0.2])
def test_a_third_template_is_consistent(rate: float) -> None:
    """V on its own level sets; what `drop` says against all θ of a stretch, one by one."""
    template, beta, inner, (begin, end) = Shifted(), 0.8, 0.5, (0.2, 1.4)
    theta = np.linspace(begin, end, 20001)
    np.testing.assert_allclose(template.value(rate, theta, template.level(rate, theta)), 1)
    low, high = map(float, template.shell(rate, begin, end, inner))
    for q in np.linspace(low, high, 12)[1:-1]:
        value = np.asarray(template.value(rate, theta, q))
        asked = np.minimum(1, value / beta) / np.asarray(template.scale(rate, theta))
        largest = asked[(value >= inner) & (value <= 1)].max()
        assert float(template.drop(rate, begin, end, beta, q)) >= largest - 1e-9
    assert template.value(rate, template.reaching(rate, 0.6, 0.9), 0.6) == pytest.approx(0.9)


def test_a_third_template_is_learned_and_falsified() -> None:
    found = learn(CIRCLE, Shifted(), candidates=1)
    assert found is not None and found.funnel.template.name == "shifted"
    assert found.margin > 0 > found.excess
    points = falsify(CIRCLE, CIRCLE.path.distinct[0], found.funnel, seed=3)
    assert {point.condition for point in points} >= {"a", "b", "d"}
    assert all(point.slack > 0 for point in points)
    assert next(point.slack for point in points if point.condition == "d") == pytest.approx(found.margin, rel=0.05)


@pytest.mark.parametrize("rate", [fmpq(3, 10), fmpq(-1, 5)])
def test_a_third_template_asks_no_less_of_the_checker(rate: fmpq) -> None:
    """The exact pieces cover the float template's shell, and ask at least its `drop` there; inside at most 1/σ."""
    template, level, beta, inner = Shifted(), ShiftedLevel(rate), fmpq(4, 5), fmpq(1, 2)
    span = fmpq(1, 5), fmpq(7, 5)
    begin, end = map(float, span)
    low, high = map(float, template.shell(float(rate), begin, end, float(inner)))
    pieces = level.shell(span, beta, inner)
    assert float(pieces[0].lower) <= low + 1e-12 and float(pieces[-1].upper) >= high - 1e-12
    for q in np.linspace(low, high, 50)[1:-1]:
        piece = next(piece for piece in pieces if float(piece.lower) <= q <= float(piece.upper))
        asked = float(template.drop(float(rate), begin, end, float(beta), q))
        (drop, drop_slope), (timing, timing_slope) = piece.weight, piece.timing
        assert float(drop) + float(drop_slope) * q >= asked - 1e-9
        assert float(timing) + float(timing_slope) * q == pytest.approx(float(template.timing(float(rate), q)))
    (within,) = level.inside(span)
    scales = np.asarray(template.scale(float(rate), np.linspace(begin, end, 1001)))
    assert float(within.least_weight) <= (1 / scales).min() + 1e-12
    value = level.value_rate(span[0], fmpq(1, 2), arb(3), arb(2))
    moved = template.scale(float(rate), begin) * (3 + template.timing(float(rate), 0.5) * 2)
    assert float(value) == pytest.approx(float(moved))


@pytest.mark.slow
@pytest.mark.usefixtures("named")
def test_a_third_template_is_proven_refuted_driven_and_exported() -> None:
    """With a name it goes all the way: the learner, the exact proof, what it absorbs, the cars, and the law in C."""
    options = Options(template="shifted", restarts=1, cars=20, robustness=False)
    found = cfjax.synthesize(CIRCLE, options)
    assert found.verdict is cfjax.Verdict.CERTIFIED, found.message
    assert "template shifted, rate " in found.message
    assert found.margin_certified is not None and found.margin_falsified is not None
    assert 0.9 * found.margin_falsified < found.margin_certified <= found.margin_falsified
    assert found.closed_loop is not None and found.closed_loop.outcome == "none lost"
    assert found.document is not None
    stated, _ = stated_and_proven(found.document, robustness_of(found))
    assert stated.alone.period > 0 and stated.together.delay > 0
    (funnel,) = found.document["funnels"]
    assert check_document(found.document).outcome is Outcome.PROVEN
    faster = {**found.document, "funnels": [{**funnel, "rate": str(2 * fmpq(*map(int, funnel["rate"].split("/"))))}]}
    assert check_document(faster, skip_hash=True).outcome is Outcome.BROKEN
    assert refute(CIRCLE, found.segments[0].funnel, 1.05 * found.margin_falsified).verdict is cfjax.Verdict.REFUTED
    assert "template shifted" in sources_of(found).source


def test_a_vehicle_by_name_has_a_proof_to_be_solved(tmp_path: Path) -> None:
    module = Path(__file__).parents[1] / "experiments" / "vehicles" / "unicycle.py"
    (tmp_path / "seam_vehicle.py").write_text(module.read_text())
    config = preset("circle", ["vehicle=custom", "vehicle.target=seam_vehicle.Unicycle"])
    problem = problem_of(config, command_vehicle(config, tmp_path))
    assert problem.vehicle.name == "unicycle"
    size = proof_size(problem, statement_of(problem), Contracting(), options_of(config).beta_lower)
    assert size is not None and size.states == problem.dimension == 4


RECIPES = Path(__file__).parents[1] / "docs" / "contributing.md"
MOST_FILES = {"A new learner": 6, "A new solver": 1, "A vehicle by name": 3, "A new template": 4, "A new condition": 8}


@pytest.mark.parametrize(("title", "most"), MOST_FILES.items())
def test_a_recipe_names_what_there_is_and_few_files(title: str, most: int) -> None:
    """Numbered steps name the files that change: those of code exist, and hold the names in brackets."""
    recipe = RECIPES.read_text().partition(f"## {title}\n")[2].partition("\n## ")[0]
    steps = re.findall(r"^\d\. .*(?:\n   .*)*", recipe, re.MULTILINE)
    assert steps
    files: set[str] = set()
    for step in steps:
        named = re.findall(r"`((?:cfcheck|cfjax|conf|docs)/[\w/.-]+\.(?:py|md|yaml))`", step)
        files |= set(named)
        for name in re.findall(r"\(`(\w+)`\)", step):
            assert any(re.search(rf"\b{name}\b", (RECIPES.parents[1] / file).read_text()) for file in named), name
    root = RECIPES.parents[1]
    assert [file for file in files if not (root / file).exists() and "my_" not in file] == []
    assert len(files) <= most, sorted(files)
