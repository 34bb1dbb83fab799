"""What comes after learning is compiled while it runs, on a core that has nothing else to do then."""

from collections.abc import Sequence
from contextlib import suppress
from threading import Thread

from cfjax.certificate.robustness import held_shape
from cfjax.funnel import template_named
from cfjax.options import Options
from cfjax.problem import Problem
from cfjax.simulation.rollout import prepare_cars
from cfjax.solver import solver_named
from cfjax.solver.program import Shape


def compile_ahead(problem: Problem, shapes: Sequence[Shape], options: Options) -> Thread:
    """Proof, robustness and cars of a problem, in the order in which they are needed; `shapes` are the proof's.

    Whoever needs a program that is still being compiled waits for it. Where this fails the stage itself says why. The
    thread has begun already.
    """

    def work() -> None:
        with suppress(Exception):
            solver = solver_named(options.solver)
            for shape in shapes:
                solver.prepare(shape)
            if options.robustness:
                solver.prepare(held_shape(problem.dimension))
            if options.cars:  # last, for of a tube nothing is known before it is there
                prepare_cars(problem, template_named(options.template), cars=options.cars)

    thread = Thread(target=work, name="compile ahead")
    thread.start()
    return thread
