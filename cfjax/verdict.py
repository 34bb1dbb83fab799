"""The four answers, never blurred."""

import enum

from cfjax import coerce


class Verdict(enum.Enum):
    """What became of a candidate or a synthesis."""

    CERTIFIED = "certified"  # proven: the exact checker accepted the certificate that lies on disk
    REFUTED = "refuted"  # a given candidate violates a condition; there is a witness that the checker confirms
    INCONCLUSIVE = "inconclusive"  # nothing was proven; this is no proof that no funnel exists
    SOLVER_FAILED = "solver_failed"  # a numerical solver gave no usable answer

    @classmethod
    def _missing_(cls, value: object) -> "Verdict":
        return coerce.choice("verdict", value, cls)
