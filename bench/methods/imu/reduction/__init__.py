"""Reduction of attitudes and rates to the calibration of six channels."""
