"""Free-running pulse counters that send CAN frames described by a DBC."""
