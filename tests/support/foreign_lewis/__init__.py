"""Instruments for lewis, a neutron source's framework for simulators: `python -m lewis -k tests.support.foreign_lewis`.

Written from what is known of the wire, with nothing of our own drivers or simulators: sessions, terminators, the
matching of commands and the states are lewis's.
"""
