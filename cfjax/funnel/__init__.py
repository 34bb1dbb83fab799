"""What is sought: templates of V, funnels, and the conditions that make one a control funnel function."""

from typing import TYPE_CHECKING

from cfjax.lazy import on_first_use


if TYPE_CHECKING:
    from cfjax.funnel.funnel import LATERAL, Funnel, lateral_half_width
    from cfjax.funnel.leg import Leg
    from cfjax.funnel.objective import Objective
    from cfjax.funnel.template import TEMPLATES, Contracting, Paper, Template, template_named


__all__ = [
    "LATERAL",
    "TEMPLATES",
    "Contracting",
    "Funnel",
    "Leg",
    "Objective",
    "Paper",
    "Template",
    "lateral_half_width",
    "template_named",
]

__getattr__ = on_first_use(__name__)
