"""`python -m cfjax.export FOLDER`: the C99 controller of a certified run, or a package of ROS 2 around it.

Exit code: 0 done; 2 bad input, one line on stderr.
"""

import argparse
import os
import sys
from pathlib import Path


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m cfjax.export",
        description="Write the controller of a certified run: a C99 header and source, or a ROS 2 package around them.",
    )
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="a run's folder")
    parser.add_argument(
        "--output", metavar="DIR", type=Path, help="where to write; default: FOLDER/controller or FOLDER/ros2"
    )
    parser.add_argument(
        "--ros2",
        action="store_true",
        help="write an ament package: a C++ node with odometry in, Ackermann command out; never built with ROS itself",
    )
    parser.add_argument(
        "--frame",
        help="of the heading in the states of the C code: paper, from +y; ros, yaw from +x; default: the run's. The "
        "package of ROS 2 is in the frame of ROS",
    )
    parser.add_argument("--vehicle", metavar="module.Class", help="of a run of your own vehicle: its class")
    options = parser.parse_args(arguments)
    os.environ.setdefault("JAX_PLATFORMS", "cpu")  # before the first array

    from cfjax.errors import InputError
    from cfjax.export import write_controller, write_package
    from cfjax.report.run_folder import read_frame, read_run

    output = options.output or options.folder / ("ros2" if options.ros2 else "controller")
    try:
        if options.ros2 and options.frame:
            raise InputError("--frame: expected none beside --ros2, whose node is in the frame of ROS")
        result = read_run(options.folder, options.vehicle)
        if options.ros2:
            written = write_package(result, output)
        else:
            written = write_controller(result, output, options.frame or read_frame(options.folder))
    except InputError as error:
        message = str(error)
    except OSError as error:
        message = f"--output: cannot write to {output} ({error.strerror or error})"
    else:
        for path in written:
            print(path)
        return 0
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
