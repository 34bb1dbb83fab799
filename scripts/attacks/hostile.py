"""Files that are made to crash the checker, to hang it or to exhaust it."""

import json
import random
from collections.abc import Callable
from typing import Any

from attacks.document import Document, cells_of, renewed, stretches_of
from attacks.margins import is_bounds


ODD_RATIONALS = ("1e9", "1/0", "2/4", "-0", "1/-2", "--1", "0x10", "1_0", " 1", "1\n", "\u0661", "NaN", "")


def hostile_file(rng: random.Random, document: Document) -> bytes:
    """Files that are made to crash, to hang or to exhaust, or that are no files of this kind at all."""
    text = json.dumps(document)
    spliced = rng.randrange(len(text))
    gram = '"lower": [' + "7" * 5000 + ","
    nested = "[" * 100_000 + "]" * 100_000
    exploding = [["input", "alpha"]] + [["mul", k, k] for k in range(300)]
    tower = [["constant", "7/3"]] + [["mul", k, k] for k in range(300)]
    wide = [["input", name] for name in document["problem"]["vehicle"]["states"]]
    wide += [["add", k, k + 1] for k in range(3)] + [["mul", k, k] for k in range(6, 60)]

    growing = [["input", "alpha"], ["sin", 0]] + [["mul", k, k] for k in range(1, 60)]
    huge = {"node": 1, "function": "sin", "coefficients": ["0"], "lower": "-4", "upper": "4", "bound": str(2**255)}
    sums = [["input", "alpha"], ["input", "v"], ["add", 0, 1]] + [["mul", 2, k] for k in range(2, 21)]
    sums += [["add", k, k] for k in range(21, 399)]

    # functions of long even polynomials, and a drift that no mirror keeps: every pattern of signs looks at all of them
    mirrors = [["input", "alpha"], ["input", "v"], ["mul", 0, 0], ["mul", 1, 1], ["constant", "1"], ["add", 2, 3]]
    mirrors += [["add", 4, 5]] + [["mul", k, k] for k in range(6, 10)]
    for _ in range(28):
        mirrors += [["cos", len(mirrors) - 1], ["add", len(mirrors) - 1, 4]]

    def with_nodes(nodes: list, enclosures: tuple = ()) -> bytes:
        changed = json.loads(text)
        dynamics = changed["problem"]["vehicle"]["dynamics"]
        dynamics["nodes"], changed["problem"]["vehicle"]["name"] = nodes, "monster"
        dynamics["outputs"] = [len(nodes) - 1] * len(dynamics["outputs"])
        stretches_of(changed)[0]["enclosures"] = list(enclosures)
        return renewed(changed)

    def bounds(changed: Document) -> Document:
        """A tube's own, or those of a stretch."""
        path = changed["problem"]["path"]
        return path["bounds"] if is_bounds(path) else stretches_of(changed)[0]["bounds"]

    def with_change(change: Callable[[Document], Any]) -> bytes:
        changed = json.loads(text)
        change(changed)
        return renewed(changed)

    makers: list[Callable[[], bytes]] = [
        lambda: b"",
        lambda: b"\xff\xfe" + text.encode(),
        lambda: text[:spliced].encode(),
        lambda: (text[:spliced] + rng.choice("{}[],:\"'\\\0x1e") + text[spliced:]).encode(),
        lambda: nested.encode(),
        lambda: ('{"a":' * 50_000 + "1" + "}" * 50_000).encode(),
        lambda: (text[:-1] + ', "problem": ' + nested + "}").encode(),
        lambda: text.replace('"lower": [', gram, 1).encode(),
        lambda: ("9" * 3_000_000).encode(),
        lambda: ("[" + "0," * 4_000_000 + "0]").encode(),
        lambda: ("[" + "[]," * 3_000_000 + "0]").encode(),
        lambda: b" " * (33 * 2**20),
        lambda: text.replace(
            '"version": 4', '"version": ' + rng.choice(["NaN", "1.0", "true", "1e999", "-Infinity"])
        ).encode(),
        lambda: text.replace('"beta": "1"', '"beta": "1", "beta": "1"').encode(),
        lambda: with_nodes(exploding),
        lambda: with_nodes(tower),
        lambda: with_nodes(wide),
        lambda: with_nodes(growing, (huge,)),
        lambda: with_nodes(sums),
        lambda: with_nodes(mirrors),
        lambda: with_change(lambda d: cells_of(d)[0].update(reference=rng.choice([8, -1, 10**9, True, "0"]))),
        lambda: with_change(lambda d: bounds(d).update(curvature=rng.choice([["1", "-1"], [], ["0"] * 3, "1"]))),
        lambda: with_change(lambda d: bounds(d).update(speed=rng.choice([["0", "1"], ["-2", "-1"], ["1"]]))),
        lambda: with_change(lambda d: bounds(d).update(speed=["1", "1" + "0" * 399])),
        lambda: with_change(lambda d: bounds(d).update(duration="1", turn_rate="1")),
        lambda: with_change(lambda d: d["funnels"][0].update(beta_inner=rng.choice(["0", "1", "-1", *ODD_RATIONALS]))),
        lambda: with_change(lambda d: d["funnels"][0].update(beta_inner="1/1" + "0" * 398)),
        lambda: with_change(lambda d: d["funnels"][0].update(margin_per_metre=rng.choice([0, "0", "-1", {}, "x"]))),
        lambda: with_change(lambda d: stretches_of(d)[0].update(cells=cells_of(d)[:1] * 1024)),
        lambda: with_change(lambda d: cells_of(d)[0]["grams"][0]["lower"].__setitem__(0, 2**65)),
        lambda: with_change(lambda d: d["funnels"][0].update(margin="1" + "0" * 399)),
        lambda: with_nodes([["input", "alpha"]] * 10_000),
        lambda: with_nodes([["sin", 0], ["input", "alpha"]]),
        lambda: with_nodes([["input", "input:u1"], ["exp", 0]]),
        lambda: with_nodes([["input", "alpha"], ["inv", 0]]),
        lambda: with_change(lambda d: cells_of(d)[0]["grams"][0].update(exponent=10**9)),
        lambda: with_change(lambda d: cells_of(d)[0]["grams"][0].update(exponent=-1)),
        lambda: with_change(lambda d: d["funnels"][0].update(rate=rng.choice(["1" + "0" * 300, "-100000", "65"]))),
        lambda: with_change(lambda d: d["funnels"][0].update(margin=rng.choice(ODD_RATIONALS))),
        lambda: with_change(
            lambda d: d["hints"]["decrease"][0].update(degrees=rng.choice([[8] * 6, [10**9] * 6, [], [3], [True] * 6]))
        ),
        lambda: with_change(lambda d: d["problem"].update(inputs=d["problem"]["inputs"] * rng.choice([0, 2, 400]))),
        lambda: with_change(lambda d: d["problem"]["vehicle"].update(states=["alpha", "x", "x", "v"])),
        lambda: with_change(lambda d: d["problem"]["path"].update(pieces=[], closed=True)),
        lambda: with_change(lambda d: d["problem"]["path"].update(name="circle\x1b[2J")),
        lambda: with_change(lambda d: d["hints"].update(decrease=d["hints"]["decrease"] * 2)),
        lambda: with_change(lambda d: d["funnels"][0].update(shape=["1" + "0" * 399 + "/3"] * 10)),
        lambda: with_change(lambda d: stretches_of(d)[0].update(whitening=[["0"] * 4] * 4)),
    ]
    return rng.choice(makers)()
