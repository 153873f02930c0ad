"""What is written for people and for other programs, from recorded data and the results of the analysis."""
