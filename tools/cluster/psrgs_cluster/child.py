"""Runs a program that ends when this process's parent ends, however the parent ends.

The parent holds the other end of this process's standard input and never writes. The end of a killed parent closes the
pipe, and the program is killed. If this process itself is killed, Linux kills the program.
Usage: child.py PROGRAM ARGUMENT...
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading

PR_SET_PDEATHSIG = 1


def _end_with(parent: int) -> None:
    """In the child, before the program: asks Linux for a signal at the parent's end."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGKILL)


def _kill_at_end_of_input(program: subprocess.Popen[bytes]) -> None:
    while os.read(0, 4096):
        pass
    program.kill()


def main(command: list[str]) -> int:
    """Runs the command and returns its exit code; 128 and the signal's number if a signal ended the command."""
    me = os.getpid()
    before = (lambda: _end_with(me)) if sys.platform == "linux" else None
    program = subprocess.Popen(command, stdin=subprocess.DEVNULL, preexec_fn=before)
    threading.Thread(target=_kill_at_end_of_input, args=(program,), daemon=True).start()
    code = program.wait()
    return code if code >= 0 else 128 - code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
