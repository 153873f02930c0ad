"""Long campaigns of hostile trials, one for each line of a scorecard; they are stopped and continued at will."""
