"""The table of experiments/random_maps.py, of few maps: what is certified touches nothing, by another library."""

from pathlib import Path

import pytest

from experiments import random_maps
from experiments.random_maps import Scene, least_distance, outcome_of, outcomes, planned, scenes, table


def test_random_maps_are_certified_and_no_car_touches_anything() -> None:
    found = [outcome_of(seed, 12, 5000) for seed in (2, 3, 4)]
    assert not any(each.unproven for each in found)
    assert all(each.nearest > 0 for each in found if each.certified)
    assert sum(each.certified for each in found) >= 2


def test_half_planes_of_the_parts_of_a_piece_are_not_joined() -> None:
    """On this map a piece is clear in halves by their boxes alone; the checker refused the whole piece."""
    assert outcome_of(29, 100, 200).nearest > 0


def test_a_campaign_goes_on_where_it_was_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = tmp_path / "maps.log"
    first = outcomes(2, 5, 200, log)
    monkeypatch.setattr(random_maps, "planned", lambda scene: pytest.fail("this map is known"))
    again = outcomes(2, 5, 200, log)
    assert table(again, 5, 200) == table(first, 5, 200)
    assert "of 400 cars" in table(again, 5, 200) or any(not each.certified for each in first)
    monkeypatch.undo()
    assert len(outcomes(1, 5, 100, log)) == 1 and len(log.read_text().splitlines()) == 3  # other cars, another campaign


@pytest.mark.slow
@pytest.mark.parametrize(("name", "scene"), list(scenes()), ids=[name for name, _ in scenes()])
def test_scenes_by_hand_are_certified(name: str, scene: Scene) -> None:
    assert least_distance(planned(scene), scene.shapes, 5000, 0) > 0, name
