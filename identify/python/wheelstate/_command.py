"""The command `wheelstate`."""

import signal
import sys

from . import _native
from ._fmu import fmu


def main() -> int:
    """Runs the command line of this process; the exit code is that of the Rust programs."""
    # As in any other program Ctrl-C ends the process at once: files appear whole or not at all.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _native.command(sys.argv[1:], fmu("NursingRobot"))
