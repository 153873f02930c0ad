"""History of units over their calibrations: results, trends, control charts, and the comparison of two runs."""
