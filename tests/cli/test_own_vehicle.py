"""vehicle=custom: a class of the user's own is certified and driven, and no folder's words load code."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import cfjax.export.__main__ as export
import cfjax.simulate.__main__ as simulate
from cfjax.check import Outcome, check_file
from cfjax.errors import InputError
from cfjax.problem import ReferencePoint, deviation_rate
from cfjax.report.run_folder import read_run
from cfjax.verdict import Verdict
from experiments.vehicles.steered_car import SteeredCar
from experiments.vehicles.unicycle import Unicycle


UNICYCLE = (Path(__file__).parents[2] / "experiments" / "vehicles" / "unicycle.py").read_text()


@pytest.fixture
def module(tmp_path: Path) -> str:
    """A module of the user's own beside where the command is given; its name is new in this process."""
    name = f"robots_{tmp_path.parent.name}_{tmp_path.name}".replace("-", "_")
    (tmp_path / f"{name}.py").write_text(UNICYCLE)
    return name


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
    assert 'vehicle "unicycle" (max_turn 2.5, max_thrust 4), a name unknown to this checker' in report.message
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


@pytest.mark.parametrize("vehicle", [Unicycle(), SteeredCar()], ids=lambda vehicle: vehicle.name)
def test_deviations_are_those_of_the_inertial_model(vehicle: Unicycle | SteeredCar) -> None:
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
            heading = theta * point.turn_rate
            pose = np.array([heading, -theta * speed * np.sin(heading / 2), theta * speed * np.cos(heading / 2)])
            return pose, np.array(vehicle.reference(turn, speed)[1], float)

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
