"""Sensors: what is late is late, what is dropped is held, and chance is the seed's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.errors import InputError
from cfjax.plants import Measurement, Sensor, plant_named, sensor_named
from cfjax.plants.sensor import Memory
from cfjax.problem import KinematicBicycle


PERIOD, STEPS = 0.005, 400
CAR = KinematicBicycle()
TIMES = PERIOD * np.arange(STEPS)
TRUTH = np.stack([np.sin(TIMES), 2.0 * TIMES, -TIMES, 1.0 + 0 * TIMES], axis=1)  # x and y linear in time


def told(sensor: Sensor, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Measurements and their stamps along the way of TRUTH."""
    seen = measured(sensor, jax.random.key(seed), sensor.start(jnp.array(TRUTH[0]), sensor.remembered(PERIOD)))
    return np.asarray(seen.state), np.asarray(seen.stamp)


@jax.jit
def measured(sensor: Sensor, key: jax.Array, memory: Memory) -> Measurement:
    def one(memory, now):
        number, truth = now
        seen, memory = sensor.measure(
            jax.random.fold_in(key, number), truth, memory, number * PERIOD, jnp.asarray(PERIOD)
        )
        return memory, seen

    return jax.lax.scan(one, memory, (jnp.arange(STEPS), jnp.array(TRUTH)))[1]


def test_without_noise_it_is_the_truth() -> None:
    state, stamp = told(sensor_named("none", CAR))
    np.testing.assert_array_equal(state, TRUTH)
    np.testing.assert_allclose(stamp, TIMES, atol=1e-15)


@pytest.mark.parametrize("delay", [0.005, 0.0125, 0.04])
def test_a_delay_delays(delay: float) -> None:
    state, stamp = told(sensor_named(f"delay={delay}", CAR))
    taken = np.maximum(TIMES - delay, 0.0)
    np.testing.assert_allclose(stamp, taken, atol=1e-12)
    np.testing.assert_allclose(state[:, 1], 2.0 * taken, atol=1e-9)
    np.testing.assert_allclose(state[:, 0], np.sin(taken), atol=PERIOD**2 / 8 + 1e-12)


def test_jitter_stays_in_its_range_and_time_does_not_run_back() -> None:
    state, stamp = told(sensor_named("delay=0.01,jitter=0.02", CAR))
    late = (TIMES - stamp)[10:]
    assert late.min() >= 0.01 - 1e-12 and late.max() <= 0.03 + 1e-12
    assert np.ptp(late) > 0.01
    assert (np.diff(stamp) >= 0).all()
    np.testing.assert_allclose(state[10:, 1], 2.0 * stamp[10:], atol=1e-9)


def test_dropped_samples_hold_the_last_one() -> None:
    state, stamp = told(sensor_named("loss=0.3,position=0.01", CAR))
    held = np.diff(stamp) == 0
    assert 0.2 < held.mean() < 0.4
    np.testing.assert_array_equal(state[1:][held], state[:-1][held])  # with its noise
    assert (state[1:][~held] != state[:-1][~held]).any(axis=1).all()
    all_lost, _ = told(sensor_named("loss=1", CAR))
    np.testing.assert_array_equal(all_lost, np.repeat(TRUTH[:1], STEPS, axis=0))


def test_noise_has_its_size_and_bias() -> None:
    state, _ = told(sensor_named("mocap,position=0.02,bias_x=0.5,bias_heading=-0.1", CAR))
    error = state - TRUTH
    np.testing.assert_allclose(error.std(axis=0), [3e-3, 0.02, 0.02, 0.02], rtol=0.15)
    np.testing.assert_allclose(error.mean(axis=0), [-0.1, 0.5, 0.0, 0.0], atol=0.005)


def test_chance_is_the_seeds() -> None:
    noisy = sensor_named("mocap,wifi", CAR)
    np.testing.assert_array_equal(told(noisy, 3)[0], told(noisy, 3)[0])
    assert (told(noisy, 3)[0] != told(noisy, 4)[0]).any()


def test_similar_delays_share_a_program() -> None:
    assert {sensor_named(f"delay={delay}", CAR).remembered(PERIOD) for delay in (0.0, 0.02, 0.07)} == {16}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fog", "expected one of none, mocap, wifi"),
        ("delay=late", "finite number for delay"),
        ("dealy=1", "key of heading"),
        ("loss=1.5", "loss from 0 to 1"),
        ("delay=-1", "not negative"),
    ],
)
def test_bad_noise_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        sensor_named(text, CAR)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hovercraft", "expected one of model, disturbed, single_track, commonroad, slipx"),
        ("model:lag=1", "expected model with wheelbase=number"),
        ("disturbed", "expected a bound"),
        ("disturbed:x=0.1,hostile", "constant, random, adversarial"),
        ("disturbed:x=0.1,hold=0", "positive hold"),
        ("single_track:lag=-1", "plant.lag: expected a positive finite number"),
        ("commonroad", "wheelbase within 10 %"),
    ],
)
def test_bad_plants_are_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        plant_named(text, CAR)


def test_the_former_name_of_loss_works_with_a_line_of_warning(capsys: pytest.CaptureFixture[str]) -> None:
    assert float(sensor_named("drop=0.25", CAR).loss) == 0.25
    assert capsys.readouterr().err == (
        "warning: noise: drop is called loss now; the old name works until version 0.2\n"
    )
