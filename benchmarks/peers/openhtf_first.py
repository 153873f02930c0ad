"""A test of OpenHTF with one phase, which says that it begins."""

import openhtf


def first(_test):
    print("begins", flush=True)


openhtf.Test(openhtf.PhaseOptions()(first)).execute(test_start=lambda: "A")
