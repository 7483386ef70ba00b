#!/usr/bin/env python3
"""Runs a command and writes its wall seconds, CPU seconds (children included) and peak memory as JSON.
    timed.py FILE COMMAND ..."""
import json
import resource
import subprocess
import sys
import time

begin = time.monotonic()
code = subprocess.run(sys.argv[2:]).returncode
wall = time.monotonic() - begin
used = resource.getrusage(resource.RUSAGE_CHILDREN)
with open(sys.argv[1], "w") as out:
    json.dump({"wall_s": wall, "cpu_s": used.ru_utime + used.ru_stime, "peak_kib": used.ru_maxrss}, out)
sys.exit(code)
