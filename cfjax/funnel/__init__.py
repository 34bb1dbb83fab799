"""What is sought: templates of V, funnels, and the conditions that make one a control funnel function."""

from cfjax.funnel.funnel import Funnel
from cfjax.funnel.leg import Leg
from cfjax.funnel.objective import LATERAL, Objective, lateral_half_width
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
