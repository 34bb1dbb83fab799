"""How far a reference moves: ∫ v e^{iP} dt enclosed in balls, P = ∫ ω dt the turn and v the speed.

Positions are complex numbers, metres forward + i metres to the left of where the reference starts. Along an arc the
integral is known in closed form. Along any other curve Taylor's series about the middle of short stretches enclose it.
"""

from flint import acb, acb_series, arb, arb_poly, fmpq

from cfcheck.exact.rational import upper_bound


SERIES_ORDER = 9  # of Taylor's remainder; python-flint's series have ten terms unless its global cap is raised
REMAINDER = fmpq(1, 10**10)  # m: a stretch is halved until its Taylor remainder is below; gaps are decided to 1e-6 m
MOST_STRETCHES = 2**12  # of one piece: some hundred laps of a spiral take them
TOO_WILD = "the path turns too fast, or is too long, for its pose to be enclosed"


def along_arc(turn_rate: fmpq, speed: fmpq, duration: fmpq) -> acb:
    """At constant turning rate (rad/s) and speed (m/s): an arc or a straight line, of any number of laps."""
    if turn_rate == 0:
        return acb(arb(speed * duration))
    turn = arb(turn_rate * duration)
    return arb(speed / turn_rate) * acb(turn.sin(), 1 - turn.cos())


def along_curve(turn: arb_poly, speed: arb_poly, duration: fmpq) -> tuple[acb, int]:
    """∫ speed e^{i turn} dt from 0 and the number of stretches: Taylor's series about the middle of each.

    They are halved until the remainder is small.
    With t = middle + half·u: the real and the imaginary part of the integrand are each their series up to u^{K−1}, and
    the K-th coefficient at some place between times u^K.
    """
    total, open_ = acb(0), [(fmpq(0), duration)]
    for count in range(1, MOST_STRETCHES + 1):
        begin, end = open_.pop()
        middle, half = (begin + end) / 2, arb((end - begin) / 2)
        _, whole = series(turn, speed, arb_poly([arb(middle) + half * arb(0, 1), half]), SERIES_ORDER + 1)
        remainder = upper_bound(abs(whole[SERIES_ORDER]) * half * arb(fmpq(2, SERIES_ORDER + 1)))
        if remainder > REMAINDER:
            open_ += [(middle, end), (begin, middle)]
            continue
        _, point = series(turn, speed, arb_poly([arb(middle), half]), SERIES_ORDER + 1)
        ball = arb(0, upper_bound(arb(remainder)))
        total += sum((point[k] * arb(fmpq(2, k + 1)) for k in range(0, SERIES_ORDER, 2)), acb(0)) * half
        total += acb(ball, ball)
        if not open_:
            return total, count
    raise ValueError(TOO_WILD)


def series(turn: arb_poly, speed: arb_poly, along: arb_poly, terms: int) -> tuple[acb_series, acb_series]:
    """e^{i turn} and speed e^{i turn} at t = along(u) in powers of u."""
    exponent = acb_series([acb(0, c) for c in turn(along).coeffs()] or [acb(0)], prec=terms)
    phase = exponent.exp()
    result = phase * acb_series(speed(along).coeffs() or [acb(0)], prec=terms)
    if result.prec < terms:  # python-flint's global cap: terms that are missing would read as zero
        raise ValueError(f"expected series of {terms} terms, got {result.prec}")
    return phase, result
