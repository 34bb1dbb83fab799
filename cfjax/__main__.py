"""`cfjax COMMAND …`, or `python -m cfjax COMMAND …`: every command of the package by one name.

Exit code: that of the command; 2 for none that there is.
"""

import difflib
import importlib
import sys


COMMANDS = {
    "train": ("cfjax.train", "look for a certified funnel along a path, or sweep over many"),
    "check": ("cfcheck.__main__", "replay the proof of a run exactly"),
    "follow": ("cfjax.tubes.__main__", "prove a path of points by the tubes of the package"),
    "plan": ("cfjax.planner.__main__", "find a path through a map, and prove that a car on it is clear"),
    "simulate": (
        "cfjax.simulate",
        "drive the law of a run at a control period, on a plant, with noise and delay",
    ),
    "export": ("cfjax.export.__main__", "write the controller of a run in C, or for ROS 2"),
    "report": ("cfjax.report.__main__", "write the page of a run, or the index of a sweep, again"),
    "gather": ("cfjax.gather", "table and picture of a sweep"),
}
"""By name: the module whose `main` it is, and what it does."""


def usage() -> str:
    """One line for each command."""
    lines = [f"  {name:<9} {what}" for name, (_, what) in COMMANDS.items()]
    return "\n".join(["usage: cfjax COMMAND …", "", *lines, "", "cfjax COMMAND --help says more of one."])


def main() -> int:
    """Entry point: the first argument names the command, which gets the others."""
    given = sys.argv[1:]
    if not given or given[0] in ("-h", "--help"):
        print(usage())
        return 0 if given else 2
    name = given[0]
    if name not in COMMANDS:
        near = difflib.get_close_matches(name, COMMANDS, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        print(f"error: expected one of {', '.join(COMMANDS)}, got {name}{hint}", file=sys.stderr)
        return 2
    module, _ = COMMANDS[name]
    sys.argv = [f"cfjax {name}", *given[1:]]
    return importlib.import_module(module).main()


if __name__ == "__main__":
    # under its own name, so that the workers of a sweep can import it
    from cfjax.__main__ import main as entry_point

    sys.exit(entry_point())
