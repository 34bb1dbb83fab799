"""Maps from files, and what is wrong with those that are none."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image

from cfjax import InputError
from cfjax.planner import Map, plan, read_map
from cfjax.planner.map_file import occupied_shapes
from tests.planner.scenes import BOUNDS, ENTRIES, GOAL, START


METRES = {"type": "name", "properties": {"name": "metres"}}
SQUARE = [[[2.0, -1.0], [3.0, -1.0], [3.0, 1.5], [2.0, 1.5], [2.0, -1.0]]]


def union(map: Map) -> shapely.Geometry:
    return shapely.union_all(map.shapes)


def test_our_own_yaml(tmp_path: Path) -> None:
    name = tmp_path / "scene.yaml"
    name.write_text("\ufeff" + json.dumps({"obstacles": ENTRIES, "bounds": BOUNDS}), encoding="utf-8")
    written = read_map(name)
    assert (written.obstacles, written.bounds) == (Map(ENTRIES, BOUNDS).obstacles, BOUNDS)
    name.write_text(
        "bounds: [0, 0, 9, 9]\nobstacles:\n  - disc: [3, 3, 0.5]\n  - polygon: [[1, 1], [2, 1], [1.5, 2]]\n"
    )
    assert read_map(name).labels[:2] == ("obstacle 0", "obstacle 1")


def grid() -> np.ndarray:
    """Grey values, the first row on top; a slanted wall, a block, and a corner of which nothing is known."""
    pixels = np.full((80, 120), 254, np.uint8)
    for k in range(40):
        pixels[20 + k // 2, 30 + k : 33 + k] = 0
    pixels[60:80, 50:70] = 0
    pixels[:10, :10] = 205
    return pixels


@pytest.fixture
def ros(tmp_path: Path) -> Path:
    Image.fromarray(grid()).save(tmp_path / "hall.pgm")
    name = tmp_path / "hall.yaml"
    name.write_text(
        "image: hall.pgm\nresolution: 0.05\norigin: [-1.0, -2.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return name


@pytest.mark.parametrize("unknown_is_free", [False, True])
def test_every_occupied_cell_is_held_and_no_far_one(ros: Path, unknown_is_free: bool) -> None:
    map = read_map(ros, unknown_is_free=unknown_is_free)
    assert map.bounds == pytest.approx((-1.0, -2.0, 5.0, 2.0))
    inside = shapely.union_all(map.shapes[:-4])
    blocked = grid()[::-1] < (200 if unknown_is_free else 250)
    row, column = np.nonzero(blocked)
    corners = [
        shapely.box(*(0.05 * np.array([c, r, c + 1, r + 1]) + [-1, -2, -1, -2]))
        for r, c in zip(row, column, strict=True)
    ]
    assert inside.buffer(1e-9).covers(shapely.union_all(corners))
    assert inside.area < 2.5 * 0.05**2 * blocked.sum()
    row, column = np.nonzero(~blocked)
    centres = shapely.points(0.05 * (column + 0.5) - 1, 0.05 * (row + 0.5) - 2)
    touched = centres[shapely.distance(centres, inside) == 0]
    assert shapely.distance(touched, shapely.union_all(corners)).max() < 0.1
    assert len(map.obstacles) < 16


def test_a_turned_line_of_cells_is_covered() -> None:
    rng = np.random.default_rng(0)
    blocked = rng.random((60, 60)) < 0.1
    shapes = shapely.union_all(occupied_shapes(blocked, 1.0, (0.0, 0.0)))
    row, column = np.nonzero(blocked)
    assert shapes.buffer(1e-9).covers(shapely.union_all(shapely.box(column, row, column + 1, row + 1)))


def test_geojson_in_metres(tmp_path: Path) -> None:
    name = tmp_path / "yard.geojson"
    polygon, shapes = {"type": "Polygon", "coordinates": SQUARE}, []
    for content in (
        {**polygon, "crs": METRES},
        {"type": "Feature", "geometry": polygon, "crs": METRES},
        {"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": polygon}], "crs": METRES},
        {**polygon, "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}},
    ):
        name.write_text(json.dumps(content))
        shapes.append(union(read_map(name)))
    assert all(shape.equals(shapely.box(2.0, -1.0, 3.0, 1.5)) for shape in shapes)
    assert plan(name, START, (6.0, 0.0, 0)).map.source == "yard.geojson"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (json.dumps({"type": "Polygon", "coordinates": SQUARE}), "coordinates in m, got a file that does not say so"),
        (json.dumps({"type": "Polygon", "coordinates": SQUARE, "crs": "EPSG:4326"}), "expected coordinates in m"),
        (json.dumps({"type": "Point", "coordinates": [0, 0], "crs": METRES}), "feature 0: expected a Polygon"),
        (json.dumps({"type": "Polygon", "coordinates": 3, "crs": METRES}), "feature 0: expected GeoJSON"),
        ("{", "expected YAML or GeoJSON"),
        ("- 1", "expected a map with obstacles, an image or features, got list"),
        ("obstacles: []\nwalls: 3", "expected obstacles and bounds alone, got walls"),
        ("speed: 3", "expected obstacles, an image or GeoJSON, got speed"),
        ("obstacles: [{disc: [1, 2]}]", "expected entries"),
        ("image: none.pgm\nresolution: 0.05\norigin: [0, 0, 0]", "its image .*none.pgm does not exist"),
        ("image: map.yaml\nresolution: 0.05\norigin: [0, 0, 0]", "map.yaml: expected an image"),
        ("image: none.pgm\nresolution: -1\norigin: [0, 0, 0]", "resolution: expected a positive"),
        ("image: none.pgm\norigin: [0, 0, 0]", "resolution: expected"),
        ("image: none.pgm\nresolution: 1\norigin: [0, 0, 1.5]", "not turned, got a yaw of 1.5 rad"),
    ],
)  # fmt: skip
def test_what_is_no_map_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    name = tmp_path / "map.yaml"
    name.write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        read_map(name)
    assert "\n" not in str(refused.value) and "map.yaml" in str(refused.value)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml: .* cannot be read .No such file"):
        plan(tmp_path / "none.yaml", START, GOAL)
    (tmp_path / "map.pgm").write_bytes(b"P5\n2 2\n255\n\xff\xfe\xff\xff")
    with pytest.raises(InputError, match=r"map\.pgm: expected text .YAML, GeoJSON or XML., got other bytes"):
        read_map(tmp_path / "map.pgm")


def test_a_drive_through_a_grid(ros: Path) -> None:
    found = plan(ros, (-0.4, -1.4, -math.pi / 2), (4.4, 1.4, -math.pi / 2), footprint=[[0.15, 0.1]], speed=1.0)
    assert found.spare > 0 and "hall.yaml" in str(found)
