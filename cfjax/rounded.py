"""Decimals of proven figures for people: a claim that is rounded says no more than what is proven.

Margins, what is absorbed, levels to start from are rounded down; half-widths of a funnel, in which cars stay, and the
lower edge of its shell up. A float stands for itself, to the last bit, unless it was `written` by somebody.
"""

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal


NOTHING = "–"
MILLI = 3  # power of ten: from s to ms


def rounded_down(value: float | Decimal | None, digits: int = 4, power: int = 0) -> str:
    """The largest decimal of so many significant digits that is at most value · 10^power; a dash for no value."""
    return _rounded(value, digits, power, ROUND_FLOOR)


def margin_text(value: float | None) -> str:
    """A margin, certified or falsified, as it stands wherever people read it: in 1/s, or in 1/m per metre."""
    return rounded_down(value)


def rounded_up(value: float | Decimal | None, digits: int = 4, power: int = 0) -> str:
    """The smallest decimal of so many significant digits that is at least value · 10^power; a dash for no value."""
    return _rounded(value, digits, power, ROUND_CEILING)


def written(value: float) -> Decimal:
    """A number of the question as proofs read it: 0.9 is nine tenths, not its binary neighbour."""
    return Decimal(repr(value))


def _rounded(value: float | Decimal | None, digits: int, power: int, rounding: str) -> str:
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return f"{float(value):g}"
    short = Context(prec=digits, rounding=rounding).create_decimal(Decimal(value)).scaleb(power)
    return f"{float(short):.{digits}g}"  # the float nearest to a decimal of few digits prints that decimal
