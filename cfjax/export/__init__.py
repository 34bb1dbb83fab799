"""From a certified run to a controller that a car can carry: C99 without dependencies."""

from cfjax.export.controller import Sources, sources_of, write_controller


__all__ = ["Sources", "sources_of", "write_controller"]
