"""`python -m bench` is `bench`."""

from bench.cli.main import run

run()
