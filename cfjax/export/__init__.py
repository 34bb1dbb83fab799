"""From a certified run to a controller that a car can carry: C99 without dependencies."""

from typing import TYPE_CHECKING

from cfjax.lazy import on_first_use


if TYPE_CHECKING:
    from cfjax.export.controller import Sources, sources_of, write_controller
    from cfjax.export.ros2 import write_package


__all__ = ["Sources", "sources_of", "write_controller", "write_package"]

__getattr__ = on_first_use(__name__)
