"""Exchanged instruments, and second masters: no instrument may receive a message for another."""
