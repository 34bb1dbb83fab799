"""Maps from files: our own YAML, the map of a ROS map server (`.yaml` beside an image), and GeoJSON.

* YAML with `obstacles`, as `Map` takes them, and perhaps `bounds`: [x, y, x, y], in m.
* YAML with `image`, `resolution`, `origin`: an occupancy grid in the frame of ROS, whose x and y are ours.
* CommonRoad's XML (`cfjax.planner.commonroad`).
* GeoJSON: the polygons of its features, in m. Files in degrees, as RFC 7946 has them, are refused.
"""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import yaml
from jaxtyping import Bool
from PIL import Image
from shapely.geometry.base import BaseGeometry

from cfjax.coerce import file, flag, listed, number, numbers
from cfjax.errors import InputError
from cfjax.planner.commonroad import commonroad_map
from cfjax.planner.map import Map


MOST_PIXELS = 2**26
MOST_PARTS = 4096  # convex parts of a map
GROWN, SIMPLER = 1.0, 0.95  # cells: outlines move so far outwards, and are then made simpler by less
METRES = re.compile(r"\bmet(re|er)s\b|EPSG:+(?!4\d\d\d\b)\d+")  # codes from 4000 to 4999 count in degrees


def read_map(path: str | Path, *, unknown_is_free: bool = False) -> Map:
    """The map of a file: its kind is told from what it holds.

    `unknown_is_free`: of an occupancy grid, whether cells of which nothing is known may be driven on.

    Raises:
        InputError: one line that says what is wrong with which file.
    """
    path, unknown_is_free = file("map", path), flag("unknown_is_free", unknown_is_free)
    content = _parsed(path)
    if isinstance(content, Map):
        return _of_moderate_size(path, content)
    if not isinstance(content, Mapping):
        raise InputError(f"{path}: expected a map with obstacles, an image or features, got {type(content).__name__}")
    if "image" in content:
        found = _grid(path, content, unknown_is_free)
    elif "type" in content:
        found = Map(list(_polygons(path, content)), source=path.name)
    elif "obstacles" in content:
        if more := sorted(map(str, content.keys() - {"obstacles", "bounds"})):
            raise InputError(f"{path}: expected obstacles and bounds alone, got {', '.join(more)}")
        found = Map(content["obstacles"], content.get("bounds"), path.name)
    else:
        raise InputError(
            f"{path}: expected obstacles, an image or GeoJSON, got {', '.join(map(str, content)) or 'none'}"
        )
    return _of_moderate_size(path, found)


def _of_moderate_size(path: Path, found: Map) -> Map:
    if len(found.obstacles) > MOST_PARTS:
        raise InputError(f"{path}: expected at most {MOST_PARTS} convex obstacles, got {len(found.obstacles)}")
    return found


def _parsed(path: Path) -> Any:
    """The content of YAML or JSON, the map of a scene in XML."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(
            f"{path}: expected text (YAML, GeoJSON or XML), got other bytes; a grid needs its .yaml"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: expected the file of a map, it cannot be read ({error.strerror})") from None
    if text.lstrip().startswith("<"):
        return commonroad_map(path, text)
    try:
        return json.loads(text) if text.lstrip().startswith("{") else yaml.safe_load(text)
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        raise InputError(f"{path}: expected YAML or GeoJSON ({' '.join(str(error).split())[:120]})") from None


# --- occupancy grids


def _grid(path: Path, content: Mapping, unknown_is_free: bool) -> Map:
    """A map of a ROS map server; its bounds are the image's."""
    expected = "[x, y, yaw] of the lower left corner"
    x, y, yaw = numbers(f"{path}: origin", content.get("origin"), expected, count=3)
    cell = number(f"{path}: resolution", content.get("resolution"), "m a pixel", above=0)
    if yaw:
        raise InputError(f"{path}: origin: expected a map that is not turned, got a yaw of {yaw:g} rad")
    free, occupied = (
        number(f"{path}: {key}", content.get(key, default), least=0, most=1)
        for key, default in (("free_thresh", 0.196), ("occupied_thresh", 0.65))
    )
    grey = _image(path, content["image"])
    chance = grey / 255 if content.get("negate") else 1 - grey / 255
    blocked = chance > occupied if unknown_is_free else chance >= free
    rows, columns = blocked.shape
    shapes = occupied_shapes(blocked, cell, (x, y))
    return Map(shapes, (x, y, x + columns * cell, y + rows * cell), path.name)


def _image(path: Path, name: object) -> np.ndarray:
    """Grey values, the highest row last: 0 is black."""
    image = path.parent / file(f"{path}: image", name)
    try:
        with Image.open(image) as opened:
            if opened.width * opened.height > MOST_PIXELS:
                raise InputError(
                    f"{image}: expected at most {MOST_PIXELS} pixels, got {opened.width} x {opened.height}"
                )
            return np.asarray(opened.convert("L"), float)[::-1]
    except FileNotFoundError:
        raise InputError(f"{path}: its image {image} does not exist") from None
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(f"{image}: expected an image ({error})") from None


def occupied_shapes(
    blocked: Bool[np.ndarray, "rows columns"], cell: float, corner: tuple[float, float]
) -> list[shapely.Polygon]:
    """Polygons that hold all blocked cells, and reach at most two cells beyond them.

    Runs of cells along rows are joined to outlines, which are grown by a cell: what a simpler line then cuts off is
    nearer to the grown outline than any cell is.
    """
    edges = np.diff(np.pad(blocked.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    (row, begin), (_, end) = np.nonzero(edges == 1), np.nonzero(edges == -1)
    cells = shapely.union_all(shapely.box(begin, row, end, row + 1))
    grown = shapely.buffer(cells, GROWN, join_style="mitre")
    simple = shapely.simplify(grown, SIMPLER)
    shape = simple if shapely.covers(simple, cells) else grown  # what is cut off may be occupied
    bounds = shapely.box(0, 0, blocked.shape[1], blocked.shape[0])
    placed = shapely.transform(shapely.intersection(shape, bounds), lambda at: at * cell + corner)
    return [part for part in shapely.get_parts(placed) if isinstance(part, shapely.Polygon)]


# --- GeoJSON


def _polygons(path: Path, content: Mapping) -> Iterator[BaseGeometry]:
    """The polygons of a GeoJSON object.

    Raises:
        InputError: for other shapes, and for degrees.
    """
    for index, feature in enumerate(_features(path, content)):
        name = f"{path}: feature {index}"
        try:
            shape = shapely.from_geojson(json.dumps(feature))
        except shapely.errors.GEOSException as error:
            raise InputError(f"{name}: expected GeoJSON ({' '.join(str(error).split())})") from None
        if not isinstance(shape, shapely.Polygon | shapely.MultiPolygon):
            raise InputError(f"{name}: expected a Polygon or MultiPolygon, got {getattr(shape, 'geom_type', 'none')}")
        yield shape


def _features(path: Path, content: Mapping) -> list[object]:
    """The geometries; refuses those in degrees."""
    if not METRES.search(str(content.get("crs"))):
        raise InputError(
            f"{path}: expected coordinates in m, got a file that does not say so, whose coordinates are degrees by RFC "
            '7946; in m they are by "crs": {"type": "name", "properties": {"name": "metres"}}'
        )
    kind = content["type"]
    if kind == "FeatureCollection":
        features = listed(content.get("features")) or []
        return [feature.get("geometry") if isinstance(feature, Mapping) else feature for feature in features]
    return [content.get("geometry") if kind == "Feature" else {**content, "crs": None}]
