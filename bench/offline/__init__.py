"""Off-line reduction of recorded data: case.json and CSV records in, results out."""
