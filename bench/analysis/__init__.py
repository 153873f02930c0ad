"""Arithmetic of the test methods: numpy arrays in, frozen dataclasses out; no files, no devices, no event loop."""
