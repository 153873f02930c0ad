"""Client of a station, for scripts and for the command line: `from bench.client import Station`."""

from bench.client.station import Station as Station
