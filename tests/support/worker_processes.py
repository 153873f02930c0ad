"""For tests that start worker processes: import this module before they begin.

The standard library starts one tracker for all processes that it spawns, and keeps it until this process ends.
"""

from multiprocessing.resource_tracker import ensure_running

ensure_running()
