"""Every public name, called with values of the wrong kind: one line that says what to write, or a right result."""

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, replace
from decimal import Decimal
from fractions import Fraction
from functools import cache
from typing import Any

import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

import cfjax
from cfjax import InputError, Interval, KinematicBicycle, Method, Problem, circle, straight, tube
from cfjax.control import MinNorm, law_numbers
from cfjax.demonstrator import horizon_of, weights_of
from cfjax.funnel import Funnel, Leg, template_named
from cfjax.learner.elimination import Elimination
from cfjax.problem import (
    Disc,
    LinearLaw,
    Polygon,
    Pose,
    Profile,
    PurePursuitLaw,
    ReferencePoint,
    RosPose,
    Segment,
    StanleyLaw,
    Tube,
    Wall,
)
from cfjax.result import Result, SegmentResult
from cfjax.simulation.track import track_of
from cfjax.tubes.certified import CertifiedTube


@pytest.fixture(autouse=True)
def as_users_have_it() -> Iterator[None]:
    """Without the checks of annotations that tests run with: they would speak first."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


PATH, CAR, POINT = circle(), KinematicBicycle(), ReferencePoint(1.0, 1.5)
PROBLEM = Problem(PATH)
TUBE = Problem(tube(1.0, 1.0), 0.15, 0.25)
FUNNEL = Funnel(template_named("contracting"), np.diag([6.0, 5.0, 4.5, 7.0]), 0.01, PATH.curve[0].duration)
ENDLESS = replace(FUNNEL, rate=0.0, duration=np.inf)
LEG = Leg(PATH.curve[0].duration, FUNNEL, 0.1)
RESULT = Result(cfjax.Verdict.INCONCLUSIVE, "by hand", PROBLEM, (SegmentResult(FUNNEL, 0.1),))
REST = (0.0, 0.0, 0.0, 0.0)
TEMPLATE = template_named("contracting")


@cache
def following() -> cfjax.Following:
    return cfjax.follow(circle(3.0, 1.0))


def values_of(record: Any) -> dict[str, Any]:
    """Its fields, without what it has computed meanwhile."""
    return {entry.name: getattr(record, entry.name) for entry in fields(record)}


WRONG: dict[str, Any] = {
    "text": "points.csv",
    "a number as text": "0.5",
    "no text": "",
    "bytes": b"1",
    "None": None,
    "True": True,
    "nan": float("nan"),
    "inf": float("inf"),
    "zero": 0,
    "negative": -1.5,
    "complex": 1 + 2j,
    "huge": 10**400,
    "very huge": 10**5000,
    "Decimal nan": Decimal("sNaN"),
    "empty": [],
    "mixed": [1.0, "two", None],
    "ragged": [[1.0], [1.0, 2.0]],
    "nested": [[[]]],
    "dictionary": {"radius": 1},
    "set": {1.0, 2.0},
    "generator": (x for x in (1.0, 2.0)),
    "array": np.zeros((3, 2)),
    "array of text": np.array(["a", "b"]),
    "array of objects": np.array([None, object()]),
    "array of nan": np.full(4, np.nan),
    "JAX array": jnp.ones((2, 2)),
    "complex array": np.ones(4, complex),
    "object": object(),
    "class": Problem,
    "function": circle,
    "module": cfjax,
    "path": PATH,
    "problem": PROBLEM,
    "interval": Interval(0.5, 2.0),
    "ellipsoid": cfjax.ball(0.5),
    "options": cfjax.Options(),
    "enum": Method.TT,
    "error": InputError("x"),
}


@dataclass(frozen=True)
class Call:
    """A good call, of which each argument is exchanged in turn, and what comes out of it.

    What would take its time (`slow`) is called with wrong values alone: `takes` lists those that are right after all.
    """

    call: Callable[..., Any]
    arguments: dict[str, Any]
    kind: type | tuple[type, ...] = object
    takes: dict[str, set[str]] = field(default_factory=dict)
    slow: bool = False


def of(call: Callable[..., Any], kind: Any = object, /, **arguments: Any) -> Call:
    return Call(call, arguments, kind)


def slow(call: Callable[..., Any], takes: dict[str, set[str]] | None = None, /, **arguments: Any) -> Call:
    return Call(call, arguments, (), takes or {}, slow=True)


SCALARS = {"zero", "negative", "nan", "inf", "huge", "very huge", "Decimal nan", "array", "array of nan", "JAX array"}
CALLABLE = {"None", "class", "function"}
NONE, WHOLE, SIGNED = {"None"}, {"zero"}, {"zero", "negative"}
OPTIONS = {"options": {"options"}, "progress": CALLABLE}
TABLE: dict[str, Callable[[], Call]] = {
    "Box": lambda: of(cfjax.Box, cfjax.Box, half_widths=(1, 1, 1, 3)),
    "Ellipsoid": lambda: of(cfjax.Ellipsoid, cfjax.Ellipsoid, half_axes=[1, 1, 1, 3]),
    "Interval": lambda: of(Interval, Interval, lower=0, upper=1),
    "KinematicBicycle": lambda: of(
        KinematicBicycle, KinematicBicycle, wheelbase=0.3, max_tan_steering=1, max_thrust=Fraction(4)
    ),
    "Objective": lambda: of(cfjax.Objective, cfjax.Objective, kind="width", margin=1.0),
    "Options": lambda: of(cfjax.Options, cfjax.Options, **vars(cfjax.Options())),
    "Elimination": lambda: of(Elimination, Elimination, **vars(Elimination())),
    "Path": lambda: of(cfjax.Path, cfjax.Path, name="own", segments=PATH.segments),
    "Problem": lambda: of(
        Problem,
        Problem,
        path=straight(),
        inlet=0.5,
        goal=[0.5, 0.5, 0.5, 0.5],
        safe=np.array([1.0, 1.0, 1.0, 3.0]),
        obstacles=[{"disc": [9, 9, 1]}],
        footprint=[[0.25, 0.0]],
        vehicle=CAR,
        method="tt",
        timing=(0.5, 2),
        input_share=1,
    ),
    "Funnel": lambda: of(Funnel, Funnel, **values_of(FUNNEL)),
    "Result": lambda: of(Result, Result, **values_of(RESULT)),
    "Result.replace": lambda: of(RESULT.replace, Result, verdict="refuted", problem=PROBLEM),
    "Result.describe": lambda: of(RESULT.describe, str, objective=cfjax.Objective()),
    "Following": lambda: of(
        lambda **given: replace(following(), **given),
        cfjax.Following,
        **{name: vars(following())[name] for name in ("path", "reference", "tubes", "links", "runs", "ratios")},
    ),
    "Following.tube_at": lambda: of(following().tube_at, CertifiedTube, segment=0, theta=1.0),
    "Disc": lambda: of(Disc, Disc, x=0, y=0, radius=1),
    "Polygon": lambda: of(Polygon, Polygon, corners=[[0, 0], [1, 0], [0, 1]]),
    "Wall": lambda: of(Wall, Wall, points=[[0, 0], [1, 0], [0, 1]]),
    "LinearLaw": lambda: of(LinearLaw, LinearLaw, gain=[[0, 0, 0, 0], [0, 0, 0, -1]], centre=[0, 0]),
    "StanleyLaw": lambda: of(StanleyLaw, StanleyLaw, speed_gain=1, curvature=0.5, gain=1, softening=0.1),
    "PurePursuitLaw": lambda: of(PurePursuitLaw, PurePursuitLaw, speed_gain=1, curvature=0.5, look_ahead=1),
    "Profile": lambda: of(Profile, Profile, breaks=[0, 1], coefficients=[[1.0, 0.5]]),
    "Profile.constant": lambda: of(Profile.constant, Profile, value=1, duration=2),
    "Segment": lambda: of(Segment, Segment, **values_of(PATH.curve[0]) | {"start": (0, 0, 0)}),
    "Segment.point": lambda: of(PATH.curve[0].point, ReferencePoint, theta=0.5),
    "Tube": lambda: of(Tube, Tube, curvature=(-1, 1), speed=[1, 2], acceleration=Interval(0, 0)),
    "Problem.feedforward": lambda: of(PROBLEM.feedforward, np.ndarray, point=POINT),
    "ball": lambda: of(cfjax.ball, cfjax.Ellipsoid, radius=1, dimension=4),
    "circle": lambda: of(circle, cfjax.Path, radius=1, speed=1, laps=1),
    "ellipse": lambda: of(cfjax.ellipse, cfjax.Path, a=2, b=1, speed=1, segments=2, laps=1),
    "figure_eight": lambda: of(cfjax.figure_eight, cfjax.Path, size=2, speed=1),
    "obstacle_path": lambda: of(cfjax.obstacle_path, cfjax.Path, speed=1),
    "oval": lambda: of(cfjax.oval, cfjax.Path, speed=1),
    "slalom": lambda: of(cfjax.slalom, cfjax.Path, length=12, amplitude=0.5, periods=1, speed=1),
    "straight": lambda: of(straight, cfjax.Path, length=1, speed=np.float32(1)),
    "tube": lambda: of(tube, cfjax.Path, curvature=1, speed=(1, 2), acceleration=[0, 1]),
    "waypoints": lambda: of(
        cfjax.waypoints,
        cfjax.Path,
        file=[[0, 0], [4, 0], [8, 0]],
        columns=None,
        closed=None,
        speed=1,
        least_speed=None,
        lateral_acceleration=4,
        acceleration=1,
        reserve=0.2,
        vehicle=CAR,
        segment_length=10,
        smoothing=0,
    ),
    "plot": lambda: of(cfjax.plot, Figure, result=RESULT, panel="plane", axes=None, width=None),
    "Result.plot": lambda: of(RESULT.plot, Figure, panel="plane", axes=None, width="page"),
    "write_report": lambda: slow(
        cfjax.write_report, {"path": {"None", "text", "a number as text"}}, result=RESULT, path="nowhere/report.html"
    ),
    "affine_deviation": lambda: of(cfjax.problem.affine_deviation, vehicle=CAR, x=np.zeros(4), reference=POINT),
    "affine_along": lambda: of(cfjax.problem.affine_along, tuple, vehicle=CAR, points=[[1, 1.5, 0, 0]]),
    "deviation_rate": lambda: of(
        cfjax.problem.deviation_rate, tuple, vehicle=CAR, x=REST, inputs=[1, 0, 0], reference=POINT
    ),
    "pose_from_ros": lambda: of(cfjax.problem.pose_from_ros, Pose, pose=(0, 0, 0)),
    "pose_to_ros": lambda: of(cfjax.problem.pose_to_ros, RosPose, pose=Pose(0, 0, 0)),
    "deviation_from_ros": lambda: of(cfjax.problem.deviation_from_ros, Pose, offset=RosPose(0, 0, 0)),
    "deviation_to_ros": lambda: of(cfjax.problem.deviation_to_ros, RosPose, deviation=(0, 0, 0)),
    "disc_centres": lambda: of(cfjax.problem.disc_centres, list, footprint=[[0.2, 0.0]], poses=np.zeros((2, 3))),
    "distances": lambda: of(cfjax.problem.distances, tuple, obstacle=Disc(0, 0, 1), points=np.zeros((2, 2))),
    "feedforward": lambda: of(cfjax.problem.feedforward, tuple, vehicle=CAR, reference=POINT),
    "mirror_signs": lambda: of(cfjax.problem.mirror_signs, tuple, vehicle=CAR),
    "to_deviation": lambda: of(
        cfjax.problem.to_deviation, tuple, vehicle=CAR, state=REST, pose=Pose(0, 0, 0), point=POINT
    ),
    "to_state": lambda: of(cfjax.problem.to_state, tuple, vehicle=CAR, x=REST, pose=(0, 0, 0), point=POINT),
    "lateral_half_width": lambda: of(cfjax.funnel.lateral_half_width, float, funnel=FUNNEL),
    "template_named": lambda: of(template_named, name="paper"),
    "law_named": lambda: of(cfjax.control.law_named, name="min_norm"),
    "any_path_numbers": lambda: of(
        cfjax.control.any_path_numbers, problem=TUBE, funnel=ENDLESS, margin=1, margin_per_metre=1
    ),
    "law_numbers": lambda: of(
        law_numbers, problem=PROBLEM, funnel=FUNNEL, margin=1, margin_per_metre=0, curvature=None, acceleration=None
    ),
    "leg_numbers": lambda: of(cfjax.control.leg_numbers, problem=PROBLEM, leg=LEG),
    "descent_at": lambda: slow(
        cfjax.control.descent_at,
        {"theta": SCALARS, "x": {"array of nan"}},
        vehicle=CAR,
        template=TEMPLATE,
        numbers=law_numbers(PROBLEM, FUNNEL, 1.0),
        reference=POINT,
        theta=0.5,
        x=REST,
    ),
    "path_point": lambda: of(cfjax.control.path_point, ReferencePoint, curvature=1, speed=1, acceleration=0),
    "locate": lambda: slow(cfjax.control.locate, PROBLEMS, problem=PROBLEM, legs=[LEG], states=np.zeros((1, 4))),
    "for_vehicle": lambda: of(cfjax.tubes.for_vehicle, tube=cfjax.tubes.library()[0], vehicle=CAR),
    "library": lambda: of(cfjax.tubes.library, tuple, vehicle=CAR),
    "read_tube": lambda: of(cfjax.tubes.read_tube, path="none.json", check=False),
    "chain_document": lambda: of(cfjax.tubes.chain_document, dict, following=following(), problem=None),
    "horizon_of": lambda: of(horizon_of, problem=PROBLEM, steps=20),
    "weights_of": lambda: of(weights_of, problem=PROBLEM, effort=0.1, terminal=1),
    "statement_of": lambda: of(cfjax.certificate.statement_of, problem=PROBLEM),
    "require_posable": lambda: slow(
        cfjax.certificate.require_posable,
        {"beta_inner": NONE} | PROBLEMS,
        problem=PROBLEM,
        statement=cfjax.certificate.statement_of(PROBLEM),
        template=TEMPLATE,
        beta_lower=0.9,
        beta_inner=None,
    ),
    "proof_size": lambda: slow(
        cfjax.certificate.proof_size,
        {"beta_inner": NONE} | PROBLEMS,
        problem=PROBLEM,
        statement=cfjax.certificate.statement_of(PROBLEM),
        template=TEMPLATE,
        beta_lower=0.9,
        beta_inner=None,
        solver="clarabel",
    ),
    "require_room": lambda: of(
        cfjax.certificate.require_room,
        tuple,
        size=cfjax.certificate.proof_size(PROBLEM, cfjax.certificate.statement_of(PROBLEM), TEMPLATE, 0.9),
        memory=None,
        hours=9,
        cores=1,
    ),
    "dump": lambda: of(cfjax.certificate.dump, str, document={}),
    "plant_named": lambda: of(cfjax.plants.plant_named, text="model", vehicle=CAR),
    "sensor_named": lambda: of(cfjax.plants.sensor_named, text="mocap", vehicle=CAR),
    "single_track": lambda: of(
        cfjax.plants.single_track, wheelbase=0.3, stiffness=1, lag=None, rate=None, saturating=True, mass=3
    ),
    "perfect": lambda: of(cfjax.plants.perfect, dimension=4),
    # what learns, proves or drives cars is called with wrong values alone
    "synthesize": lambda: slow(
        cfjax.synthesize, OPTIONS | PROBLEMS, problem=PROBLEM, options=cfjax.Options(), progress=None
    ),
    "search": lambda: slow(cfjax.search, OPTIONS | PROBLEMS, problem=PROBLEM, options=cfjax.Options()),
    "drive": lambda: slow(cfjax.drive, OPTIONS, result=RESULT, options=cfjax.Options(), progress=None),
    "certify": lambda: slow(
        cfjax.certify,
        {"progress": CALLABLE, "target": WHOLE} | PROBLEMS,
        problem=PROBLEM,
        funnels=[FUNNEL],
        target=0,
        progress=None,
        workers=1,
    ),
    "refute": lambda: slow(
        cfjax.refute,
        {"margin": WHOLE, "points": NONE | {"empty"}} | PROBLEMS,
        problem=PROBLEM,
        funnel=FUNNEL,
        margin=0,
        points=(),
    ),
    "demonstrate": lambda: slow(
        cfjax.demonstrate,
        {"theta": NONE, "horizon": NONE, "weights": NONE, "warm": NONE} | PROBLEMS,
        problem=PROBLEM,
        x=np.zeros((1, 4)),
        theta=[0.0],
        horizon=horizon_of(PROBLEM),
        weights=weights_of(PROBLEM),
        warm=None,
        tolerance=1e-4,
        most_iterations=10,
    ),
    "follow": lambda: slow(
        cfjax.follow,
        {"path": {"path"}, "tubes": NONE, "vehicle": NONE, "pinned": NONE},
        path=PATH,
        tubes=None,
        vehicle=CAR,
        closed=False,
        pinned="no such",
    ),
    "Map": lambda: of(cfjax.Map, cfjax.Map, obstacles=[{"disc": [9, 9, 1]}], bounds=[-5, -5, 12, 12], source="by hand"),
    "read_map": lambda: slow(cfjax.planner.read_map, path="none.yaml", unknown_is_free=False),
    "replan": lambda: slow(
        cfjax.replan,
        {"map": {"empty"}, "driven": {"zero"}},
        plan=cfjax.plan(cfjax.Map(bounds=(-1, -1, 4, 4)), [0, 0, 0], [3, 3, 0]),
        map=cfjax.Map(bounds=(-1, -1, 4, 4)),
        driven=0,
    ),
    "plan": lambda: slow(
        cfjax.plan,
        {
            "map": {"empty"},
            "vehicle": NONE,
            "tubes": NONE,
            "footprint": {"array"},
            "name": {"text", "a number as text", "no text"},
        },
        map=cfjax.Map(bounds=(-1, -1, 4, 4)),
        start=[0, 0, 0],
        goal=[3, 3, 0],
        vehicle=CAR,
        footprint=[[0.25, 0.0]],
        tubes=None,
        speed=2,
        lateral_acceleration=4,
        attempts=1,
        name="own",
    ),
    "falsify": lambda: slow(
        cfjax.falsifier.falsify,
        {"seed": WHOLE} | PROBLEMS,
        problem=PROBLEM,
        segment=PATH.curve[0],
        funnel=FUNNEL,
        seed=0,
        rounds=1,
        unit="1/s",
    ),
    "stretch_margins": lambda: slow(
        cfjax.falsifier.stretch_margins,
        {"seed": WHOLE, "stretches": {"empty"}} | PROBLEMS,
        problem=PROBLEM,
        segment=PATH.curve[0],
        funnel=FUNNEL,
        stretches=(),
        seed=0,
    ),
    "first_escape": lambda: slow(
        cfjax.falsifier.first_escape,
        {"decrease": SIGNED, "decrease_per_metre": SIGNED} | {"seed": WHOLE} | PROBLEMS,
        problem=PROBLEM,
        segment=PATH.curve[0],
        funnel=FUNNEL,
        decrease=0.1,
        horizon=0.1,
        seed=0,
        decrease_per_metre=0,
        trials=1000,
    ),
    "learn": lambda: slow(
        cfjax.learner.learn,
        {"seed": WHOLE, "beta_inner": NONE} | PROBLEMS,
        problem=PROBLEM,
        template=TEMPLATE,
        beta_lower=0.9,
        beta_inner=None,
        candidates=4,
        seed=0,
    ),
    "learn_for": lambda: slow(
        cfjax.learner.learn_for,
        {"target": NONE} | PROBLEMS,
        objective=cfjax.Objective(),
        target=None,
        problem=PROBLEM,
        template=TEMPLATE,
    ),
    "learn_polytope": lambda: slow(
        cfjax.learner.learn_polytope,
        {"seed": WHOLE, "beta_inner": NONE, "changes": {"empty"}} | PROBLEMS,
        problem=PROBLEM,
        template=TEMPLATE,
        how=Elimination(),
        beta_lower=0.9,
        beta_inner=None,
        changes=(0.3,),
        seed=0,
    ),
    "drive_cars": lambda: slow(
        cfjax.simulation.drive_cars,
        {"seed": WHOLE, "law": {"None"}} | PROBLEMS,
        problem=PROBLEM,
        legs=[LEG],
        cars=1,
        seed=0,
        law=MinNorm(),
    ),
    "drive_tube_cars": lambda: slow(
        cfjax.simulation.drive_tube_cars,
        {"margin": SIGNED, "margin_per_metre": SIGNED} | {"seed": WHOLE, "way": NONE},
        problem=TUBE,
        funnel=ENDLESS,
        margin=0.1,
        margin_per_metre=0.1,
        cars=1,
        seed=0,
        way=None,
    ),
    "robustness_of": lambda: slow(cfjax.certificate.robustness_of, result=RESULT, workers=1),
    "sources_of": lambda: slow(cfjax.export.sources_of, result=RESULT, frame="ros"),
    "write_controller": lambda: slow(cfjax.export.write_controller, result=RESULT, folder="nowhere", frame="ros"),
    "write_package": lambda: slow(cfjax.export.write_package, result=RESULT, folder="nowhere"),
    "write_chain": lambda: slow(
        cfjax.tubes.write_chain, {"path": {"text", "a number as text"}}, following=following(), path="nowhere"
    ),
    "mpc": lambda: slow(
        cfjax.baselines.mpc,
        {"horizon": NONE, "weights": NONE} | PROBLEMS,
        problem=PROBLEM,
        track=track_of(PROBLEM, [LEG]),
        period=0.01,
        horizon=None,
        weights=None,
        iterations=2,
    ),
}
PROBLEMS = {"problem": {"problem"}}
ROOMS = ("", "problem", "funnel", "control", "tubes", "certificate", "demonstrator", "export", "falsifier", "learner")
ROOMS = (*ROOMS, "plants", "planner", "simulation", "baselines")
UNCHECKED = {
    # plain tuples, looked at by whoever takes them (`test_plain_tuples_are_looked_at_where_they_are_taken`)
    *(
        "FootprintDisc",
        "Leg",
        "Pose",
        "ReferencePoint",
        "Twist",
        "Demonstration",
        "Horizon",
        "Weights",
        "Counterexample",
        "RosPose",
    ),
    *("Descent", "LawNumbers", "Located", "Link", "Stretch", "Sources", "Statement", "Measurement", "Scene", "RosPose"),
    # what a user derives a class from, and what has no arguments
    *(
        "Vehicle",
        "Template",
        "Law",
        "FeedbackLaw",
        "Given",
        "Plant",
        "HostPlant",
        "Contracting",
        "Paper",
        "MinNorm",
        "Sontag",
        "LinSontag",
    ),
    *(
        "InputError",
        "library_files",
        "Frame",
        "Method",
        "Verdict",
        "TEMPLATES",
        "LAWS",
        "LEARNERS",
        "PLANTS",
        "LATERAL",
        "Obstacle",
    ),
    # the checker's own, which imports nothing of the package and answers with its own verdicts
    *("CertifiedTube", "scaled"),
    # records that searches make, and what makes them
    *("Plan", "Certification", "WorstPoint", "Found", "Learned", "Learner", "LearningTask"),
    # scalars inside compiled programs
    "nearest_in_box",
    # plants and controllers: modules of numbers (`test_plants_take_numbers`)
    *("CommonRoad", "SlipX", "Disturbed", "Model", "Sensor", "SingleTrack", "Mpc", "PurePursuit", "Stanley"),
}


def test_every_public_name_is_in_the_table() -> None:
    names = {name for room in ROOMS for name in importlib.import_module(f"cfjax.{room}".rstrip(".")).__all__}
    assert names == (names & TABLE.keys()) | (names & UNCHECKED)
    assert not TABLE.keys() & UNCHECKED and names >= UNCHECKED


def wrong(call: Call, arguments: dict[str, Any], word: str = "expected") -> str | None:
    """What is wrong with how a call ends; None where it ends with one line or a right result."""
    try:
        result = call.call(**arguments)
    except InputError as error:
        line = str(error)
        return None if "\n" not in line and 10 < len(line) < 400 and word in line else f"says {line!r}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return None if isinstance(result, call.kind) else f"returns {type(result).__name__}"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", TABLE)
def test_wrong_kinds_get_one_line(name: str) -> None:
    call = TABLE[name]()
    assert len(WRONG) >= 20
    if not call.slow:
        good = wrong(call, call.arguments)
        assert good is None, good
    found = {}
    for label in call.arguments:
        for kind, value in WRONG.items():
            if call.slow and kind in call.takes.get(label, ()):
                continue
            arguments = {**call.arguments, label: value}
            if (reason := wrong(call, arguments)) is not None:
                found[f"{label}={kind}"] = reason
    assert not found


def test_enumerations_are_found_by_their_values() -> None:
    assert Method("tt") is Method.TT and cfjax.Verdict("refuted") is cfjax.Verdict.REFUTED
    with pytest.raises(InputError, match="method: expected one of pf, tt, got both"):
        Method("both")
    with pytest.raises(InputError, match="verdict: expected one of certified, refuted, inconclusive"):
        cfjax.Verdict(1)


@pytest.mark.parametrize("kind", sorted(WRONG.keys() - SIGNED))
def test_plain_tuples_are_looked_at_where_they_are_taken(kind: str) -> None:
    value = WRONG[kind]
    turning = Profile.constant(0.0, 1.0)
    for build in (
        lambda: Segment(turning, turning, Pose(0.0, value, 0.0)),
        lambda: Problem(PATH, footprint=[cfjax.problem.FootprintDisc(value)]),
        lambda: PROBLEM.feedforward(ReferencePoint(1.0, value)),
        lambda: cfjax.demonstrate(PROBLEM, [REST], horizon=cfjax.demonstrator.Horizon(value, 0.1)),
        lambda: cfjax.demonstrate(PROBLEM, [REST], weights=weights_of(PROBLEM)._replace(effort=value)),
        lambda: cfjax.control.leg_numbers(PROBLEM, Leg(1.0, FUNNEL, value)),
    ):
        with pytest.raises(InputError, match="expected"):
            build()


@pytest.mark.parametrize("kind", sorted(WRONG.keys() - SIGNED - {"empty", "generator"}))
def test_plants_take_numbers(kind: str) -> None:
    value = WRONG[kind]
    plants = cfjax.plants
    for build in (
        lambda: plants.Sensor(np.zeros(4), np.zeros(4), delay=value),
        lambda: plants.Model(value),
        lambda: plants.Disturbed(CAR, np.zeros(4), value),
        lambda: plants.Disturbed(value, np.zeros(4), "random"),
        lambda: plants.Disturbed(CAR, value, "random"),
    ):
        with pytest.raises(InputError, match="expected"):
            build()


@pytest.mark.parametrize("method", ["pf", "tt"])
def test_the_question_is_the_same_in_whatever_form(method: str) -> None:
    """Text fell through to path following once, and was certified with its answer."""
    plain = Problem(
        straight(),
        cfjax.ball(0.4),
        cfjax.Ellipsoid((0.5, 0.4, 0.3, 0.2)),
        cfjax.Box((1.0, 1.0, 1.0, 3.0)),
        (Disc(9.0, 9.0, 1.0),),
        (cfjax.problem.FootprintDisc(0.2, 0.0),),
        CAR,
        Method(method),
        Interval(0.5, 3.0),
        1.0,
    )
    others = {"vehicle": CAR, "method": method, "input_share": np.int64(1)}
    assert plain == Problem(
        straight(4, np.float32(2)),
        jnp.asarray(0.4),
        [0.5, 0.4, 0.3, 0.2],
        np.array([1, 1, 1, 3]),
        [{"disc": [9, 9, 1]}],
        [[0.2, 0]],
        timing=[0.5, 3],
        **others,
    )
    assert plain.inputs[0] == (Interval(1.0, 1.0) if method == "tt" else Interval(0.5, 3.0))


NUMBERS = st.one_of(st.floats(-50, 50), st.floats(), st.integers(-9, 99), st.integers())
ANYTHING = st.one_of(
    st.sampled_from(list(WRONG.values())),
    NUMBERS,
    NUMBERS.map(np.asarray),
    st.text(max_size=9),
    st.recursive(NUMBERS | st.none() | st.text(max_size=3), lambda inner: st.lists(inner, max_size=5), max_leaves=9),
    st.lists(NUMBERS, max_size=5).map(tuple),
    st.lists(st.dictionaries(st.sampled_from(["disc", "polygon", "x"]), st.lists(NUMBERS, max_size=4)), max_size=2),
)
EXAMPLES = 3 * settings().max_examples  # more by pytest --hypothesis-profile=campaign
QUICK = [name for name, make in TABLE.items() if name not in ("library", "for_vehicle", "Following", "chain_document")]


@settings(max_examples=EXAMPLES, derandomize=EXAMPLES < 1000, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_anything_gets_one_line_or_a_right_result(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(QUICK)))
    call = TABLE[name]()
    if call.slow:
        return
    changed = data.draw(st.lists(st.sampled_from(sorted(call.arguments)), min_size=1, max_size=3, unique=True))
    arguments = {**call.arguments, **{label: data.draw(ANYTHING, label=label) for label in changed}}
    assert wrong(call, arguments, word="") is None  # of right kinds, but no curve that can be followed, say
