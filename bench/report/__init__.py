"""Reports for people and files for other programs, from recorded data and the results of the analysis."""
