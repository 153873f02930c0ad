"""One run in one process: devices opened, plan run, signals heeded, manifest kept."""
