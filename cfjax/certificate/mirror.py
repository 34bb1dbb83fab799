"""Signs of states and inputs under which a vehicle, its inputs and a funnel are their own mirror images, sought."""

from dataclasses import replace
from itertools import product

from cfcheck.claims.proof import Question
from cfcheck.vehicle.structure import is_mirror


def mirrored(question: Question) -> Question:
    """The same question with such signs, where there are any; they cost half of the proof less."""
    model = question.model
    states, inputs = len(model.vehicle.states), len(model.inputs)
    for flips in product((1, -1), repeat=states + inputs - 1):
        signs = (*flips[:states], 1, *flips[states:])  # u0 keeps its own
        if is_mirror(question.dynamics, model.vehicle.states, model.inputs, question.funnel.shape, signs):
            return replace(question, mirror=signs)
    return question
