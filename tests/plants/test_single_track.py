"""The single-track model: held against one that somebody else wrote, and against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.errors import InputError
from cfjax.plants import Model, Scene, single_track
from cfjax.plants.single_track import GRAVITY, SingleTrack
from cfjax.problem import KinematicBicycle


SCENE = Scene(jnp.zeros(()), jnp.zeros(4))
WHEELBASE = 2.5789128  # of CommonRoad's vehicle 2


def driven(plant, state, command, seconds, step=1e-3):
    """The plant's state after a held command, by fixed RK4."""
    told, nothing = jnp.array(command), jnp.zeros(0)

    def advance(z, _):
        k1 = plant.rate(z, told, nothing, SCENE)
        k2 = plant.rate(z + 0.5 * step * k1, told, nothing, SCENE)
        k3 = plant.rate(z + 0.5 * step * k2, told, nothing, SCENE)
        k4 = plant.rate(z + step * k3, told, nothing, SCENE)
        z = z + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return z, z

    return jax.jit(lambda z: jax.lax.scan(advance, z, None, length=round(seconds / step))[1])(
        plant.start(jnp.array(state))
    )


def commonroad_state(z):
    """(x, y, δ, v, ψ, ψ̇, β), heading from +x."""
    alpha, x, y, v, slip, turn, steering = map(float, z)
    return [x, y, steering, v, alpha + np.pi / 2, turn, slip]


def ours(f):
    """Rates in our order."""
    return np.array([f[4], f[0], f[1], f[3], f[6], f[5], f[2]])


def test_single_track_is_commonroads() -> None:
    dynamics = pytest.importorskip("vehiclemodels.vehicle_dynamics_st").vehicle_dynamics_st
    car = pytest.importorskip("vehiclemodels.parameters_vehicle2").parameters_vehicle2()
    grip = car.tire.p_dy1
    plant = single_track(
        car.a + car.b,
        saturating=False,
        front=car.a,
        rear=car.b,
        mass=car.m,
        inertia=car.I_z,
        height=car.h_s,
        friction=grip,
        front_stiffness=-car.tire.p_ky1 / grip,
        rear_stiffness=-car.tire.p_ky1 / grip,
    )
    random = np.random.default_rng(0)
    low = np.array([-3.0, -9, -9, float(plant.blend_to), -0.3, -1, -0.5])
    high = np.array([3.0, 9, 9, 30, 0.3, 1, 0.5])
    motion = jax.jit(lambda z, servo, thrust: plant.motion(z, servo, thrust))
    for z in random.uniform(low, high, (200, 7)):
        # within its constraints: they are the car's, not the equations'
        servo, thrust = random.uniform((-0.39, -2.5), (0.39, 2.5))
        theirs = ours(dynamics(commonroad_state(z), [servo, thrust], car))
        np.testing.assert_allclose(
            np.asarray(motion(jnp.array(z), jnp.asarray(servo), jnp.asarray(thrust))), theirs, rtol=1e-9, atol=1e-9
        )


def test_below_the_blend_it_is_commonroads_kinematic_model() -> None:
    dynamics = pytest.importorskip("vehiclemodels.utils.vehicle_dynamics_ks_cog").vehicle_dynamics_ks_cog
    car = pytest.importorskip("vehiclemodels.parameters_vehicle2").parameters_vehicle2()
    plant = single_track(car.a + car.b, front=car.a, rear=car.b)
    random = np.random.default_rng(1)
    for z in random.uniform([-3.0, -9, -9, -2, -0.3, -1, -0.5], [3.0, 9, 9, 0.5, 0.3, 1, 0.5], (50, 7)):
        servo, thrust = random.uniform((-0.39, -2.5), (0.39, 2.5))
        x = commonroad_state(z)
        theirs = dynamics(x[:5], [servo, thrust], car)
        own = np.asarray(plant.motion(jnp.array(z), jnp.asarray(servo), jnp.asarray(thrust)))
        np.testing.assert_allclose(own[[1, 2, 6, 3, 0]], theirs, rtol=1e-9, atol=1e-9)


def test_kinematic_slip_and_yaw_rate_are_kept_below_the_blend() -> None:
    """There they are functions of speed and steering angle, and the states' rates are the derivatives of these."""
    plant = single_track(0.34)

    def slip_and_turn(v, steering):
        slip = jnp.arctan(plant.rear / (plant.front + plant.rear) * jnp.tan(steering))
        return jnp.stack([slip, v * jnp.cos(slip) * jnp.tan(steering) / (plant.front + plant.rear)])

    v, steering, servo, thrust = 0.1, 0.3, 1.5, -2.0
    _, rates = jax.jvp(slip_and_turn, (v, steering), (thrust, servo))
    z = jnp.array([0.2, 1.0, 2.0, v, *slip_and_turn(v, steering), steering])
    own = plant.motion(z, jnp.asarray(servo), jnp.asarray(thrust))
    np.testing.assert_allclose(own[4:6], rates, rtol=1e-12)


def test_steady_turn_has_the_understeer_of_the_closed_form() -> None:
    """r = v δ/(l + K v²) with K = m/l (l_r/c_f − l_f/c_r), c the cornering stiffnesses of the axles in N/rad."""
    plant = single_track(WHEELBASE, saturating=False, front_stiffness=12.0)
    steering, v = 0.02, 15.0
    end = np.asarray(driven(plant, (0.0, 0.0, 0.0, v), (steering, 0.0), 8.0)[-1])
    front, rear, mass, grip = (float(value) for value in (plant.front, plant.rear, plant.mass, plant.friction))
    length = front + rear
    front_stiffness = grip * 12.0 * mass * GRAVITY * rear / length
    rear_stiffness = grip * 20.898 * mass * GRAVITY * front / length
    gradient = mass / length * (rear / front_stiffness - front / rear_stiffness)
    assert gradient > 1e-3
    np.testing.assert_allclose(end[5], v * steering / (length + gradient * v**2), rtol=1e-9)
    kinematic = v * steering / length
    assert end[5] < 0.8 * kinematic


def test_a_tyre_gives_no_more_than_its_friction() -> None:
    steep = (0.0, 0.0, 0.0, 20.0)
    way = np.asarray(driven(single_track(WHEELBASE), steep, (0.5, 0.0), 3.0))
    lateral = way[:, 3] * (way[:, 5] + np.gradient(way[:, 4], 1e-3))
    assert np.abs(lateral).max() < 1.0489 * GRAVITY * 1.001
    linear = np.asarray(driven(single_track(WHEELBASE, saturating=False), steep, (0.5, 0.0), 3.0))
    assert np.abs(linear[:, 3] * linear[:, 5]).max() > 1.5 * GRAVITY


def test_servo_lags_as_the_closed_form_says() -> None:
    plant = single_track(0.34, lag=0.05, rate=3.2)
    times = 1e-3 * np.arange(1, 401)
    small = np.asarray(driven(plant, (0.0, 0.0, 0.0, 1.0), (0.1, 0.0), 0.4))[:, 6]
    np.testing.assert_allclose(small, 0.1 * (1 - np.exp(-times / 0.05)), atol=1e-6)
    # at its rate limit until what is left is what the lag would do at that rate
    large = np.asarray(driven(plant, (0.0, 0.0, 0.0, 1.0), (0.4, 0.0), 0.4))[:, 6]
    until = (0.4 - 3.2 * 0.05) / 3.2
    expected = np.where(times < until, 3.2 * times, 0.4 - 3.2 * 0.05 * np.exp(-(times - until) / 0.05))
    np.testing.assert_allclose(large, expected, atol=2e-4)


def test_stiff_tyres_are_kinematic() -> None:
    """The distance falls in proportion to 1/stiffness, at steering angles so small that slip is linear in them."""
    state, command = (0.3, 1.0, -0.5, 2.0), (0.02, 0.5)
    servo = {"lag": 2e-4, "rate": 1e4}
    kinematic = single_track(0.34, blend_from=1e3, blend_to=2e3, **servo)
    model = kinematic.observe(driven(kinematic, state, command, 1.0, 1e-4)[-1])
    apart = []
    for stiffness in (10.0, 20.0, 40.0):
        # a step of the steering asks for more than friction gives
        plant = single_track(0.34, stiffness=stiffness, saturating=False, **servo)
        end = plant.observe(driven(plant, state, command, 1.0, 1e-4)[-1])
        apart.append(float(jnp.abs(end - model).max()))
    rates = -np.diff(np.log2(apart))
    assert apart[-1] < 2e-3
    assert np.all((rates > 0.8) & (rates < 1.2)), (apart, rates)


def test_the_kinematic_limit_is_the_problems_vehicle() -> None:
    """Without thrust, once the steering is where it stays: rear axle, heading and speed move as the bicycle's do."""
    servo = {"lag": 2e-4, "rate": 1e4}
    plant = single_track(0.34, blend_from=1e3, blend_to=2e3, **servo)
    way = driven(plant, (0.3, 1.0, -0.5, 2.0), (0.2, 0.0), 1.0, 1e-4)
    first, last = plant.observe(way[999]), plant.observe(way[-1])
    model = driven(Model(KinematicBicycle()), first, (0.2, 0.0), 0.9, 1e-4)[-1]
    np.testing.assert_allclose(last, model, atol=1e-8)


def test_blend_is_continuous() -> None:
    plant = single_track(0.34)
    speeds = np.linspace(0.1, 0.7, 601)
    z = jnp.array([0.1, 0.0, 0.0, 0.0, 0.05, 0.4, 0.2])
    rates = np.asarray(jax.vmap(lambda v: plant.motion(z.at[3].set(v), jnp.zeros(()), jnp.ones(())))(jnp.array(speeds)))
    scale = np.abs(rates).max(axis=0) + 1e-3
    assert (np.abs(np.diff(rates, axis=0)) < 0.03 * scale[None]).all()


def test_start_and_observation_are_inverse() -> None:
    plant, state = single_track(0.34), jnp.array([2.0, 0.3, -0.7, 1.1])
    assert isinstance(plant, SingleTrack)
    np.testing.assert_allclose(plant.observe(plant.start(state)), state, rtol=0, atol=1e-15)


def test_numbers_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match=r"plant\.lag: expected a positive finite number"):
        single_track(0.34, lag=0.0)
