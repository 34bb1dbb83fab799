"""vehicle=custom: a class of the user's own is certified and driven, and no folder's words load code."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import cfjax.export.__main__ as export
import cfjax.simulate as simulate
from cfcheck import Outcome, check_file
from cfjax.control.law import LAW_SHARE
from cfjax.errors import InputError
from cfjax.falsifier import first_escape
from cfjax.plants.model import world_rate
from cfjax.problem import (
    Disc,
    Pose,
    Problem,
    Profile,
    ReferencePoint,
    Segment,
    Twist,
    Vehicle,
    ball,
    circle,
    deviation_rate,
    ellipse,
    feedforward,
    slalom,
    straight,
    tube,
)
from cfjax.problem import Path as Course
from cfjax.problem.course import poses_of
from cfjax.report.run_folder import read_run
from cfjax.synthesis import search
from cfjax.verdict import Verdict
from experiments.vehicles.dynamic_single_track import DynamicSingleTrack
from experiments.vehicles.front_axle import FrontAxleCar
from experiments.vehicles.steered_car import SteeredCar
from experiments.vehicles.unicycle import Unicycle
from tests.check.vehicles import Cart


UNICYCLE = (Path(__file__).parents[2] / "experiments" / "vehicles" / "unicycle.py").read_text()


@pytest.fixture
def module(tmp_path: Path) -> str:
    """A module of the user's own beside where the command is given; its name is new in this process."""
    name = f"robots_{tmp_path.parent.name}_{tmp_path.name}".replace("-", "_")
    (tmp_path / f"{name}.py").write_text(UNICYCLE)
    return name


@pytest.mark.slow
def test_a_unicycle_is_certified_checked_driven_and_exported(
    train: Callable[..., int], tmp_path: Path, module: str, capsys: pytest.CaptureFixture[str]
) -> None:
    own = ("vehicle=custom", f"vehicle.target={module}.Unicycle", "+vehicle.parameters.max_turn=2.5")
    small = ("cars=50", "restarts=1", "rounds=1", "robustness=false", "hydra.run.dir=here")
    assert train("+path=straight", "sets.inlet=0.3", "sets.safe=null", *own, *small) == 0
    folder = tmp_path / "here"
    result = json.loads((folder / "result.json").read_text())
    assert result["vehicle"].items() >= {"name": "unicycle", "max_turn": 2.5, "max_thrust": 4.0}.items()
    assert (result["closed_loop"]["left_funnel"], result["closed_loop"]["missed_goal"]) == (0, 0)
    report = check_file(folder)
    assert report.outcome is Outcome.PROVEN
    assert 'vehicle: "unicycle" (max_turn 2.5, max_thrust 4); a name unknown to this checker' in report.message
    with pytest.raises(InputError, match=r"the run of a vehicle of somebody's own, .*name it: --vehicle module\.Class"):
        read_run(folder)
    read = read_run(folder, f"{module}.Unicycle")
    assert read.verdict is Verdict.CERTIFIED and vars(read.problem.vehicle) == {"max_turn": 2.5, "max_thrust": 4.0}
    capsys.readouterr()
    asked = [str(folder), "--vehicle", f"{module}.Unicycle"]
    assert simulate.main([*asked, "--n", "16", "--period", "0.02"]) == 0
    assert "16 arrived, 16 of them in G, 0 left S" in capsys.readouterr().out
    assert export.main(asked) == 0
    assert simulate.main([str(folder)]) == export.main([str(folder)]) == 2
    assert capsys.readouterr().err.count("\n") == 2
    # other dynamics under the same name are none that were proven
    (tmp_path / f"{module}_b.py").write_text(UNICYCLE.replace("turn=turn,", "turn=1.1 * turn,"))
    with pytest.raises(InputError, match="--vehicle: expected the class whose dynamics are in"):
        read_run(folder, f"{module}_b.Unicycle")


@pytest.mark.slow
def test_a_unicycle_drives_along_points_in_a_tube(train: Callable[..., int], tmp_path: Path, module: str) -> None:
    """Checked, driven and exported as the car of the package is; its inputs may be held as long as is proven."""
    points = np.stack([np.linspace(0, 6, 13), 0.3 * np.sin(np.linspace(0, 3, 13))], axis=1)
    np.savetxt(tmp_path / "points.csv", points, delimiter=",", header="x,y")
    own = ("vehicle=custom", f"vehicle.target={module}.Unicycle", "path.file=points.csv", "path.speed=1.0")
    small = ("cars=20", "method=tt", "restarts=1", "rounds=1", "certificate=tube", "hydra.run.dir=here")
    assert train("+path=waypoints", "sets.inlet=0.3", "sets.goal=0.6", *own, *small) == 0
    folder = tmp_path / "here"
    result = json.loads((folder / "result.json").read_text())
    assert result["verdict"] == "certified" and result["robustness"]["period"] > 2e-4
    assert result["closed_loop"]["missed_goal"] == result["closed_loop"]["left_funnel"] == 0
    report = check_file(folder)
    assert report.outcome is Outcome.PROVEN and report.robustness is not None
    assert 'vehicle: "unicycle"' in report.message and "a name unknown to this checker" in report.message

    target = f"{module}.Unicycle"
    assert export.main([str(folder), "--vehicle", target]) == 0
    with pytest.raises(InputError, match="expected"):
        read_run(folder, "experiments.vehicles.steered_car.SteeredCar")


def test_a_folder_loads_no_code(train: Callable[..., int], quick: None, tmp_path: Path, module: str) -> None:
    own = ("vehicle=custom", f"vehicle.target={module}.Unicycle")
    assert train("+path=circle", *own, "hydra.run.dir=here") == 1
    (tmp_path / "evil.py").write_text("raise SystemExit('loaded')")
    config = tmp_path / "here" / "config.yaml"
    config.write_text(config.read_text().replace(f"{module}.Unicycle", "evil.Unicycle"))
    for command in (simulate.main, export.main):
        assert command([str(tmp_path / "here")]) == 2
    assert "evil" not in sys.modules


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("Unicycle", "vehicle.target: expected module.Class, got Unicycle"),
        ("nowhere.Car", "vehicle.target: expected a module that Python finds from"),
        ("MODULE.Bicycle", "vehicle.target: expected a class Bicycle in"),
        ("MODULE.Interval", "that is a cfjax.problem.Vehicle"),
        ("MODULE.Vehicle", "expected a frozen dataclass Vehicle"),
    ],
)
def test_what_is_no_vehicle_is_one_line(
    target: str, message: str, train: Callable[..., int], module: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert train("+path=circle", "vehicle=custom", f"vehicle.target={target.replace('MODULE', module)}") == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1


def test_a_sweep_runs_a_job_again_whose_vehicle_has_changed(
    train: Callable[..., int], quick: None, tmp_path: Path, module: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing that is proven says that the inconclusive run was of this class: it is no answer."""
    sweep = ("-m", "+path=circle", "path.speed=1,2", "vehicle=custom", f"vehicle.target={module}.Unicycle")
    assert train(*sweep) == 0
    capsys.readouterr()
    train(*sweep)
    assert "done already" not in capsys.readouterr().out


@pytest.mark.parametrize(
    "vehicle", [Unicycle(), SteeredCar(), FrontAxleCar(), DynamicSingleTrack()], ids=lambda vehicle: vehicle.name
)
def test_deviations_are_those_of_the_inertial_model(vehicle: Vehicle) -> None:
    """Along a curvature that changes: the deviation's rate against differences of two motions in the world frame."""
    rng = np.random.default_rng(0)
    h = 1e-5
    for _ in range(20):
        x = 0.3 * rng.normal(size=len(vehicle.state_names))
        u0, u = rng.uniform(0.5, 2.0), rng.normal(size=2)
        point = ReferencePoint(*rng.uniform([-1, 1, -1, -1], [1, 2, 1, 1]))

        def reference(theta: float, point: ReferencePoint = point) -> tuple[np.ndarray, np.ndarray]:
            """Pose, from the origin on, and internal states."""
            turn, speed = point.turn_rate + theta * point.turn_rate_slope, point.speed + theta * point.speed_slope
            twist, internal = vehicle.reference(turn, speed)
            heading = theta * point.turn_rate
            c, s = np.cos(heading / 2), np.sin(heading / 2)
            moved = twist.lateral * c - twist.forward * s, twist.lateral * s + twist.forward * c
            return np.array([heading, theta * moved[0], theta * moved[1]]), np.array(internal, float)

        def deviation(time: float, x: np.ndarray = x, u0: float = u0, u: np.ndarray = u) -> np.ndarray:
            internal = x[3:] + reference(0.0)[1]
            twist = vehicle.twist(tuple(internal), tuple(u))
            c, s = np.cos(x[0]), np.sin(x[0])
            moved = np.array([twist.turn, twist.lateral * c - twist.forward * s, twist.lateral * s + twist.forward * c])
            pose, held = (
                x[:3] + time * moved,
                internal + time * np.array(vehicle.internal_rate(tuple(internal), tuple(u))),
            )
            at, own = reference(u0 * time)
            c, s = np.cos(at[0]), np.sin(at[0])
            dx, dy = pose[1:] - at[1:]
            return np.array([pose[0] - at[0], c * dx + s * dy, -s * dx + c * dy, *(held - own)])

        expected = (deviation(h) - deviation(-h)) / (2 * h)
        np.testing.assert_allclose(deviation_rate(vehicle, tuple(x), (u0, *u), point), expected, atol=1e-8)


@pytest.mark.slow
def test_a_car_with_its_steering_as_a_state_is_certified(train: Callable[..., int], tmp_path: Path) -> None:
    own = ("vehicle=custom", "vehicle.target=experiments.vehicles.steered_car.SteeredCar")
    sets = ("sets.inlet=0.2", "sets.goal=0.6", "sets.safe=[1,1,1,3,0.7]")
    small = ("cars=50", "restarts=1", "rounds=1", "robustness=false", "hydra.run.dir=here")
    assert train("+path=straight", "method=tt", "template=paper", *own, *sets, *small) == 0
    report = check_file(tmp_path / "here")
    assert report.outcome is Outcome.PROVEN and "of deviations alpha (rad), x (m), y (m), v, w; I" in report.message
    result = json.loads((tmp_path / "here" / "result.json").read_text())
    assert (result["closed_loop"]["left_funnel"], result["closed_loop"]["missed_goal"]) == (0, 0)


def test_what_no_tube_holds_is_said_before_anything_is_learned(
    train: Callable[..., int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cfjax.learner.by_gradient.learn_for", None)
    own = ("vehicle=custom", "vehicle.target=experiments.vehicles.steered_car.SteeredCar")
    sets = ("sets.inlet=0.2", "sets.goal=0.6", "sets.safe=[1,1,1,3,0.7]")
    assert train("+path=ellipse", "certificate=tube", *own, *sets) == 2
    said = capsys.readouterr().err
    assert "certificate: expected auto or segment, got tube: vehicle: a tube needs" in said and said.count("\n") == 1
    breaks = (0.0, 1.0, 2.0)
    kink = Segment(Profile(breaks, ((0.0,), (0.3,))), Profile(breaks, ((1.0,), (1.0,))), Pose(0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="at theta = 1 s: the turning rate jumps"):
        search(Problem(Course("kink", (kink,)), vehicle=Cart(), inlet=ball(0.2), goal=ball(0.6)))


def test_a_vehicle_that_no_tube_holds_goes_by_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    """Along a chain of several, which goes by tubes where they hold the vehicle."""

    class Taken(Exception):
        pass

    def taken(*_: object) -> None:
        raise Taken

    monkeypatch.setattr("cfjax.synthesis._by_segments", taken)
    monkeypatch.setattr("cfjax.synthesis._by_tubes", lambda *_: pytest.fail("no tube holds it"))
    with pytest.raises(Taken):
        search(Problem(slalom(), vehicle=Cart(), inlet=ball(0.2), goal=ball(0.6)))


# --- a vehicle whose rates divide by its speed

SLIPPING = (
    "vehicle=custom",
    "vehicle.target=experiments.vehicles.dynamic_single_track.DynamicSingleTrack",
    "sets.inlet=[0.2,0.2,0.2,0.2,0.1,0.5]",
    "sets.goal=[0.5,0.5,0.5,0.5,0.5,2]",
    "sets.safe=[1,1,1,1,0.5,3]",
)


@pytest.mark.slow
def test_a_car_with_tyres_is_certified_and_driven(train: Callable[..., int], tmp_path: Path) -> None:
    """Six states, one of which rates divide by: inputs may be held for microseconds, whatever they are."""
    small = ("cars=50", "method=tt", "restarts=1", "rounds=1", "hydra.run.dir=here")
    assert train("+path=circle", *SLIPPING, *small) == 0
    report = check_file(tmp_path / "here")
    assert report.robustness is not None
    amounts = report.robustness.alone
    assert 1e-5 < float(amounts.period) < 1e-4 and float(amounts.delay) > 1e-6
    assert min(map(float, amounts.disturbance)) > 0.05 and min(map(float, amounts.pose_error)) > 1e-3
    run = read_run(tmp_path / "here", SLIPPING[1].partition("=")[2])
    (segment,), (found,), period = run.problem.path.segments, run.segments, float(amounts.period)
    assert found.margin_certified is not None
    decrease = LAW_SHARE * found.margin_certified
    escape = first_escape(run.problem, segment, found.funnel, decrease, 8 * period, trials=2**15)
    assert period < escape < 4 * period
    assert report.outcome is Outcome.PROVEN
    assert "of deviations alpha (rad), x (m), y (m), v_x, v_y, yaw_rate; I" in report.message
    assert "speed 1.5707963267948966 m/s" in report.message
    result = json.loads((tmp_path / "here" / "result.json").read_text())
    assert result["margin"]["certified"] > 1.5
    assert (result["closed_loop"]["left_funnel"], result["closed_loop"]["missed_goal"]) == (0, 0)


def test_a_steady_turn_on_tyres_stays_one() -> None:
    """Whatever the speed: nothing of the reference's rest changes with the inputs that hold it."""
    vehicle = DynamicSingleTrack()
    for speed, turn in ((1.5708, 1.0472), (4.0, -2.5), (2.0, 0.0), (0.5, 0.3)):
        point = ReferencePoint(turn, speed)
        _, internal = vehicle.reference(turn, speed)
        assert float(np.hypot(internal[0], internal[1])) == pytest.approx(speed, rel=1e-12)
        held = feedforward(vehicle, point)
        np.testing.assert_allclose(deviation_rate(vehicle, (0.0,) * 6, held, point), 0.0, atol=1e-10)


# --- a vehicle that does not look along the path


@pytest.mark.slow
def test_a_front_axle_is_certified_and_driven(train: Callable[..., int], tmp_path: Path) -> None:
    """Its body looks to the outside of the circle, its authority over V has terms beyond the identity's degree."""
    own = ("vehicle=custom", "vehicle.target=experiments.vehicles.front_axle.FrontAxleCar")
    small = ("cars=50", "method=tt", "restarts=1", "rounds=1", "hydra.run.dir=here")
    assert train("+path=circle", *own, *small) == 0
    folder = tmp_path / "here"
    report = check_file(folder)
    assert report.outcome is Outcome.PROVEN and 'vehicle: "front_axle_car"' in report.message
    result = json.loads((folder / "result.json").read_text())
    # the square root in the reference changes with no state: held inputs are proven in spite of it
    assert 1e-4 < result["robustness"]["period"] < 0.1
    assert (result["closed_loop"]["left_funnel"], result["closed_loop"]["missed_goal"]) == (0, 0)


def test_a_reference_in_the_world_moves_as_the_vehicle_does() -> None:
    """Held by the inputs that it needs, from where the path has it: the front axle stays on the circle."""
    problem = Problem(circle(), vehicle=FrontAxleCar())
    point = problem.path.curve[0].point(0.0)
    assert problem.side_slip == pytest.approx(-np.arcsin(0.34 / 1.5), abs=1e-12)
    held = tuple(map(jnp.asarray, problem.feedforward(point)[1:]))
    pieces = poses_of(problem.path, problem.side_slip)

    def pose(theta: float) -> np.ndarray:
        at = jnp.array([theta], float)
        return np.array([float(value[0]) for value, _ in pieces.at(pieces.find(at), at)])

    start = np.concatenate([pose(0.0), np.array(problem.vehicle.reference(point.turn_rate, point.speed)[1], float)])
    at = jax.jit(lambda z: world_rate(problem.vehicle, z, held))
    way = solve_ivp(lambda _, z: np.asarray(at(jnp.asarray(z))), (0, 6), start, rtol=1e-9, atol=1e-9, t_eval=[2, 5])
    for theta, z in zip(way.t, way.y.T, strict=True):
        np.testing.assert_allclose(z[:3], pose(theta), atol=1e-6)
        assert np.hypot(z[1], z[2]) == pytest.approx(1.5, abs=1e-6)


@pytest.mark.parametrize(
    ("path", "told", "message"),
    [
        (
            ellipse(),
            {},
            r"segment 0 at theta = .* look -0\.\d+ rad away from the path's tangent, .* one angle",
        ),
        (tube(1.0), {}, "of the tube has the vehicle front_axle_car look"),
        (circle(), {"obstacles": (Disc(9.0, 9.0, 1.0),)}, "sets.obstacles: expected none for the vehicle"),
        (circle(0.3), {}, "expected a reference that moves along the path"),  # no front axle turns on less than l
    ],
)
def test_where_the_angle_changes_is_no_path_of_it(path: Course, told: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Problem(path, vehicle=FrontAxleCar(), goal=ball(0.8), **told)


def test_obstacles_are_fine_where_the_body_looks_along_the_path() -> None:
    assert Problem(straight(), vehicle=FrontAxleCar(), obstacles=(Disc(0.0, 9.0, 1.0),)).side_slip == 0


class _Late(Unicycle):
    def reference(self, turn_rate: float, speed: float) -> tuple[Twist, tuple]:
        return Twist(turn_rate, 0.0, 0.9 * speed), (0.9 * speed,)


def test_a_reference_has_the_speed_of_the_path() -> None:
    with pytest.raises(InputError, match=r"at 2 m/s and 0 rad/s; got one at 1\.8 m/s"):
        Problem(straight(), vehicle=_Late())
