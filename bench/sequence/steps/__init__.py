"""One model for each step and block, by its verb."""
