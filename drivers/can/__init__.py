"""CAN frames as arrays: identifiers, DBC fields, sequence numbers, gaps. Nothing here does I/O."""
