"""Recorded data from elsewhere: case.json and CSV records in, results out."""
