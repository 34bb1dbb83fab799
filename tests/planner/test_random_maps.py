"""The table of experiments/random_maps.py, of few maps: what is certified touches nothing, by another library."""

import pytest

from experiments.random_maps import Outcome, Scene, least_distance, planned, random_scene, scenes


def test_random_maps_are_certified_and_no_car_touches_anything() -> None:
    outcomes = [(seed, random_scene(seed, 12)) for seed in (2, 3, 4)]
    found: list[Outcome] = []
    for seed, scene in outcomes:
        outcome = planned(scene)
        found.append(outcome)
        assert not outcome.unproven, outcome.reason
        if outcome.plan:
            assert least_distance(outcome.plan, scene.shapes, 5000, seed) > 0
    assert sum(outcome.plan is not None for outcome in found) >= 2


@pytest.mark.slow
@pytest.mark.parametrize(("name", "scene"), list(scenes()), ids=[name for name, _ in scenes()])
def test_scenes_by_hand_are_certified(name: str, scene: Scene) -> None:
    outcome = planned(scene)
    assert outcome.plan is not None, f"{name}: {outcome.reason}"
    assert least_distance(outcome.plan, scene.shapes, 5000, 0) > 0
