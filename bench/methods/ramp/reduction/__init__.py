"""From legs to the dynamic characteristic."""
