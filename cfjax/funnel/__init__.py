"""What is sought: templates of V, funnels, and the conditions that make one a control funnel function."""

from cfjax.funnel.funnel import Funnel
from cfjax.funnel.template import TEMPLATES, Contracting, Paper, Template, template_named


__all__ = ["TEMPLATES", "Contracting", "Funnel", "Paper", "Template", "template_named"]
